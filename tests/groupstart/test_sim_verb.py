"""``groupstart sim``: its words and its end; what the ports do is tested in their own room."""

import os
from collections.abc import Callable
from typing import Any

import click
import pytest

from groupstart.stopflag import StopFlag

Cli = Callable[..., Any]


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[bool]:
    """Serve two turns only; note of every device that is told whether it is there at that moment."""
    turns = [0]
    found: list[bool] = []
    echo = click.echo

    def asked(self: StopFlag) -> bool:
        turns[0] += 1
        return turns[0] > 2

    def told(message: str = "", **named: Any) -> None:
        if message.startswith("/dev/"):
            found.append(os.path.exists(message))
        echo(message, **named)

    monkeypatch.setattr(StopFlag, "__call__", asked)
    monkeypatch.setattr(click, "echo", told)
    return found


@pytest.mark.parametrize(("machine", "devices"), [("vspin", 1), ("mill3-indexer", 2)])
def test_the_first_lines_are_the_devices_and_a_signal_ends_it_well(
    machine: str, devices: int, cli: Cli, opened: list[bool]
) -> None:
    answer = cli("sim", "-m", machine, "--pty")
    assert answer.status == 0
    assert all(line.startswith("/dev/") for line in answer.out.splitlines())
    assert opened == [True] * devices
    assert answer.out.count("\n") == devices
    assert answer.err == "0 violations\n"


def test_without_pty_it_is_a_usage_error(cli: Cli) -> None:
    assert cli("sim", "-m", "vspin").status == 2
