import json
from pathlib import Path

import pytest

from machines.rundir import RunFolder, safe_name


def test_the_journal_is_on_disk_line_by_line_while_the_run_goes_on(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path / "runs", "some job.nc") as folder:
        assert folder.path.parent == tmp_path / "runs"
        for number in range(3):
            folder.note("line", number, line=number)
            lines = (folder.path / "journal.jsonl").read_text().splitlines()
            assert json.loads(lines[-1]) == {"time_ns": number, "event": "line", "line": number}
            assert len(lines) == number + 1


def test_the_folders_name_is_time_and_job(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path, "/elsewhere/a b.nc") as first, RunFolder.create(tmp_path, "a b.nc") as second:
        date, clock, job = first.path.name.split("-", 2)
        assert (len(date), len(clock), job) == (8, 6, "a_b")
        assert second.path != first.path


def test_text_is_written_as_it_is(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path, "x") as folder:
        folder.write("job.nc", "G0 X1\r\nM2\r\n")
        assert (folder.path / "job.nc").read_bytes() == b"G0 X1\r\nM2\r\n"


def test_a_journal_that_can_be_written_no_more_is_told_once_and_stops_nothing(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path, "x") as folder:
        folder.note("line", 1)
        folder._journal.close()
        folder._journal = Path("/dev/full").open("w", encoding="utf-8")  # noqa: SIM115  # the folder closes it
        for number in range(3):
            folder.note("line", number)
        assert folder.troubles == [f"{folder.path / 'journal.jsonl'}: No space left on device"]


def test_what_the_disk_refuses_is_kept_as_a_trouble_with_the_files_name(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path, "x") as folder:
        (folder.path / "trace.npz").symlink_to("/dev/full")
        with pytest.raises(OSError, match="No space left") as caught:
            folder.write("trace.npz", "x")
        assert caught.value.filename == str(folder.path / "trace.npz")
        with folder.keep("trace.npz"):
            folder.write("trace.npz", "x")
        assert folder.troubles == [f"{folder.path / 'trace.npz'}: No space left on device"]


@pytest.mark.parametrize(
    ("job", "name"),
    [
        ("part.nc", "part"),
        ("../../etc/passwd", "passwd"),
        ("a/b c.ngc", "b_c"),
        ("...", "job"),
        ("", "job"),
        ("é.nc", "job"),
    ],
)
def test_a_jobs_name_cannot_leave_the_folder(job: str, name: str) -> None:
    assert safe_name(job) == name
