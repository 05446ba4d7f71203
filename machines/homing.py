"""Homing: find the switch fast, back off, find its edge slowly, and make its place the machine's coordinates.

    travel   |------0-----------------------------|
    switch ##|                                        1 seek in ``direction`` until the switch changes
             <==========================              2 back off
             ==>                                      3 seek its edge again, slowly
             <-                                       4 go to machine zero, counter := 0
             ----->0

An NMC chip can only set its counter to zero, so homing always ends at machine zero. An axis that stands on its switch
first leaves it. Every search is bounded by the travel; one that finds nothing stops and says so.
"""

from __future__ import annotations

from dataclasses import dataclass

from machines.schema import AxisKeys, HomeTable, MachineConfig, ServoMotorTable, StepMotorTable
from machines.wiring import speed_mode
from nmc.chips import picstep
from nmc.module import HomeFound
from nmc.picservo import PicServo
from nmc.picstep import HomeSwitch, PicStep

NS_PER_S = 1_000_000_000
MARGIN = 1.3
"""A search may take this much longer than the travel needs."""
GRACE_S = 2.0
SETTLE_POLL_NS = 10_000_000
SETTLED_POLLS = 5
_PIN: dict[str, HomeSwitch] = {"limit1": "limit1", "limit2": "limit2", "home": "home_switch"}


@dataclass(frozen=True, slots=True)
class Homed:
    """One axis's outcome. ``edge_steps``: counter at the switch's edge before the counter was set to zero."""

    axis: str
    edge_steps: int
    spread_steps: int
    """Difference of the switch between the fast and the slow search: how well it repeats, and how late a poll is."""


def home_stepper(config: MachineConfig, axis: str, table: StepMotorTable, chip: PicStep) -> Homed:
    """Home an axis with one PIC-STEP motor. Raises RemoteFault where the switch is not found; the motor then stands."""
    keys = config.axis[axis]
    home = _home_of(axis, keys)
    scale = table.steps_per_unit
    rates = _StepRates(f"{speed_mode(config, axis, table)}x", abs(scale), keys.max_acceleration)
    pin = _PIN[home.switch]
    forward = (home.direction == "positive") == (scale > 0)

    def seek(towards: bool, velocity: float, distance: float) -> HomeFound:
        speed, acceleration = rates.speed(velocity), rates.acceleration_time()
        timeout_ns = round((MARGIN * distance / velocity + GRACE_S) * NS_PER_S)
        return chip.find_home(
            pin,
            speed=speed,
            acceleration_time=acceleration,
            reverse=forward != towards,
            timeout_ns=timeout_ns,
            stop="smoothly",
        )

    def go(position: int) -> None:
        distance = abs(position - chip.position()) / abs(scale)
        if distance == 0:
            return
        chip.stop_motor("abruptly")
        speed, acceleration = rates.speed(home.velocity), rates.acceleration_time()
        chip.load_trajectory(position=position, speed=speed, acceleration_time=acceleration, start_now=True)
        chip.wait_until_stopped(round((MARGIN * distance / home.velocity + GRACE_S) * NS_PER_S))

    length = keys.travel[1] - keys.travel[0] + 2 * home.backoff
    away = round(home.backoff * abs(scale)) * (-1 if forward else 1)
    if chip.inputs()[pin]:
        found = seek(towards=False, velocity=home.slow_velocity, distance=length)
        go(found.home_position + away)
    fast = seek(towards=True, velocity=home.velocity, distance=length)
    go(fast.home_position + away)
    edge = seek(towards=True, velocity=home.slow_velocity, distance=2 * home.backoff)
    go(edge.home_position - round(home.position * scale))
    chip.stop_motor("abruptly")
    chip.reset_position()
    return Homed(axis, edge.home_position, edge.home_position - fast.home_position)


def home_servo(config: MachineConfig, axis: str, table: ServoMotorTable, chip: PicServo) -> Homed:
    """Home an axis with one PIC-SERVO motor, as :func:`home_stepper`; the chip captures on a limit or on the index."""
    keys = config.axis[axis]
    home = _home_of(axis, keys)
    if home.switch == "home":
        raise ValueError(f"axis {axis}: a pic-servo has no home input")
    event = home.switch
    scale = table.counts_per_unit
    rates = _ServoRates(abs(scale), keys.max_acceleration, table.servo.servo_rate_divisor)
    forward = (home.direction == "positive") == (scale > 0)

    def seek(towards: bool, velocity: float, distance: float) -> HomeFound:
        return chip.find_home(
            event,
            velocity=rates.velocity(velocity),
            acceleration=rates.acceleration(),
            reverse=forward != towards,
            timeout_ns=round((MARGIN * distance / velocity + GRACE_S) * NS_PER_S),
            stop="abruptly",
        )

    def go(position: int) -> None:
        chip.stop_motor("abruptly")
        chip.wait_until_done(round(GRACE_S * NS_PER_S))
        distance = abs(position - chip.position()) / abs(scale)
        chip.load_trajectory(
            position=position,
            velocity=rates.velocity(home.velocity),
            acceleration=rates.acceleration(),
            start_now=True,
        )
        chip.wait_until_done(round((MARGIN * distance / home.velocity + GRACE_S) * NS_PER_S))

    length = keys.travel[1] - keys.travel[0] + 2 * home.backoff
    away = round(home.backoff * abs(scale)) * (-1 if forward else 1)
    if event != "index" and event in chip.no_operation().flags:
        found = seek(towards=False, velocity=home.slow_velocity, distance=length)
        go(found.home_position + away)
    fast = seek(towards=True, velocity=home.velocity, distance=length)
    go(fast.home_position + away)
    edge = seek(towards=True, velocity=home.slow_velocity, distance=2 * home.backoff)
    zero = edge.home_position - round(home.position * scale)
    go(zero)
    _settle(chip, zero)
    chip.reset_position()
    return Homed(axis, edge.home_position, edge.home_position - fast.home_position)


def _settle(chip: PicServo, target: int) -> None:
    """Wait until the shaft stands on ``target``: the counter is set to zero where the shaft is, not where it should be.

    Raises RemoteFault if it does not come there: gains too weak for the friction, or the axis is held.
    """
    deadline_ns = chip.bus.link.now_ns() + round(GRACE_S * NS_PER_S)
    still = 0
    while still < SETTLED_POLLS:
        chip.poll(SETTLE_POLL_NS)
        off = chip.position() - target
        still = still + 1 if off == 0 else 0
        if chip.bus.link.now_ns() > deadline_ns:
            raise chip.give_up(f"the axis settles {off:+d} counts off machine zero; check its gains")


def _home_of(axis: str, keys: AxisKeys) -> HomeTable:
    if keys.home is None:
        raise ValueError(f"axis {axis} has no [axis.{axis}.home] in its machine file")
    return keys.home


@dataclass(frozen=True, slots=True)
class _StepRates:
    """Velocities and accelerations in the units of a PIC-STEP's profiles (data sheet section 4.2)."""

    mode: str
    steps_per_unit: float
    max_acceleration: float

    def speed(self, velocity: float) -> int:
        """Profile speed 1..250."""
        unit = picstep.SPEED_MODES[self.mode].rate_step_hz
        return min(max(round(velocity * self.steps_per_unit / unit), picstep.SPEED_MIN), picstep.SPEED_MAX)

    def acceleration_time(self) -> int:
        """Quarter milliseconds for one unit of speed, so long that the axis's acceleration is not passed."""
        unit = picstep.SPEED_MODES[self.mode].rate_step_hz
        time_ns = unit / (self.max_acceleration * self.steps_per_unit) * NS_PER_S
        ticks = -(-time_ns // picstep.ACCELERATION_UNIT_NS)
        return int(min(max(ticks, picstep.ACCELERATION_MIN), picstep.ACCELERATION_MAX))


@dataclass(frozen=True, slots=True)
class _ServoRates:
    """Velocities and accelerations in the units of a PIC-SERVO: per tick, 16 fractional bits (section 4.4)."""

    counts_per_unit: float
    max_acceleration: float
    divisor: int

    def velocity(self, velocity: float) -> int:
        """Counts a tick."""
        return max(round(velocity * self.counts_per_unit * self._tick_s() * 65536), 1)

    def acceleration(self) -> int:
        """Counts a tick squared, half of what the axis may do."""
        return max(round(0.5 * self.max_acceleration * self.counts_per_unit * self._tick_s() ** 2 * 65536), 1)

    def _tick_s(self) -> float:
        return 512e-6 * self.divisor
