"""The simulated PIC-STEP's step timer and unprofiled modes (data sheet 1.0, 4.1).

Figures are the data sheet's own, or follow from them by the arithmetic shown.
"""

import numpy as np
import pytest

from sim.rawhost import i32, steppers
from sim.rawstep import gaps_ns, load_count, load_profile

item = pytest.mark.item


@item("ST-020", "ST-030", "ST-031", "ST-032", "ST-033", "ST-035", "ST-036")
@pytest.mark.parametrize(
    ("bits", "count", "rate"),
    [
        (0, 65452, 50_000),
        (3, 40538, 25),
        (3, 65438, 6250),
        (3, 1, 9.537),
        (3, 65452, 7267),
        (2, 1, 19.07),
        (2, 65452, 14205),
        (1, 1, 38.14),
        (1, 65452, 27174),
        (0, 1, 76.28),
    ],
)
def test_count_gives_rate(bits, count, rate):
    """ST 4.1, Table 2: S = clock / (65536 - count + {2,4,8,16}), clocks 625 kHz, 1.25, 2.5 and 5 MHz; 1..65452."""
    sim, host, _ = steppers(mode=bits)
    load_count(host, count)
    host.wait_ms(4e3 / rate)
    gaps = gaps_ns(sim)
    assert len(gaps) >= 2
    assert 1e9 / gaps == pytest.approx(rate, rel=3e-4)
    assert sim.rules() == []


@item("ST-006", "ST-030")
def test_pulses_leave_room_for_their_width():
    """ST 2.3: STEP is a rising pulse of 4.8 us; even at the greatest rate one ends long before the next begins."""
    sim, host, _ = steppers(mode=0)
    load_count(host, 65452)
    host.wait_ms(5)
    assert gaps_ns(sim).min() > 4 * 4800


@item("ST-034", "X-73")
@pytest.mark.parametrize(("count", "taken"), [(0, 1), (65453, 65452), (65535, 65452), (1, 1), (65452, 65452)])
def test_counts_outside_the_range_are_brought_into_it(count, taken):
    """ST 4.1: the maximum allowable initial timer count is 65,452 and the minimum is 1. Choice: clamp and log."""
    sim, host, _ = steppers()
    load_count(host, count)
    host.wait_ms(250)
    assert host.items(1, 0x04, 2) == taken.to_bytes(2, "little")
    assert sim.rules() == ([] if count == taken else ["X-73"])


@item("ST-021", "X-51")
def test_counter_wraps_at_32_bits():
    """ST 1.0: a 32-bit position counter. Choice: two's complement, no flag."""
    sim, host, (chip,) = steppers(mode=0)
    host.exchange(1, 0x4, [0x89, *i32(0x7FFFFFFF), *(65452).to_bytes(2, "little"), 250])
    host.link.sleep_until(0x7FFFFFFF * 20_000 + host.link.now_ns() + 1_000_000_000)
    assert host.position(1) == 0x7FFFFFFF
    assert not chip.moving
    load_count(host, 65452)
    host.wait_ms(1)
    assert -0x80000000 < host.position(1) < -0x80000000 + 100
    assert sim.rules() == []


@item("ST-005", "ST-037", "ST-115", "ST-128")
@pytest.mark.parametrize("reverse", [False, True])
def test_direction_bit_turns_unprofiled_and_velocity_motion(reverse):
    """ST 4.1, 5.1: bit 4, 0 = forward, 1 = reverse; DIR LOW is forward."""
    for way in ("count", "velocity"):
        sim, host, _ = steppers()
        if way == "count":
            load_count(host, 65000, reverse=reverse)
        else:
            load_profile(host, speed=100, acceleration=1, reverse=reverse)
        host.wait_ms(300)
        assert np.sign(host.position(1)) == (-1 if reverse else 1)
        assert set(sim.trace().run_dir) == {-1 if reverse else 1}


@item("ST-022", "ST-024", "ST-038", "ST-123")
@pytest.mark.parametrize("stop", [1, 2, 777, -1, -300])
def test_unprofiled_position_mode(stop):
    """ST 4.1: count and stopping position together: constant speed, abrupt stop exactly there."""
    sim, host, (chip,) = steppers(mode=1)
    load_count(host, 64000, position=stop, reverse=stop < 0)
    host.wait_ms(2000)
    assert host.position(1) == stop
    assert not chip.moving
    gaps = gaps_ns(sim)
    assert len(gaps) == abs(stop) - 1
    assert gaps == pytest.approx((65536 - 64000 + 8) / 2.5e6 * 1e9, rel=1e-6)


@item("X-61")
@pytest.mark.parametrize("latch", ["rollover", "immediate"])
def test_when_a_new_count_acts(latch):
    """Choice: at the next roll-over (section 4.1: 'reloaded with the initial timer count'), or at once, by name."""
    sim, host, _ = steppers(mode=0, count_latch=latch)
    load_count(host, 1)  # 13.1 ms
    host.wait_ms(15)
    load_count(host, 65452)
    host.wait_ms(15)
    gaps = gaps_ns(sim)
    slow = 65551 * 200
    assert (gaps[0] == pytest.approx(slow, rel=1e-6)) == (latch == "rollover")
    assert gaps[1:] == pytest.approx(20_000, rel=1e-6)


@item("X-62")
@pytest.mark.parametrize("first", ["period", "immediate"])
def test_first_pulse_after_a_start(first):
    """Choice: one full period after execution, or at once, by name."""
    sim, host, _ = steppers(mode=0, first_pulse=first, start_delay_max_ns=0)
    load_count(host, 1, start=False)
    host.send(1, 0x5)
    executed = sim.buses[0].command.free_ns
    host.wait_ms(40)
    delay = sim.trace().pulses_ns("M1")[0] - executed
    assert delay - (65551 * 200 if first == "period" else 0) == pytest.approx(0, abs=201)  # one base tick
