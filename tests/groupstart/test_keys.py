"""Keys of a running program on a terminal of its own, and the terminal as it was afterwards, whatever happens."""

import json
import os
import re
import signal
import termios
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from groupstart import keys as keys_module
from groupstart.keys import Keys
from groupstart.progress import RunProgress, rate_words
from machines.control import RateStatus, Request

Cli = Callable[..., Any]


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """(the person's end, the program's end) of a terminal."""
    person, program = os.openpty()
    yield person, program
    for end in (person, program):
        try:
            os.close(end)
        except OSError:
            continue


def line_mode(program: int) -> bool:
    return bool(termios.tcgetattr(program)[3] & termios.ICANON)


def taken(keys: Keys) -> list[Request]:
    found = []
    while (request := keys.take(0.0)) is not None:
        found.append(request)
    return found


def test_every_key_asks_for_what_the_help_says(terminal: tuple[int, int]) -> None:
    person, program = terminal
    with Keys(program) as keys:
        os.write(person, b" x++-<<> 0q")
        assert taken(keys) == [
            Request("hold"), Request("feed", 110.0), Request("feed", 120.0), Request("feed", 110.0),
            Request("rapid", 90.0), Request("rapid", 80.0), Request("rapid", 90.0), Request("resume"),
            Request("feed", 100.0), Request("rapid", 100.0), Request("stop"),
        ]  # fmt: skip
        os.write(person, b"hr" + b"-" * 12 + b">")
        *_, slow, rapid = taken(keys)
        assert (slow, rapid) == (Request("feed", 10.0), Request("rapid", 100.0))


def test_the_space_bar_follows_the_state_of_the_machine(terminal: tuple[int, int]) -> None:
    person, program = terminal
    with Keys(program) as keys:
        os.write(person, b" ")
        assert taken(keys) == [Request("hold")]
        keys.told(RateStatus(refused="cannot"))
        os.write(person, b" ")
        assert taken(keys) == [Request("hold")]
        keys.told(RateStatus("held"))
        os.write(person, b" ")
        assert taken(keys) == [Request("resume")]


@pytest.mark.parametrize("error", [None, ValueError, KeyboardInterrupt, SystemExit])
def test_the_terminal_is_put_back(terminal: tuple[int, int], error: type[BaseException] | None) -> None:
    _, program = terminal
    before = termios.tcgetattr(program)
    with nullcontext() if error is None else pytest.raises(error), Keys(program) as keys:
        assert not line_mode(program)
        with keys.aside():
            assert line_mode(program)
        assert not line_mode(program)
        if error is not None:
            raise error
    assert termios.tcgetattr(program) == before


def test_a_terminal_that_goes_away_ends_the_keys_and_nothing_else(terminal: tuple[int, int]) -> None:
    person, program = terminal
    with Keys(program) as keys:
        os.close(person)
        assert keys.take(0.0) is None
        assert not keys.listening
        keys.hold()
        assert keys.take(0.0) == Request("hold")


def test_without_a_terminal_there_are_no_keys(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w+") as file, Keys(file.fileno()) as keys:
        assert not keys.listening
        assert keys.take(0.0) is None


def test_a_program_is_held_slowed_and_goes_on_by_its_keys(
    terminal: tuple[int, int], root: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    person, program = terminal
    before = termios.tcgetattr(program)
    monkeypatch.setattr(keys_module, "_standard_input", lambda: program)
    shown, seen = [0], []

    def look(self: RunProgress, progress: object) -> None:
        shown[0] += 1
        if shown[0] in (10, 25):
            os.write(person, b" " if shown[0] == 10 else b"--")

    def show(self: RunProgress, status: RateStatus) -> None:
        seen.append(rate_words(status))
        if status.state == "held":
            os.write(person, b" ")

    monkeypatch.setattr(RunProgress, "__call__", look)
    monkeypatch.setattr(RunProgress, "show", show)
    answer = cli("run", str(root / "examples" / "01_compass.nc"), "--runs", str(tmp_path))
    assert answer.status == 0, answer.err
    assert "keys: space hold/resume" in answer.err
    assert seen[0] == ""
    assert re.fullmatch(r"holding: rest in 0\.\d\d s, \d\.\d\d mm", seen[1])
    assert seen[2:] == ["HELD", "", "feed 90 %", "feed 80 %"]
    assert termios.tcgetattr(program) == before
    [folder] = tmp_path.iterdir()
    verdict = json.loads((folder / "verdict.json").read_text())
    assert len(verdict["holds"]) == 1
    assert verdict["holds"][0]["measured_s"] > 0
    events = [json.loads(line)["event"] for line in (folder / "journal.jsonl").read_text().splitlines()]
    assert [each for each in events if each in ("hold", "held", "resume", "override")] == [
        "hold", "held", "resume", "override", "override",
    ]  # fmt: skip
    assert "hold" in answer.out


@pytest.mark.parametrize("how", ["q", "SIGTERM"])
def test_stopped_by_a_key_or_a_signal_the_terminal_is_put_back(
    how: str, terminal: tuple[int, int], root: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    person, program = terminal
    before = termios.tcgetattr(program)
    monkeypatch.setattr(keys_module, "_standard_input", lambda: program)
    shown = [0]

    def look(self: RunProgress, progress: object) -> None:
        shown[0] += 1
        if shown[0] == 10:
            if how == "q":
                os.write(person, b"q")
            else:
                signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(RunProgress, "__call__", look)
    answer = cli("run", str(root / "examples" / "01_compass.nc"), "--runs", str(tmp_path))
    assert answer.status == 2
    assert "stopped on request in line" in answer.err
    assert termios.tcgetattr(program) == before
