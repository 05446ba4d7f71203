"""The doors of the house: who may read the clock, open a port, throw dice."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def doors() -> ModuleType:
    spec = importlib.util.spec_from_file_location("doors", ROOT / ".ci" / "doors.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_clock_port_and_die_is_behind_its_door(doors: ModuleType) -> None:
    assert list(doors.breaks(ROOT)) == []


@pytest.mark.parametrize(
    "line",
    [
        "import time",
        "from time import sleep",
        "import serial",
        "import random",
        "import datetime\nx = datetime.datetime.now()",
        "import numpy as np\nx = np.random.default_rng(3)",
    ],
)
def test_a_break_is_found(line: str, doors: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "planner").mkdir()
    (tmp_path / "planner" / "new.py").write_text(line + "\n")
    [found] = doors.breaks(tmp_path)
    assert found.startswith("planner/new.py:")


def test_the_doors_themselves_may(doors: ModuleType, tmp_path: Path) -> None:
    (tmp_path / "nmc").mkdir()
    (tmp_path / "nmc" / "serial_link.py").write_text("import time\nimport serial\n")
    assert list(doors.breaks(tmp_path)) == []
