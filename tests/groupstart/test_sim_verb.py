"""``groupstart sim``: its words and its end; what the port does is tested in its own room."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from groupstart.stopflag import StopFlag

Cli = Callable[..., Any]


def test_the_first_line_is_the_device_and_a_signal_ends_it_well(cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    turns = [0]
    opened: list[bool] = []

    def asked(self: StopFlag) -> bool:
        turns[0] += 1
        return turns[0] > 2

    monkeypatch.setattr(StopFlag, "__call__", asked)
    monkeypatch.setattr("click.echo", _listening("click.echo", opened))
    answer = cli("sim", "-m", "vspin", "--pty")
    assert answer.status == 0
    assert answer.out.startswith("/dev/")
    assert answer.out.count("\n") == 1
    assert opened == [True]
    assert answer.err == "0 violations\n"


def _listening(name: str, opened: list[bool]) -> Callable[..., None]:
    """``click.echo`` that also looks whether the device is there when its name is told."""
    import click

    echo = click.echo

    def told(message: str = "", **named: Any) -> None:
        if message.startswith("/dev/"):
            opened.append(os.path.exists(message))
        echo(message, **named)

    return told


def test_a_machine_of_several_buses_has_no_single_port(root: Path, tmp_path: Path, cli: Cli) -> None:
    text = (root / "machines" / "data" / "mill3-step.toml").read_text()
    path = tmp_path / "two.toml"
    path.write_text(text.replace("[axis.X]", "[bus.second]\n\n[axis.X]", 1))
    answer = cli("sim", "-m", str(path), "--pty")
    assert answer.status == 2
    assert "one bus" in answer.err


def test_without_pty_it_is_a_usage_error(cli: Cli) -> None:
    assert cli("sim", "-m", "vspin").status == 2
