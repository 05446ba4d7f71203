"""The canonical text of every program in goldens/canon equals its golden; the goldens come from LinuxCNC's rs274."""

import shutil
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "goldens" / "canon"
PROGRAMS = sorted(path.name for path in FOLDER.iterdir() if path.suffix in {".ngc", ".nc"})


def differences(ours, theirs, same):
    return [(a, b) for a, b in zip(ours, theirs, strict=False) if not same(a, b)][:3] or len(ours) - len(theirs)


@pytest.mark.parametrize("name", PROGRAMS)
def test_text_equals_golden(name, canon):
    text = (FOLDER / name).read_text()
    golden = [canon.plain(line) for line in (FOLDER / f"{name}.canon").read_text().splitlines()]
    assert not differences(canon.ours(text), golden, canon.same)


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("rs274") is None, reason="rs274 is not installed")
@pytest.mark.parametrize("name", PROGRAMS)
def test_golden_is_what_rs274_says(name, canon, rs274):
    golden = [canon.plain(line) for line in (FOLDER / f"{name}.canon").read_text().splitlines()]
    assert not differences(golden, rs274((FOLDER / name).read_text()).lines, canon.same)
