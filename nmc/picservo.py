"""A PIC-SERVO on the bus: every command of its data sheet (section 5.2) as a method, and searches for home."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from nmc.chips import picservo
from nmc.codec import Status
from nmc.errors import LocalFault
from nmc.module import HomeFound, Module

StopManner = Literal["abruptly", "smoothly", "motor_off"]
HomeEvent = Literal["limit1", "limit2", "index", "position_error", "current_limit"]
HomeStop = Literal["abruptly", "smoothly", "motor_off", "none"]

POLL_NS = 5_000_000


@dataclass(frozen=True, slots=True)
class Gains:
    """Parameters of Set Gain in the chip's units (section 5.2); IL is multiplied by 256 inside the chip."""

    position_gain: int
    velocity_gain: int
    integral_gain: int
    integration_limit: int
    output_limit: int = 255
    current_limit: int = 0
    position_error_limit: int = 4000
    servo_rate_divisor: int = 1
    deadband: int = 0


class PicServo(Module):
    """One PIC-SERVO. Positions in counts; velocity and acceleration per servo tick with 16 fractional bits."""

    facts = picservo.FACTS

    def reset_position(self) -> Status:
        """Encoder counter and command position := 0; refused while moving."""
        return self.send("reset_position")

    def load_trajectory(
        self,
        *,
        position: int | None = None,
        velocity: int | None = None,
        acceleration: int | None = None,
        pwm: int | None = None,
        servo_mode: bool = True,
        velocity_mode: bool = False,
        reverse: bool = False,
        start_now: bool = False,
    ) -> Status:
        """Motion parameters. servo_mode False: raw PWM. velocity_mode False: trapezoid to ``position``.

        velocity, acceleration 0..0x7FFFFFFF are magnitudes; ``reverse`` gives the direction in velocity and PWM mode.
        """
        values: dict[str, int] = {
            "servo_mode": int(servo_mode),
            "velocity_mode": int(velocity_mode),
            "reverse": int(reverse),
            "start_now": int(start_now),
        }
        given = {"position": position, "velocity": velocity, "acceleration": acceleration, "pwm": pwm}
        values.update({name: value for name, value in given.items() if value is not None})
        return self.send("load_trajectory", values)

    def start_motion(self) -> Status:
        """Execute what was loaded last; while moving only if that selects velocity mode."""
        return self.send("start_motion")

    def set_gain(self, gains: Gains) -> Status:
        """All control parameters. A module older than version 4 gets 13 bytes, without the deadband."""
        names = [field.name for field in self.facts.command("set_gain").fields]
        values = {name: int(getattr(gains, name)) for name in names}
        tracker = self.bus.guard.modules.get(self.address)
        if tracker is not None and tracker.version < 4 and values.pop("deadband"):
            raise LocalFault("deadband needs version 4", address=self.address, rule="PIC-SERVO section 5.2")
        return self.send("set_gain", values)

    def stop_motor(self, manner: StopManner | None = None, *, amplifier: bool = True) -> Status:
        """Stop in this manner (None: do not stop) and set AMP_EN to ``amplifier``."""
        values = {"amplifier_enable": int(amplifier)}
        if manner is not None:
            values["motor_off" if manner == "motor_off" else f"stop_{manner}"] = 1
        return self.send("stop_motor", values)

    def stop_here(self, position: int, *, amplifier: bool = True) -> Status:
        """Servo to ``position`` at once, without profile; a stream of these is followed point by point."""
        return self.send("stop_motor", {"amplifier_enable": int(amplifier), "stopping_position": position})

    def io_control(
        self,
        *,
        limit1_output: bool = False,
        limit2_output: bool = False,
        limit1_is_input: bool = True,
        limit2_is_input: bool = True,
    ) -> Status:
        """Direction and output values of the Limit pins."""
        return self.send(
            "io_control",
            {
                "limit1_output": int(limit1_output),
                "limit2_output": int(limit2_output),
                "limit1_is_input": int(limit1_is_input),
                "limit2_is_input": int(limit2_is_input),
            },
        )

    def set_homing_mode(self, *events: HomeEvent, stop: HomeStop = "none") -> Status:
        """Capture the position on any of these events and stop in this manner (automatic stops need version 3)."""
        tracker = self.bus.guard.modules.get(self.address)
        if stop != "none" and tracker is not None and tracker.version < 3:
            raise LocalFault(
                "automatic stop on home needs version 3", address=self.address, rule="PIC-SERVO section 5.2"
            )
        values = {f"on_{event}": 1 for event in events}
        if stop != "none":
            values["motor_off" if stop == "motor_off" else f"stop_{stop}"] = 1
        return self.send("set_homing_mode", values)

    def clear_sticky_bits(self) -> Status:
        """Clear overcurrent, position error, position wrap and servo overrun."""
        return self.send("clear_sticky_bits")

    def save_current_position_as_home(self) -> Status:
        """Home register := position; meant for groups, to latch them together."""
        return self.send("save_current_position_as_home")

    # --- reading -----------------------------------------------------------------------------------------------------

    def position(self) -> int:
        """Encoder position in counts."""
        return self.read("position")

    def home_position(self) -> int:
        """Home register in counts."""
        return self.read("home_position")

    def velocity(self) -> int:
        """Velocity in counts per servo tick, without fraction: the chip sends its negative, this turns it round."""
        return -self.read("velocity")

    # --- waiting -----------------------------------------------------------------------------------------------------

    def require_ready(self) -> Status:
        """Raise RemoteFault unless motor power is on and no position error stands (section 4.5)."""
        status = self.no_operation()
        if "power_on" not in status.flags:
            raise self.give_up("motor power is off", status)
        if "position_error" in status.flags:
            raise self.give_up("the position servo was disabled (position error is set)", status)
        return status

    def wait_until_done(self, timeout_ns: int, poll_ns: int = POLL_NS) -> Status:
        """Poll until move_done. Raises RemoteFault after ``timeout_ns`` or when the servo disables itself."""
        deadline_ns = self.bus.link.now_ns() + timeout_ns
        while True:
            status = self.poll(poll_ns)
            if "position_error" in status.flags:
                raise self.give_up("the position servo was disabled on the way (position error is set)", status)
            if "move_done" in status.flags:
                return status
            if self.bus.link.now_ns() > deadline_ns:
                raise self.give_up(f"not done after {timeout_ns / 1e9:.1f} s", status)

    def find_home(
        self,
        event: HomeEvent,
        *,
        velocity: int,
        acceleration: int,
        reverse: bool,
        timeout_ns: int,
        stop: HomeStop = "abruptly",
        poll_ns: int = POLL_NS,
    ) -> HomeFound:
        """Run in velocity mode until ``event``, stop, and return what was captured (section 5.2, Set Homing Mode).

        Raises RemoteFault if the servo disables itself before the event, or after ``timeout_ns``; the motor is then
        stopped abruptly.
        """
        self.set_homing_mode(event, stop=stop)
        self.load_trajectory(
            velocity=velocity, acceleration=acceleration, velocity_mode=True, reverse=reverse, start_now=True
        )
        deadline_ns = self.bus.link.now_ns() + timeout_ns
        while True:
            status = self.poll(poll_ns)
            if "home_in_progress" not in status.flags:
                break
            if "position_error" in status.flags and event != "position_error":
                raise self.give_up(f"the servo was disabled before {event}", status)
            if self.bus.link.now_ns() > deadline_ns:
                self.stop_motor("abruptly")
                raise self.give_up(f"no {event} within {timeout_ns / 1e9:.1f} s", status)
        if stop == "none":
            self.stop_motor("abruptly")
        elif stop == "smoothly":
            self.wait_until_done(timeout_ns, poll_ns)
        values = self.read_status("position", "home_position").values
        return HomeFound(values["home_position"], values["position"])
