"""Ctrl-C during a run: the motion is stopped first, then the program ends with status 2, and the folder tells."""

import json
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groupstart.progress import RunProgress
from groupstart.stopflag import StopFlag

Cli = Callable[..., Any]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_stops_the_motion_then_the_program(
    number: signal.Signals, root: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = [0]

    def press(self: RunProgress, progress: object) -> None:
        shown[0] += 1
        if shown[0] == 30:
            signal.raise_signal(number)

    monkeypatch.setattr(RunProgress, "__call__", press)
    handlers = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    answer = cli("run", str(root / "examples" / "01_compass.nc"), "--runs", str(tmp_path))
    assert answer.status == 2
    assert "stopped on request in line" in answer.err
    assert "every motor stands" in answer.err
    assert "Traceback" not in answer.err
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == handlers
    [folder] = tmp_path.iterdir()
    journal = [json.loads(line) for line in (folder / "journal.jsonl").read_text().splitlines()]
    stopped = next(record for record in journal if record["event"] == "all_stopped")
    with np.load(folder / "trace.npz") as trace:
        steps = trace["start_steps"].copy()
        np.add.at(steps, trace["run_axis"], trace["run_dir"].astype(np.int64) * trace["run_count"])
        assert dict(zip("XYZ", steps.tolist(), strict=True)) == stopped["positions"]
    verdict = json.loads((folder / "verdict.json").read_text())
    assert verdict["ok"] is False
    assert "stopped on request" in verdict["reasons"][0]
    assert (folder / "path.png").exists()


def test_a_second_signal_interrupts_at_once() -> None:
    with StopFlag() as stop:
        assert not stop()
        signal.raise_signal(signal.SIGINT)
        assert stop()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)


def full(*_: object, **__: object) -> None:
    raise OSError(28, "No space left on device")


@pytest.mark.parametrize("what", ["note", "write_json", "mkdir"])
def test_a_full_disk_is_told_with_status_2(
    what: str, root: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    from machines.rundir import RunFolder

    if what == "mkdir":
        monkeypatch.setattr(RunFolder, "create", full)
    else:
        monkeypatch.setattr(RunFolder, what, full)
    answer = cli("run", str(root / "examples" / "01_compass.nc"), "--runs", str(tmp_path))
    assert answer.status == 2
    assert "No space left on device" in answer.err
    assert "Traceback" not in answer.err


def test_a_run_whose_files_the_disk_refuses_still_tells_its_verdict(
    root: Path, tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch
) -> None:
    from sim.trace import Trace

    monkeypatch.setattr(Trace, "save", full)
    answer = cli("run", str(root / "examples" / "01_compass.nc"), "--runs", str(tmp_path))
    assert answer.status == 2
    assert "GO:" in answer.out
    [folder] = tmp_path.iterdir()
    assert f"{folder / 'trace.npz'}: No space left on device" in answer.err
    assert json.loads((folder / "verdict.json").read_text())["ok"] is True


def test_a_file_that_cannot_be_written_is_named(tmp_path: Path, cli: Cli) -> None:
    job = str(tmp_path / "small.nc")
    Path(job).write_text("G21 G90 F600\nG1 X1\nM2\n")
    for words in (("plan", job, "-o", "/dev/full"), ("canon", job, "-o", "/dev/full")):
        answer = cli(*words)
        assert answer.status == 2
        assert answer.err.endswith("/dev/full: No space left on device\n")
    answer = cli("verify", job, "--trace", "/dev/full")
    assert answer.status == 2
    assert "GO:" in answer.out
    assert answer.err.endswith("/dev/full: No space left on device\n")


def test_a_trace_has_exactly_the_name_that_was_given(tmp_path: Path, cli: Cli) -> None:
    (tmp_path / "small.nc").write_text("G21 G90 F600\nG1 X1\nM2\n")
    answer = cli("verify", str(tmp_path / "small.nc"), "--trace", str(tmp_path / "out.trace"))
    assert answer.status == 0
    assert f"wrote {tmp_path / 'out.trace'}" in answer.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.trace", "small.nc"]
    with np.load(tmp_path / "out.trace") as trace:
        assert trace["run_count"].sum() == 200
