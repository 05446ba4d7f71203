"""The simulated PIC-SERVO's profiles (data sheet 4.4) and Load Trajectory, tick by tick against their closed forms."""

import numpy as np
import pytest

from sim import servokernel as k
from sim.rawhost import FIRM_GAINS, GROUP, i32, servos
from sim.rawservo import tick, trapezoid, velocity
from sim.spec import SimOptions

item = pytest.mark.item
LOOSE = (*FIRM_GAINS[:6], 0x3FFF, 1, 0)


def command_track(host, chip, ticks):
    """Command position in counts at the next ``ticks`` ticks, and move_done."""
    seen = [tick(host, chip) for _ in range(ticks)]
    return np.array([n[k.COMMAND] / 65536 for n in seen]), np.array([n[k.MOVE_DONE] for n in seen])


@item("SV-040", "SV-041", "SV-110", "SV-112", "SV-113", "SV-116", "SV-180", "SV-193", "SV-194")
@pytest.mark.parametrize("goal", [8000, -8000])
def test_trapezoid(goal):
    """SV 4.4: accelerate at a constant rate, slew, decelerate at a constant rate, hold; with its two flags."""
    sim, host, (chip,) = servos(gains=LOOSE)
    peak, accel = 10 * 65536, 3277  # 10 counts/tick, 0.05 counts/tick^2: 200 ticks up, 600 slewing, 200 down
    trapezoid(host, goal, peak, accel)
    first = chip.n.tolist()
    assert (first[k.MOVE_DONE], first[k.ACCEL_DONE], first[k.SLEW_DONE], first[k.VELOCITY]) == (0, 0, 0, 0)
    flags = []
    speeds = []
    places = []
    while True:
        n = tick(host, chip)
        flags.append((n[k.ACCEL_DONE], n[k.SLEW_DONE]))
        speeds.append(n[k.VELOCITY])
        places.append(n[k.COMMAND])
        if n[k.MOVE_DONE]:
            break
    assert len(speeds) == pytest.approx(1000, abs=2)
    steps = np.abs(np.diff([0, *speeds]))
    assert steps[:-1].max() <= accel
    assert np.abs(speeds).max() == peak
    assert places[-1] == goal * 65536
    assert speeds[-1] == 0
    accel_done = next(t for t, f in enumerate(flags) if f[0])
    slew_done = next(t for t, f in enumerate(flags) if f[1])
    assert accel_done == pytest.approx(200, abs=1)
    assert slew_done == pytest.approx(800, abs=2)
    host.wait_ms(300)
    assert host.position(1) == pytest.approx(goal, abs=8)
    assert host.status(1) & 0x01
    assert host.items(1, 0x08, 1)[0] & 0x18 == 0x18
    trapezoid(host, 0, start=True)
    assert host.items(1, 0x08, 1)[0] & 0x18 == 0  # cleared when the next move is started
    assert sim.rules() == []


@item("SV-042")
@pytest.mark.parametrize("goal", [1, 2, 7, 500, -1999])
def test_short_moves_are_triangles(goal):
    """SV 4.4: the motor may never reach its peak velocity; the profile is triangular and still ends on the goal."""
    _, host, (chip,) = servos(gains=LOOSE)
    trapezoid(host, goal, 100 * 65536, 3277)
    places, done = command_track(host, chip, 500)
    assert places[done.argmax()] == goal
    assert done[-1]
    ticks = done.argmax()
    assert ticks == pytest.approx(2 * np.sqrt(abs(goal) / 0.05), abs=3)


@item("SV-044")
def test_huge_acceleration_and_velocity_jump_in_one_tick():
    """SV 4.3: small motions with very large acceleration and velocity jump to the goal position in a single tick."""
    _, host, (chip,) = servos(gains=LOOSE)
    trapezoid(host, 50, 0x7FFFFFFF, 0x7FFFFFFF)
    n = tick(host, chip)
    assert n[k.COMMAND] == 50 * 65536
    assert n[k.MOVE_DONE]


@item("SV-043", "X-07", "SV-126")
@pytest.mark.parametrize("choice", ["jump", "restart"])
def test_changing_a_trapezoid_is_erratic(choice):
    """SV 4.4: changing it before the goal is reached causes erratic and potentially damaging motion. Choice: a jump."""
    sim, host, (chip,) = servos(gains=LOOSE, options=SimOptions(trapezoid_change=choice))
    trapezoid(host, 8000, 10 * 65536, 3277)
    host.wait_ms(100)
    before = chip.command_position
    trapezoid(host, -100)
    assert sim.rules() == ["X-07"]
    assert (abs(chip.command_position - before) > 1000) == (choice == "jump")


@item("SV-127", "X-07")
def test_start_motion_during_a_trapezoid_is_logged():
    """SV 5.1 note 2: only allowed while moving if the loaded trajectory is velocity mode."""
    sim, host, _ = servos(gains=LOOSE)
    trapezoid(host, 8000, 10 * 65536, 3277)
    trapezoid(host, 100, start=False)
    host.wait_ms(20)
    assert sim.rules() == []
    host.exchange(1, 0x5)
    assert sim.rules() == ["X-07"]


@item("SV-045", "SV-046", "SV-048", "SV-117")
def test_velocity_mode_is_the_exact_integral():
    """SV 4.4: velocity moves to the goal at the acceleration rate, up or down; position is its exact integral."""
    sim, host, (chip,) = servos(gains=LOOSE)
    velocity(host, 10 * 65536, 3000)
    n = chip.n.tolist()
    place, speed, goal, accel = n[k.COMMAND], 0, 10 * 65536, 3000
    for t in range(900):
        if t in (150, 300, 600):
            goal, accel = {150: (20 * 65536, 7001), 300: (-5 * 65536, 9000), 600: (123456, 1000)}[t]
            velocity(host, goal, accel)
            n = chip.n.tolist()
            speed, place = n[k.VELOCITY], n[k.COMMAND]
        n = tick(host, chip)
        speed = min(speed + accel, goal) if speed < goal else max(speed - accel, goal)
        place += speed
        assert (n[k.VELOCITY], n[k.COMMAND]) == (speed, place)
        assert n[k.MOVE_DONE] == (speed == goal)
    assert sim.rules() == []


@item("X-82")
def test_velocity_ramps_through_zero():
    """Choice: a goal of the other sign is approached through zero at the acceleration rate."""
    _, host, (chip,) = servos(gains=LOOSE)
    velocity(host, 3 * 65536, 6554)
    host.wait_ms(100)
    velocity(host, -3 * 65536)
    speeds = [tick(host, chip)[k.VELOCITY] for _ in range(70)]
    assert np.all(np.diff(speeds) <= 0)
    assert np.abs(np.diff(speeds)).max() <= 6554
    assert speeds[-1] == -3 * 65536


@item("SV-047")
def test_velocity_mode_may_be_entered_in_a_trapezoid():
    """SV 4.4: in fact, velocity mode may be entered while in the middle of a trapezoidal move; no discontinuity."""
    sim, host, (chip,) = servos(gains=LOOSE)
    trapezoid(host, 80_000, 10 * 65536, 3277)
    host.wait_ms(200)
    velocity(host, 4 * 65536)
    speeds = [tick(host, chip)[k.VELOCITY] for _ in range(300)]
    assert np.abs(np.diff(speeds)).max() <= 3277
    assert speeds[-1] == 4 * 65536
    assert sim.rules() == []


@item("SV-049", "SV-050", "SV-051")
def test_units_by_the_sheets_example():
    """SV 4.4: 1 rev/s of a 500-line encoder is 1.0240 counts/tick = 67 109; 4 rev/s2 is 137; 1/4 s."""
    assert round(2000 * 512e-6 * 65536) == 67_109
    assert int(0.0021 * 65536) == 137
    assert pytest.approx(137, abs=0.5) == 4 * 2000 * 512e-6**2 * 65536
    _, host, (chip,) = servos(gains=LOOSE)
    velocity(host, 67_109, 137)
    done = command_track(host, chip, 600)[1]
    assert done.argmax() * 512e-6 == pytest.approx(0.25, abs=0.002)
    start = host.link.now_ns(), chip.command_position
    host.wait_ms(1000)
    rate = (chip.command_position - start[1]) / ((host.link.now_ns() - start[0]) * 1e-9)
    assert rate == pytest.approx(2000, rel=2e-3)


@item("SV-052", "X-86")
@pytest.mark.parametrize("divisor", [1, 2, 5])
def test_rates_scale_with_the_servo_rate_divisor(divisor):
    """SV 4.4, 5.2: the servo tick is the profiling timebase: velocity scales with SR, acceleration with its square."""
    _, host, (chip,) = servos(gains=(*FIRM_GAINS[:6], 0x3FFF, divisor, 0))
    velocity(host, 2000 * divisor, 10 * divisor**2)
    host.wait_ms(600)
    tick(host, chip)
    start = host.link.now_ns(), chip.command_position
    host.wait_ms(512 * 2)
    rate = (chip.command_position - start[1]) / ((host.link.now_ns() - start[0]) * 1e-9)
    assert rate == pytest.approx(2000 / 65536 / 512e-6, rel=5e-3)


@item("SV-065", "SV-124")
def test_a_trapezoid_begins_at_zero_velocity():
    """SV 4.5, 5.2: trapezoidal motions force the motor to begin at zero velocity and should only be begun at rest."""
    sim, host, (chip,) = servos(gains=LOOSE)
    velocity(host, 3 * 65536, 6554)
    host.wait_ms(100)
    trapezoid(host, 30_000, 65536, 655)
    assert chip.n[k.VELOCITY] == 0
    assert sim.rules() == ["SV-124"]


@item("SV-110", "SV-111", "SV-112", "SV-113", "SV-114", "SV-119", "SV-120", "X-30")
@pytest.mark.parametrize("bits", range(16))
def test_load_length_follows_the_control_byte(bits):
    """SV 5.2: 1 + 4 position + 4 velocity + 4 acceleration + 1 PWM bytes; 0x94, 0x15 is position, acceleration."""
    sim, host, (chip,) = servos(gains=LOOSE)
    fields = [i32(0x01020304), i32(0x11223344), i32(0x21222324), bytes([0x55])]
    data = bytes([bits | 0x10]) + b"".join(f for b, f in enumerate(fields) if bits >> b & 1)
    host.exchange(1, 0x4, data)
    load = chip.moves.last
    assert load.position == (0x01020304 if bits & 1 else 0)
    assert load.velocity == (0x11223344 if bits & 2 else 0)
    assert load.acceleration == (0x21222324 if bits & 4 else 0)
    assert load.pwm == (0x55 if bits & 8 else 0)
    assert sim.rules() == []
    if bits == 5:
        assert len(data) << 4 | 0x4 == 0x94
        assert data[0] == 0x15


@item("SV-121", "SV-122")
def test_ranges():
    """SV 5.2: position +/- 0x7FFFFFFF and goal within that of the present one; velocity, acceleration too."""
    sim, host, _ = servos(gains=LOOSE)
    host.exchange(1, 0x4, [0x17, *i32(0x7FFFFFFF), *i32(0x7FFFFFFF), *i32(0x7FFFFFFF)])
    assert sim.rules() == []
    host.exchange(1, 0x4, [0x17, *i32(-0x80000000), *i32(-1), *i32(-1)])
    assert sim.rules() == ["SV-121", "SV-122", "SV-122"]
    sim.log.violations.clear()
    host.exchange(1, 0x7, [0x11, *i32(1000)])
    host.wait_ms(200)
    trapezoid(host, -0x7FFFFFFF, 65536, 655)
    assert sim.rules() == ["SV-121"]


@item("SV-118", "SV-125", "N-080")
def test_loads_wait_for_start_motion_and_start_together():
    """SV 5.2: bit 7 clear buffers the data until Start Motion; a group command starts several chips simultaneously."""
    sim, host, chips = servos(3, gains=LOOSE)
    for address in (1, 2, 3):
        velocity(host, 65536, 6554, start=False, address=address)
    host.wait_ms(200)
    assert [int(c.n[k.GOAL_VELOCITY]) for c in chips] == [0, 0, 0]
    host.exchange(GROUP, 0x5)
    host.wait_ms(0.6)
    assert [int(c.n[k.GOAL_VELOCITY]) for c in chips] == [65536] * 3
    assert sim.rules() == []


@item("SV-115", "SV-116")
def test_mode_bits_choose_the_mode():
    """SV 5.2: bit 4: 0 PWM mode, 1 position servo; bit 5: 0 trapezoid, 1 velocity."""
    _, host, (chip,) = servos(gains=LOOSE)
    velocity(host, 65536, 655)
    assert (chip.n[k.SERVO_ON], chip.n[k.MODE]) == (1, k.MODE_VELOCITY)
    host.exchange(1, 0x7, [0x05])
    trapezoid(host, 5000, 65536, 655)
    assert (chip.n[k.SERVO_ON], chip.n[k.MODE]) == (1, k.MODE_TRAPEZOID)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x4, [0x80])
    assert (chip.n[k.SERVO_ON], chip.n[k.MODE]) == (0, k.MODE_PWM)


@item("SV-172")
def test_pwm_mode_while_moving_is_logged():
    """SV 5.1 note 1: while moving only not start-now loads, or velocity mode."""
    sim, host, _ = servos(gains=LOOSE)
    trapezoid(host, 50_000, 65536, 655)
    host.exchange(1, 0x4, [0x88, 0])
    assert sim.rules() == ["SV-126"]


@item("X-47")
def test_stale_start():
    """Choice: the last load is executed again; logged."""
    sim, host, (chip,) = servos(gains=LOOSE)
    velocity(host, 65536, 6554)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x5)
    assert chip.n[k.GOAL_VELOCITY] == 65536
    assert sim.rules() == ["X-47"]


@item("X-48")
def test_a_load_stays_pending_over_a_stop():
    """Choice: executed by the next Start Motion; logged."""
    sim, host, (chip,) = servos(gains=LOOSE)
    velocity(host, 65536, 6554, start=False)
    host.exchange(1, 0x7, [0x05])
    host.exchange(1, 0x5)
    assert chip.n[k.GOAL_VELOCITY] == 65536
    assert sim.rules() == ["X-48"]


@item("X-90")
@pytest.mark.parametrize(("peak", "acceleration"), [(0, 655), (65536, 0)])
def test_trapezoid_that_never_ends(peak, acceleration):
    """Choice: velocity or acceleration 0 never finishes; logged."""
    sim, host, _ = servos(gains=LOOSE)
    trapezoid(host, 100, peak, acceleration)
    host.wait_ms(1000)
    assert not host.status(1) & 0x01
    assert host.position(1) == pytest.approx(0, abs=2)
    assert sim.rules() == ["X-90"]


@item("SV-180")
def test_move_done_is_set_while_the_servo_is_off():
    """SV 5.3: set otherwise, including while the position servo is disabled."""
    _, host, (chip,) = servos(gains=LOOSE)
    trapezoid(host, 50_000, 65536, 655)
    assert not host.status(1) & 0x01
    chip.set_supply(0.0)
    tick(host, chip, 2)
    assert host.status(1) & 0x01
