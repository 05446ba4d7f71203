"""End points equal LinuxCNC's rs274 to nine decimals (pytest -m oracle).

Its canonical text has four decimals, but its PRINT shows parameters with up to nine: the position after each line.
"""

import importlib.util
import shutil
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcode.canon import Printed

pytestmark = [
    pytest.mark.oracle,
    pytest.mark.skipif(shutil.which("rs274") is None, reason="rs274 is not installed"),
]
HERE = Path(__file__).parent
PRINT = "(PRINT,%.9f#5420 #5421 #5422 #5423)"


def load(name):
    spec = importlib.util.spec_from_file_location(f"gcode_fine_{name}", HERE / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


oracle, grammar = load("conftest"), load("grammar")
PARTS = st.one_of(
    *(grammar.straight(), grammar.arc(), grammar.arc(), grammar.offset(), grammar.offset(), grammar.reference()),
    *(grammar.cycle(), grammar.assignment(), grammar.polar(), grammar.modes()),
)


@st.composite
def program(draw):
    lines = ["G21 G90 G17 G94 F500 S1000 M3", "G0 X1 Y2 Z3"]
    for block in draw(st.lists(PARTS, min_size=3, max_size=12)):
        for line in block:
            lines += [line, PRINT]
    return "\n".join([*lines, "M2", ""])


def values(lines):
    return [float(word) for line in lines for word in line.split()]


@settings(max_examples=150, derandomize=True, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(program())
def test_positions_are_equal_to_nine_decimals(text):
    result = oracle.interpret(text, oracle.INCH_SETUP)
    with tempfile.TemporaryDirectory() as folder:
        theirs = oracle.run_rs274(text, Path(folder))
    assert (not result.errors) == theirs.ok
    if theirs.ok:
        ours = values(command.function for command in result.commands if isinstance(command, Printed))
        expected = values(line for line in theirs.lines if not line.startswith("N"))
        assert len(ours) == len(expected)
        assert ours == pytest.approx(expected, abs=1.1e-9, rel=1e-12), text
