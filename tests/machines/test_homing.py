"""Homing on the twin: machine zero is where the mechanics have it, wherever the axis stood before."""

from typing import Any

import numpy as np
import pytest

from machines.load import parse_machine, read_machine
from machines.schema import MachineConfig
from machines.session import Session, SessionError, State


def machine(name: str, **edits: str) -> MachineConfig:
    text = read_machine(name).text
    for old, new in edits.items():
        assert old in text
        text = text.replace(old, new, 1)
    return parse_machine(text, f"{name}.toml")


def starting_at(name: str, start: float, edits: dict[str, str] | None = None) -> MachineConfig:
    return machine(name, **{"[sim.axis.X]\n": f"[sim.axis.X]\nstart_at = {start}\n", **(edits or {})})


def shaft(session: Session, config: MachineConfig) -> float:
    """Where the mechanics of X really are, in mm."""
    simulation = session.simulation
    assert simulation is not None
    module: Any = simulation.modules["X"]
    if config.axis["X"].chip == "pic-servo":
        return float(module.mechanical_counts) / config.axis["X"].counts_per_unit
    trace = simulation.trace()
    mine = trace.run_axis == trace.axes.index("X")
    moved = (trace.run_dir[mine].astype(np.int64) * trace.run_count[mine]).sum()
    twin = config.sim.axis["X"]
    return float(twin.start_at + moved / config.axis["X"].steps_per_unit)


@pytest.mark.parametrize("start", [0.0, 37.3, -5.9, -7.5, 90.0])
@pytest.mark.parametrize(("name", "exact_mm"), [("mill3-step", 0.0), ("mill3-servo", 0.0026)])
def test_an_axis_finds_machine_zero_from_anywhere(name: str, exact_mm: float, start: float) -> None:
    config = starting_at(name, start)
    with Session(config) as session:
        session.connect()
        [homed] = session.home(["X"])
        assert session.state is State.IDLE
        assert shaft(session, config) == pytest.approx(0, abs=exact_mm + 1e-9)
        assert abs(homed.spread_steps) <= 5
        assert session.simulation is not None
        assert session.simulation.violations == []


def test_a_motor_that_turns_the_other_way_homes_the_same_way() -> None:
    turned = {
        '"200 * 4 / 4"': '"-200 * 4 / 4"',
        "limit1_at = 118": "limit1_at = -8",
        "limit2_at = -8": "limit2_at = 118",
    }
    config = starting_at("mill3-step", 20, turned)
    with Session(config) as session:
        session.connect()
        session.home(["X"])
        assert shaft(session, config) == pytest.approx(0, abs=1e-9)


def test_a_switch_at_the_far_end() -> None:
    edits = {'switch = "home"': 'switch = "limit1"', '"negative"': '"positive"', "position = -6": "position = 118"}
    config = starting_at("mill3-step", 60, edits)
    with Session(config) as session:
        session.connect()
        session.home(["X"])
        assert shaft(session, config) == pytest.approx(0, abs=1e-9)


def test_a_switch_that_never_comes_is_told_and_the_motor_stands() -> None:
    config = starting_at("mill3-step", 20, {"home_at = -6 ": "# home_at = -6 ", "limit2_at = -8": ""})
    with Session(config) as session:
        session.connect()
        with pytest.raises(SessionError, match=r"homing X: .*did not change within"):
            session.home(["X"])
        assert session.state is State.FAULTED
        link = session.connection.links[0]
        before = shaft(session, config)
        link.sleep_until(link.now_ns() + 2_000_000_000)
        assert shaft(session, config) == before


def test_an_axis_without_a_home_table_is_refused() -> None:
    with Session(machine("mill3-step")) as session:
        session.connect()
        with pytest.raises(SessionError, match=r"no \[axis\.Y\.home\]"):
            session.home(["Y"])
