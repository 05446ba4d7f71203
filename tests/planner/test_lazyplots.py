"""Importing toppra must not cost the import of pyplot, nor leave anything in its place."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import sys
import planner.reference
assert not [name for name in sys.modules if name.partition(".")[0] == "matplotlib"]
import toppra.parametrizer
import matplotlib.pyplot as pyplot
assert toppra.parametrizer.plt.figure is pyplot.figure
assert type(pyplot) is type(sys)
print("fine")
"""


def test_toppra_comes_without_matplotlib_and_finds_it_when_it_plots() -> None:
    told = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    assert (told.stdout, told.stderr) == ("fine\n", "")


def test_a_matplotlib_that_is_there_is_used() -> None:
    code = "import sys, matplotlib.pyplot as p, planner.reference, toppra.parametrizer as t; print(t.plt is p)"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout == "True\n"
