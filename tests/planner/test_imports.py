"""Slow libraries are loaded only when they are needed."""

import subprocess
import sys

import pytest

SLOW = ("toppra", "numba", "matplotlib", "scipy", "ruckig")


def loaded(code: str) -> set[str]:
    check = f"{code}\nimport sys\nprint([m for m in {SLOW!r} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    return set(eval(out.stdout.splitlines()[-1]))


def test_importing_the_planner_loads_none_of_them():
    assert loaded("import planner.plan, planner.point, planner.compensation, planner.turns") == set()


def test_the_kernel_needs_numba_alone():
    code = (
        "import numpy as np\nfrom gcode import canon\nfrom planner.plan import plan\nfrom planner.types import Limits\n"
        "plan([canon.Feed(1, (5.0,) + (0.0,) * 8, 10.0)], Limits(('X',), np.ones(1), np.ones(1), 0.01), "
        "start=np.zeros(1), solver='kernel')"
    )
    assert loaded(code) - {"scipy"} == {"numba"}  # numba may look at scipy on its own


@pytest.mark.parametrize("verb", ["plan", "check"])
def test_help_of_the_command_line_loads_none_of_them(verb):
    code = (
        "import contextlib\nfrom groupstart.cli import main\n"
        f"with contextlib.suppress(SystemExit):\n    main(['{verb}', '--help'])"
    )
    assert loaded(code) == set()
