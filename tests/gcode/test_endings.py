"""How a program may end, and what the canonical text shows then: as LinuxCNC's rs274 prints it."""

import shutil

import pytest

BODY = "G21 G90 F100\nG1 X1\n"
STOPPED = ["SET_FEED_RATE", "STOP_SPINDLE_TURNING", "SET_SPINDLE_MODE"]
RESETS = ["ON_RESET", "ON_RESET"]
ENDINGS = {
    "M2": (BODY + "M2\n", [*STOPPED, "PROGRAM_END", *RESETS]),
    "M2 without a line end": (BODY + "M2", [*STOPPED, "PROGRAM_END", *RESETS]),
    "M30": (BODY + "M30\n", [*STOPPED, "PALLET_SHUTTLE", "PROGRAM_END", *RESETS]),
    "M99": (BODY + "M99\n", [*STOPPED, "PROGRAM_END", *RESETS]),
    "percent": ("%\n" + BODY + "%\n", ["STRAIGHT_FEED", "FINISH", *RESETS]),
    "percent and an O-word": ("%\n" + BODY + "o1 if [0]\no1 endif\n%\nG7777\n", ["STRAIGHT_FEED", "FINISH", *RESETS]),
    "M2 and percent": ("%\n" + BODY + "M2\n%\n", [*STOPPED, "PROGRAM_END", *RESETS]),
    "M2, percent missing": ("%\n" + BODY + "M2\n", [*STOPPED, "PROGRAM_END", "COMMENT", *RESETS]),
    "nothing": (BODY, ["STRAIGHT_FEED", *RESETS]),
    "percent missing": ("%\n" + BODY, ["STRAIGHT_FEED", *RESETS]),
}


def names(lines, count):
    return [line.partition(" ")[2].partition("(")[0] for line in lines][-count:]


@pytest.mark.parametrize("ending", ENDINGS)
def test_what_is_printed_last(ending, canon):
    text, expected = ENDINGS[ending]
    assert names(canon.ours(text), len(expected)) == expected


@pytest.mark.oracle
@pytest.mark.skipif(shutil.which("rs274") is None, reason="rs274 is not installed")
@pytest.mark.parametrize("ending", ENDINGS)
def test_as_the_oracle(ending, canon, rs274):
    text, _ = ENDINGS[ending]
    assert names(canon.ours(text), 99) == names(rs274(text).lines, 99)
