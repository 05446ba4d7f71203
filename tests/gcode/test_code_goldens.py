"""Every code that the interpreter knows is executed by a program that has a golden canonical text."""

from functools import cache
from pathlib import Path

import pytest

from gcode import run
from gcode.canontext import canon_lines
from gcode.codes import G_GROUP_OF, M_GROUP_OF, g_name
from gcode.dialects import DIALECTS
from gcode.foreigngroups import MACRO_GROUPS, TRANSFORM_GROUPS
from gcode.interp import interpret
from gcode.setup import Setup

GOLDENS = Path(__file__).parent.parent / "goldens"
LINUXCNC = sorted(path for path in (GOLDENS / "canon").iterdir() if path.suffix in {".ngc", ".nc"})
DIALECT_FILES = sorted(path for path in (GOLDENS / "dialects").iterdir() if path.suffix == ".nc")
SETUP = Setup(block_delete=frozenset())


class Watched(run.Run):
    """A run that keeps the codes of its lines."""

    def __init__(self, text, setup):
        super().__init__(text, setup)
        self.codes = set()

    def may_run_columns(self):
        return False

    def _execute(self, line):
        block = super()._execute(line)
        for word in line.words:
            if isinstance(word.value, float) and word.letter in "gm":
                name = g_name(round(word.value * 10)) if word.letter == "g" else f"M{word.value:g}"
                self.codes.add(name)
        return block


@cache
def executed():
    """The codes that the programs with goldens execute, and what was wrong with them."""
    codes, errors = set(), []
    for path in (*LINUXCNC, *DIALECT_FILES):
        watched = Watched(path.read_text(), Setup(dialect=path.stem) if path in DIALECT_FILES else SETUP)
        for _ in watched.stream():
            pass
        codes |= watched.codes
        errors += [d for d in watched.diagnostics if d.severity == "error"]
    return codes, errors


G_CODES = [g_name(code) for code in sorted({*G_GROUP_OF, *TRANSFORM_GROUPS, *MACRO_GROUPS, 541})]
M_CODES = [f"M{code}" for code in sorted({*M_GROUP_OF, 97}) if code <= 100]


@pytest.mark.parametrize("code", [*G_CODES, *M_CODES])
def test_has_a_golden(code):
    assert code in executed()[0]


def test_no_golden_contains_an_error():
    assert executed()[1] == []


@pytest.mark.parametrize("path", DIALECT_FILES, ids=lambda path: path.stem)
def test_dialect_equals_golden(path):
    result = interpret(path.read_text(), Setup(dialect=path.stem))
    assert list(canon_lines(result.commands)) == path.with_suffix(".nc.canon").read_text().splitlines()


def test_every_dialect_that_adds_codes_has_a_golden():
    names = {name for name, dialect in DIALECTS.items() if dialect.lenient}
    assert {path.stem for path in DIALECT_FILES} == names
