"""PIC-STEP data sheet, Table 4, cell by cell on the simulated chip: what is executed and what is refused."""

import pytest

from sim.rawhost import i32, steppers
from sim.spec import SimOptions

item = pytest.mark.item
COUNT = (64000).to_bytes(2, "little")
FAR = 1_000_000

# mode: (control byte bits 0-3, data) that brings the chip there from Stopped
ENTER = {
    "stopped": None,
    "trapezoid": (0x07, i32(FAR) + bytes([100, 1])),
    "velocity": (0x06, bytes([100, 1])),
    "with stop": (0x09, i32(FAR) + COUNT + bytes([50])),
    "no stop": (0x08, COUNT + bytes([50])),
}
# Table 4: (number, goal, start): what may be loaded, control bits that must and may be there; None: not allowed
NOT = None
CELLS = [
    ("ST-171", "trapezoid", "stopped", (0x01, 0x06)),
    ("ST-172", "trapezoid", "trapezoid", NOT),
    ("ST-173", "trapezoid", "velocity", NOT),
    ("ST-174", "trapezoid", "with stop", NOT),
    ("ST-175", "trapezoid", "no stop", NOT),
    ("ST-176", "velocity", "stopped", (0x00, 0x06)),
    ("ST-178", "velocity", "velocity", (0x00, 0x06)),
    ("ST-179", "velocity", "with stop", (0x00, 0x06)),
    ("ST-180", "velocity", "no stop", (0x00, 0x06)),
    ("ST-181", "with stop", "stopped", (0x09, 0x00)),
    ("ST-182", "with stop", "trapezoid", (0x08, 0x00)),
    ("ST-183", "with stop", "velocity", NOT),
    ("ST-184", "with stop", "with stop", (0x08, 0x00)),
    ("ST-185", "with stop", "no stop", NOT),
    ("ST-186", "no stop", "stopped", (0x08, 0x00)),
    ("ST-187", "no stop", "trapezoid", NOT),
    ("ST-188", "no stop", "velocity", (0x08, 0x00)),
    ("ST-189", "no stop", "with stop", NOT),
    ("ST-190", "no stop", "no stop", (0x08, 0x00)),
]
# what a load asks for, whatever the chip is doing (section 5.1: the mode is determined by which data is loaded)
ASKS = {"trapezoid": 0x01, "velocity": 0x02, "with stop": 0x09, "no stop": 0x08}
BITS = {"trapezoid": 0x40, "velocity": 0x20, "with stop": 0x10, "no stop": 0x10}


def data_of(loaded, goal=2 * FAR, count=64500):
    fields = [i32(goal), bytes([120]), bytes([2]), count.to_bytes(2, "little") + bytes([60])]
    return b"".join(f for k, f in enumerate(fields) if loaded >> k & 1)


def running(mode, **options):
    sim, host, chips = steppers(mode=0, **options)
    if ENTER[mode] is not None:
        control, data = ENTER[mode]
        host.exchange(1, 0x4, [control | 0x80, *data])
        host.wait_ms(200)
        assert chips[0].moving
    return sim, host, chips[0]


def mode_now(host):
    status = host.status(1)
    if not status & 0x01:
        return "stopped"
    for bit, name in ((0x20, "velocity"), (0x40, "trapezoid")):
        if status & bit:
            return name
    return "count"


def allowed(cell):
    must, may = cell
    extras = [0] + [b for b in (1, 2, 4, 8) if may & b] + ([may] if may else [])
    return sorted({must | extra for extra in extras})


@pytest.mark.parametrize(
    ("start", "goal", "loaded"),
    [
        pytest.param(start, goal, loaded, marks=item(number), id=f"{number}-{loaded:X}")
        for number, goal, start, cell in CELLS
        if cell is not NOT
        for loaded in allowed(cell)
    ],
)
def test_allowed_cells(start, goal, loaded):
    """Each tick of Table 4, with every choice of what may optionally be loaded, is executed without complaint."""
    sim, host, _ = running(start)
    host.exchange(1, 0x4, [loaded | 0x80, *data_of(loaded)])
    host.wait_ms(100)
    assert mode_now(host) == {"with stop": "count", "no stop": "count"}.get(goal, goal)
    # nothing was loaded into a fresh chip: acceleration 0 is brought into its range
    assert set(sim.rules()) <= {"X-73", "ST-155"}


def loads_that_ask_for(goal, start):
    """Loads whose data select ``goal`` when sent in mode ``start``, and that the cell does not allow."""
    if goal == "trapezoid":
        return [0x01, 0x03, 0x07]
    if goal == "with stop":
        return [0x09] if start in ("velocity", "no stop") else [0x09, 0x0B]
    return []


@pytest.mark.parametrize(
    ("start", "goal", "loaded", "number"),
    [
        pytest.param(start, goal, loaded, number, marks=item(number, "X-60"), id=f"{number}-{loaded:X}")
        for number, goal, start, cell in CELLS
        if cell is NOT
        for loaded in loads_that_ask_for(goal, start)
    ],
)
def test_forbidden_cells(start, goal, loaded, number):
    """'Not Allowed' of Table 4. Choice X-60: the load is ignored at execution, the motion unchanged, logged."""
    sim, host, chip = running(start)
    mode, period = chip.timer.mode, chip.timer.reload_period
    host.exchange(1, 0x4, [loaded | 0x80, *data_of(loaded)])
    host.wait_ms(5)
    chip.synchronise()
    assert chip.timer.mode == mode
    assert chip.timer.reload_period == period
    assert sim.rules() == [number]


@item("ST-187")
@item("ST-189")
@pytest.mark.parametrize("start", ["trapezoid", "with stop"])
def test_no_stop_cannot_be_entered_from_a_mode_with_a_goal(start):
    """Table 4: Unprofiled Velocity No Stop from these is not allowed; a count alone keeps the stop position."""
    sim, host, chip = running(start)
    host.exchange(1, 0x4, [0x88, *data_of(0x08)])
    host.wait_ms(5)
    assert chip.timer.stop_position == FAR
    assert sim.violations == []


@item("ST-177")
@item("X-20")
def test_velocity_from_trapezoid():
    """Table 4 prints 'load timer count' here, but a count selects an unprofiled mode. Choice: refused and logged."""
    sim, host, _ = running("trapezoid")
    host.exchange(1, 0x4, [0x86, 120, 2])
    host.wait_ms(5)
    assert mode_now(host) == "trapezoid"
    assert sim.rules() == ["X-20"]


@pytest.mark.parametrize(
    ("start", "loaded", "number"),
    [
        pytest.param("stopped", 0x0B, "ST-181", marks=item("ST-181")),
        pytest.param("stopped", 0x0D, "ST-181", marks=item("ST-181")),
        pytest.param("stopped", 0x0A, "ST-186", marks=item("ST-186")),
        pytest.param("trapezoid", 0x09, "ST-182", marks=item("ST-182")),
        pytest.param("with stop", 0x09, "ST-184", marks=item("ST-184")),
        pytest.param("with stop", 0x0C, "ST-184", marks=item("ST-184")),
        pytest.param("velocity", 0x0A, "ST-188", marks=item("ST-188")),
        pytest.param("no stop", 0x0A, "ST-190", marks=item("ST-190")),
    ],
)
def test_do_not_load_this_parameter(start, loaded, number):
    """The crosses of Table 4: above all, no stop position while moving."""
    sim, host, chip = running(start)
    before = (chip.timer.mode, chip.timer.stop_position, chip.timer.reload_period)
    host.exchange(1, 0x4, [loaded | 0x80, *data_of(loaded)])
    host.wait_ms(5)
    chip.synchronise()
    assert (chip.timer.mode, chip.timer.stop_position, chip.timer.reload_period) == before
    assert sim.rules() == [number]


@item("ST-132")
@item("ST-192")
def test_a_count_alone_keeps_the_stop_while_moving_and_has_none_from_rest():
    """Derived from Table 4: the same load means 'keep the stop position' in motion, 'run for ever' from rest."""
    sim, host, chip = running("stopped")
    host.exchange(1, 0x4, [0x89, *i32(300), *COUNT, 50])
    host.wait_ms(20)
    host.exchange(1, 0x4, [0x88, *data_of(0x08)])
    host.wait_ms(500)
    assert host.position(1) == 300
    assert not chip.moving
    host.exchange(1, 0x4, [0x88, *data_of(0x08)])
    host.wait_ms(500)
    assert host.position(1) > 1000
    assert sim.violations == []


@item("ST-191")
def test_a_stop_position_is_inherited_from_a_trapezoid():
    """Derived from Table 4: unprofiled with stop from a trapezoid loads no position, so the goal stays."""
    sim, host, _chip = running("stopped")
    host.exchange(1, 0x4, [0x87, *i32(3000), 50, 1])
    host.wait_ms(100)
    host.exchange(1, 0x4, [0x88, *data_of(0x08)])
    host.wait_ms(1000)
    assert host.position(1) == 3000
    assert sim.violations == []


@item("X-64")
@pytest.mark.parametrize("polite", [False, True])
def test_reached_stop_counts_as_stopped(polite):
    """Choice: yes; a reversal is logged unless a Stop Motor was sent, going on in the same direction is not."""
    sim, host, _ = running("stopped")
    host.exchange(1, 0x4, [0x89, *i32(100), *COUNT, 50])
    host.wait_ms(200)
    host.exchange(1, 0x4, [0x89, *i32(200), *COUNT, 50])
    host.wait_ms(200)
    assert host.position(1) == 200
    assert sim.violations == []
    if polite:
        host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x4, [0x99, *i32(50), *COUNT, 50])
    host.wait_ms(200)
    assert host.position(1) == 50
    assert sim.rules() == ([] if polite else ["X-64"])


@item("X-64")
def test_the_other_reading_of_a_reached_stop():
    """Option: the chip is still in with-stop mode there, so a new position needs a Stop Motor first."""
    sim, host, _ = running("stopped", options=SimOptions(reached_stop_is_stopped=False))
    host.exchange(1, 0x4, [0x89, *i32(100), *COUNT, 50])
    host.wait_ms(200)
    host.exchange(1, 0x4, [0x89, *i32(200), *COUNT, 50])
    host.wait_ms(200)
    assert host.position(1) == 100
    assert sim.rules() == ["ST-184"]
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x4, [0x89, *i32(200), *COUNT, 50])
    host.wait_ms(200)
    assert host.position(1) == 200
