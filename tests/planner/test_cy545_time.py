"""The planner's closed form against the simulated chip: every move's time and place."""

import numpy as np
import pytest

from nmc.chips import cy545 as facts
from nmc.cy545 import Cy545
from planner.cy545 import Indexer, RampSettings, choose, profile
from planner.errors import PlanError
from sim.build import Simulation, build
from sim.cy545_line import Cy545Link
from sim.cy545_spec import Cy545Port
from tests_cy545 import stand_in  # type: ignore[import-not-found]
