"""Where the tests of streaming find the paths and the rig of the benchmark."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from benchmarks.paths import ClosedForm, circle, helix, line, random_path, rounded_square
from benchmarks.rig import Conditions, Outcome, bring_up, stream

__all__ = [
    "ClosedForm",
    "Conditions",
    "Outcome",
    "bring_up",
    "circle",
    "helix",
    "line",
    "random_path",
    "rounded_square",
    "stream",
]
