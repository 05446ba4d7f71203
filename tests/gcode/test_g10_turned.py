"""G10 L2 R turns a system while a G92 shift is in force: the machine stands where it stood, in new coordinates.

LinuxCNC's rs274 leaves the shift out when it finds the new coordinates, so that its next move of one axis moves the
other as well; here a move of X leaves Y alone.
"""

import math

import pytest

from gcode import canon
from gcode.interp import Setup, interpret


def ends(text: str) -> list[tuple[float, float]]:
    stream = interpret(text, Setup(file="turned.ngc")).stream
    return [command.end[:2] for command in stream if isinstance(command, canon.Rapid)]


@pytest.mark.parametrize("shift", ["G92 X0", "G52 X10", ""])
def test_a_move_along_one_turned_axis_leaves_the_other_coordinate_alone(shift: str) -> None:
    first, second = ends(f"G21 G90\nG0 X10 Y5\n{shift}\nG10 L2 P0 R45\nG91 G0 X1\nM2\n")
    assert first == pytest.approx((10, 5))
    assert second == pytest.approx((10 + math.sqrt(0.5), 5 + math.sqrt(0.5)))
