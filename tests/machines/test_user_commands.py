"""``[user_command.M110]``: refused where it is missing, asked for where it is there."""

from importlib import resources

import pytest

from gcode.canon import UserCommand
from gcode.setup import Setup
from machines.errors import MachineError
from machines.job import plan_job, read_job
from machines.load import parse_machine, read_machine
from machines.parts import parts_of, request

SHIPPED = (resources.files("machines") / "data" / "mill3-step.toml").read_text(encoding="utf-8")
PROGRAM = "G21 G90\nG1 X5 F600\nM110 P2\nG1 X0\nM2\n"


def test_a_machine_that_does_not_describe_it_refuses_before_motion() -> None:
    job = read_job(PROGRAM, Setup(file="a.nc"), read_machine("mill3-step").config)
    assert [(error.line, error.code) for error in job.errors] == [(3, "GC065")]


def test_a_machine_that_describes_it_waits_at_rest_and_asks() -> None:
    config = parse_machine(SHIPPED + '\n[user_command.M110]\nrequest = "open the vise"\n', "m.toml")
    job = read_job(PROGRAM, Setup(file="a.nc"), config)
    assert not job.diagnostics
    parts = list(parts_of(plan_job(job, config, "kernel").trajectory))
    assert [part.waits for part in parts] == [(), (UserCommand(3, 110, 2.0, None),)]
    [wait] = parts[1].waits
    assert request(wait, config.user_command) == "line 3: M110 P2: open the vise"


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ('[user_command.M10]\nrequest = "a"\n', "a user command is one of M100 to M199"),
        ('[user_command.M110]\nrequest = ""\n', "at least 1 character"),
        ("[user_command.M110]\n", "request"),
    ],
)
def test_a_broken_table_is_refused(table: str, words: str) -> None:
    with pytest.raises(MachineError) as refusal:
        parse_machine(f"{SHIPPED}\n{table}", "m.toml")
    assert words in str(refusal.value)
