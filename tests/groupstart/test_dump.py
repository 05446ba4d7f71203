"""``groupstart dump`` of what a run has left."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Cli = Callable[..., Any]

RECORD = """# host and modules, as a bus record has them
1000000 > aa 01 21 01 ff 22
1900000 < 08 08
2000000 > aa 01 13 20 34
2900000 < 08 03 01 0c
3000000 > aa 01 44 08 22 fb 14 7e
3900000 < 08 09
"""


@pytest.fixture
def folder(tmp_path: Path, cli: Cli) -> Path:
    program = tmp_path / "short.nc"
    program.write_text("G21 G90\nG1 X2 Y1 F1200\nG1 X0\nM2\n")
    assert cli("run", str(program), "--runs", str(tmp_path / "runs"), "--json").status == 0
    [made] = (tmp_path / "runs").iterdir()
    return made


def test_a_run_folder_and_its_trace_read_the_same(folder: Path, cli: Cli) -> None:
    whole = cli("dump", str(folder))
    assert whole.status == 0
    assert whole.out == cli("dump", str(folder / "trace.npz")).out
    for words in ("set_address individual=1", "set_parameters speed_mode=2", "load_trajectory", "position=400"):
        assert words in whole.out
    times = [float(line.split()[0]) for line in whole.out.splitlines() if line[:1] == " " and line.split()[1] in "<>"]
    assert times[0] < times[-1]


def test_a_bus_record_from_a_file_and_from_stdin(tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "bus.txt"
    path.write_text(RECORD)
    answer = cli("dump", str(path))
    assert answer.status == 0
    assert "1 set_address individual=1" in answer.out
    assert "load_trajectory timer_count=64290 nearest_speed=20" in answer.out
    assert "damaged answer" in answer.out
    monkeypatch.setattr("sys.stdin", io.StringIO(RECORD))
    assert cli("dump", "-").out == answer.out
    assert "damaged answer" in cli("dump", str(path), "--complaints").out


@pytest.mark.parametrize(
    ("content", "name", "status", "words"),
    [
        (b"1000 > zz\n", "bus.txt", 1, "line 1: expected"),
        (b"\xff\xfe", "bus.txt", 1, "not a bus record"),
        (b"no zip", "trace.npz", 1, "not a trace"),
        (None, "bus.txt", 2, "No such file"),
        (None, "trace.npz", 2, "No such file"),
        (None, ".", 2, "neither"),
    ],
)
def test_what_is_no_record(content: bytes | None, name: str, status: int, words: str, tmp_path: Path, cli: Cli) -> None:
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    answer = cli("dump", str(path))
    assert answer.status == status
    assert words in answer.err
    assert "Traceback" not in answer.err
