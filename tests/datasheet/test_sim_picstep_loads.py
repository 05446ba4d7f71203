"""The simulated PIC-STEP's Load Trajectory and Start Motion (data sheet 5.1)."""

import pytest

from sim.rawhost import i32, steppers
from sim.rawstep import gaps_ns, load_count, load_profile

item = pytest.mark.item


@item("ST-110", "ST-111", "ST-112", "ST-113", "ST-114", "ST-118")
@pytest.mark.parametrize("bits", range(16))
def test_load_length_follows_the_control_byte(bits):
    """ST 5.1: n = 1 + 4 position + 1 speed + 1 acceleration + 3 timer count, in that order, 1..10 bytes."""
    sim, host, (chip,) = steppers()
    fields = [i32(0x01020304), bytes([77]), bytes([9]), bytes([0x34, 0x12, 55])]
    data = bytes([bits]) + b"".join(f for k, f in enumerate(fields) if bits >> k & 1)
    assert len(data) == 1 + 4 * (bits & 1) + (bits >> 1 & 1) + (bits >> 2 & 1) + 3 * (bits >> 3 & 1)
    host.exchange(1, 0x4, data)
    host.wait_ms(1)
    load = chip.loads.last
    assert load.loaded == bits
    assert load.position == (0x01020304 if bits & 1 else 0)
    assert load.speed == (77 if bits & 2 else 0)
    assert load.acceleration == (9 if bits & 4 else 0)
    assert (load.count, load.nearest_speed) == ((0x1234, 55) if bits & 8 else (0, 0))
    assert sim.rules() == []


@item("ST-116")
def test_control_bits_5_and_6_should_be_zero():
    """ST 5.1: not used, clear to zero."""
    sim, host, _ = steppers()
    host.exchange(1, 0x4, [0x60])
    host.wait_ms(1)
    assert sim.rules() == ["ST-116"]


@item("ST-117", "ST-130", "ST-131")
def test_a_load_without_bit_7_has_no_effect_until_start():
    """ST 5.1: no effect whatsoever, and may be overwritten, until Start Motion; with bit 7 executed immediately."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=50, start=False)
    host.wait_ms(200)
    assert not chip.moving
    load_count(host, 65000, position=30, start=False)
    host.exchange(1, 0x5)
    host.wait_ms(1000)
    assert host.position(1) == 30
    load_count(host, 65000, position=60)
    host.wait_ms(1000)
    assert host.position(1) == 60
    assert sim.rules() == []


@item("ST-117", "ST-130")
def test_a_stop_position_loaded_in_motion_waits_for_a_start_at_rest():
    """ST 5.1: no effect whatsoever until Start Motion; table 4 allows it from Stopped, not while it runs."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=50)
    load_count(host, 64000, position=80, start=False)
    host.wait_ms(1000)
    assert host.position(1) == 50
    assert not chip.moving
    host.exchange(1, 0x5)
    load_count(host, 65000, position=90, start=False)
    host.wait_ms(1000)
    assert host.position(1) == 80
    assert sim.rules() == []
    host.exchange(1, 0x5)
    load_count(host, 65000, position=99, start=False)
    host.exchange(1, 0x5)  # too early: it runs
    host.wait_ms(1000)
    assert host.position(1) == 90
    assert sim.rules() == ["ST-184"]


@item("X-47")
def test_start_without_a_fresh_load_executes_the_last_one_again():
    """Choice: the worst case; a count-only load then runs for ever."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=20, start=False)
    host.exchange(1, 0x5)
    host.wait_ms(200)
    load_count(host, 65100)
    host.wait_ms(100)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x5)
    host.wait_ms(50)
    assert chip.moving
    assert sim.rules() == ["X-47"]


@item("X-48")
def test_a_load_stays_pending_over_a_stop():
    """Choice: Load, Stop, Start executes the load; logged."""
    sim, host, (_chip,) = steppers()
    load_count(host, 65000, position=20, start=False)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x5)
    host.wait_ms(200)
    assert host.position(1) == 20
    assert sim.rules() == ["X-48"]


@item("ST-119", "ST-120")
def test_position_range():
    """ST 5.1: -0x7FFFFFFF to 0x7FFFFFFF, the goal not more than 0x7FFFFFFF from the current position."""
    sim, host, (_chip,) = steppers(mode=0)
    load_count(host, 65452, position=0x7FFFFFFF, start=False)
    host.wait_ms(1)
    assert sim.rules() == []
    load_count(host, 65452, position=-0x80000000, start=False)
    host.wait_ms(1)
    assert sim.rules() == ["ST-119"]
    load_count(host, 65452, position=1000)
    host.wait_ms(100)
    load_count(host, 65452, position=-0x7FFFFFFF, reverse=True, start=False)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x4, [0x99, *i32(-0x7FFFFFFF), *(65452).to_bytes(2, "little"), 250])
    host.wait_ms(1)
    assert sim.rules()[-1] == "ST-120"


@item("ST-121", "ST-122", "X-73")
@pytest.mark.parametrize(
    ("speed", "acceleration", "logged"), [(0, 5, 1), (251, 5, 1), (5, 0, 1), (1, 1, 0), (250, 255, 0)]
)
def test_ranges_of_speed_and_acceleration(speed, acceleration, logged):
    """ST 5.1: speed 1-250, acceleration 1-255. Choice: clamp and log."""
    sim, host, (chip,) = steppers()
    load_profile(host, speed=speed, acceleration=acceleration, start=False)
    host.wait_ms(1)
    assert sim.rules() == ["X-73"] * logged
    assert chip.loads.last.speed == min(max(speed, 1), 250)
    assert chip.loads.last.acceleration == max(acceleration, 1)


@item("ST-133")
def test_parameters_not_loaded_keep_their_values():
    """ST 5.1, foot of Table 4: the previously loaded value will be used."""
    sim, host, _ = steppers(mode=0)
    load_profile(host, position=1000, speed=100, acceleration=1)
    host.wait_ms(500)
    load_profile(host, position=3000)
    host.wait_ms(500)
    assert host.position(1) == 3000
    assert gaps_ns(sim)[1400:2600] == pytest.approx(50_000, rel=1e-3)
    assert sim.rules() == []


@item("X-63")
def test_direction_bit_away_from_the_stop_position_runs_away():
    """Choice: bit 4 decides, so the axis runs away; logged."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=100, reverse=True)
    host.wait_ms(500)
    assert host.position(1) < -100
    assert chip.moving
    assert sim.rules() == ["X-63"]


@item("X-65")
def test_zero_length_move():
    """Choice: no pulse, stays Stopped, logged."""
    sim, host, (chip,) = steppers()
    load_count(host, 65000, position=0)
    load_profile(host, position=0, speed=10, acceleration=1)
    host.wait_ms(500)
    assert not chip.moving
    assert len(chip.runs) == 0
    assert sim.rules() == ["X-65", "X-65"]


@item("ST-130", "ST-133")
def test_an_overwritten_load_leaves_its_values_behind():
    """ST 5.1: a later load overwrites one that waits; what it does not load is what was loaded before."""
    sim, host, _ = steppers(mode=0)
    load_profile(host, position=5000, speed=100, acceleration=1, start=False)
    load_profile(host, position=2000, start=False)
    host.exchange(1, 0x5)
    host.wait_ms(1000)
    assert host.position(1) == 2000
    assert gaps_ns(sim).min() == pytest.approx(50_000, rel=1e-3)
    assert sim.rules() == []


@item("ST-184", "X-60")
def test_a_refused_stop_position_changes_nothing_for_later_counts():
    """Choice: the refused load is ignored, so the stop position that the run began with stays."""
    sim, host, _ = steppers(mode=0)
    load_count(host, 64000, position=400)
    host.wait_ms(20)
    load_count(host, 64000, position=900)
    load_count(host, 64500)
    host.wait_ms(2000)
    assert host.position(1) == 400
    assert sim.rules() == ["ST-184"]
