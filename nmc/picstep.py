"""A PIC-STEP on the bus: every command of its data sheet (section 5.1) as a method, and searches for home."""

from __future__ import annotations

from typing import Literal

from nmc.chips import picstep
from nmc.codec import Status
from nmc.module import HomeFound, Module

StopManner = Literal["abruptly", "smoothly"]
HomeSwitch = Literal["limit1", "limit2", "home_switch"]
HomeStop = Literal["abruptly", "smoothly", "motor_off", "none"]

POLL_NS = 5_000_000


class PicStep(Module):
    """One PIC-STEP. Positions in steps, speeds 1..250 and acceleration times 1..255 in the chip's own units."""

    facts = picstep.FACTS

    def reset_position(self) -> Status:
        """Position counter := 0; refused while the motor moves."""
        return self.send("reset_position")

    def load_trajectory(
        self,
        *,
        position: int | None = None,
        speed: int | None = None,
        acceleration_time: int | None = None,
        timer_count: int | None = None,
        nearest_speed: int | None = None,
        reverse: bool = False,
        start_now: bool = False,
        endless: bool = False,
    ) -> Status:
        """Motion parameters; which are given decides the mode (Table 4).

        position + timer_count: unprofiled, with stop. timer_count alone: unprofiled (from Stopped only with
        ``endless``). position (+ speed, acceleration_time): trapezoid. speed and acceleration_time: velocity profile.
        ``nearest_speed`` goes with timer_count: the profile speed nearest to it, 1 if left out.
        """
        values: dict[str, int] = {"reverse": int(reverse), "start_now": int(start_now)}
        if position is not None:
            values["position"] = position
        if speed is not None:
            values["speed"] = speed
        if acceleration_time is not None:
            values["acceleration_time"] = acceleration_time
        if timer_count is not None:
            values["timer_count"] = timer_count
            values["nearest_speed"] = 1 if nearest_speed is None else nearest_speed
        return self.send("load_trajectory", values, endless=endless)

    def start_motion(self) -> Status:
        """Execute what was loaded last; refused if nothing fresh is loaded."""
        return self.send("start_motion")

    def set_parameters(
        self,
        speed_mode: str,
        *,
        minimum_speed: int = 1,
        running_current: int = 0,
        holding_current: int = 0,
        thermal_limit: int = 0,
        disable_limit_stop: bool = False,
        disable_estop: bool = False,
        motor_off_on_stop: bool = False,
    ) -> Status:
        """Speed mode "1x", "2x", "4x" or "8x", least profile speed, currents and thermal limit 0..255.

        Must come before any motion; while moving the chip ignores changes of speed mode and minimum speed.
        """
        return self.send(
            "set_parameters",
            {
                "speed_mode": picstep.SPEED_MODES[speed_mode].bits,
                "disable_limit_stop": int(disable_limit_stop),
                "disable_estop": int(disable_estop),
                "motor_off_on_stop": int(motor_off_on_stop),
                "minimum_speed": minimum_speed,
                "running_current": running_current,
                "holding_current": holding_current,
                "thermal_limit": thermal_limit,
            },
        )

    def stop_motor(self, manner: StopManner | None = None, *, amplifier: bool = True) -> Status:
        """Stop in this manner (None: do not stop) and set AMP_EN to ``amplifier``."""
        values = {"amplifier_enable": int(amplifier)}
        if manner is not None:
            values[f"stop_{manner}"] = 1
        return self.send("stop_motor", values)

    def set_outputs(self, outputs: int) -> Status:
        """OUT1..OUT5 as bits 0..4."""
        return self.send("set_outputs", {"outputs": outputs})

    def set_homing_mode(self, *switches: HomeSwitch, stop: HomeStop = "none") -> Status:
        """Capture the position on a change of any of these inputs and stop in this manner."""
        values = {f"on_{switch}": 1 for switch in switches}
        if stop != "none":
            values["motor_off" if stop == "motor_off" else f"stop_{stop}"] = 1
        return self.send("set_homing_mode", values)

    def save_current_position_as_home(self) -> Status:
        """Home register := position; meant for groups, to latch them together."""
        return self.send("save_current_position_as_home")

    # --- reading -----------------------------------------------------------------------------------------------------

    def position(self) -> int:
        """Position counter in steps."""
        return self.read("position")

    def home_position(self) -> int:
        """Home register in steps."""
        return self.read("home_position")

    def inputs(self) -> dict[str, bool]:
        """Inputs by name: estop, in1, in2, limit1, limit2, home_switch."""
        values = self.read_status("inputs").values
        return {name: bool(values[f"inputs.{name}"]) for name in picstep.INPUT_BITS}

    # --- waiting -----------------------------------------------------------------------------------------------------

    def wait_until_stopped(self, timeout_ns: int, poll_ns: int = POLL_NS) -> Status:
        """Poll until the moving bit is clear. Raises RemoteFault after ``timeout_ns``; the motor then still moves."""
        deadline_ns = self.bus.link.now_ns() + timeout_ns
        while True:
            status = self.poll(poll_ns)
            if "moving" not in status.flags:
                return status
            if self.bus.link.now_ns() > deadline_ns:
                raise self.give_up(f"still moving after {timeout_ns / 1e9:.1f} s", status)

    def find_home(
        self,
        switch: HomeSwitch,
        *,
        speed: int,
        acceleration_time: int,
        reverse: bool,
        timeout_ns: int,
        stop: HomeStop = "abruptly",
        poll_ns: int = POLL_NS,
    ) -> HomeFound:
        """Run in velocity mode until ``switch`` changes, stop, and return what was captured (section 4.4).

        Raises RemoteFault if the motor stops before the switch has changed, or after ``timeout_ns``; the motor is
        then stopped abruptly.
        """
        self.stop_motor("abruptly")
        self.set_homing_mode(switch, stop=stop)
        self.load_trajectory(speed=speed, acceleration_time=acceleration_time, reverse=reverse, start_now=True)
        deadline_ns = self.bus.link.now_ns() + timeout_ns
        while True:
            status = self.poll(poll_ns)
            if "moving" not in status.flags:
                break
            if self.bus.link.now_ns() > deadline_ns:
                self.stop_motor("abruptly")
                raise self.give_up(f"{switch} did not change within {timeout_ns / 1e9:.1f} s", status)
        if "homing_in_progress" in status.flags:
            raise self.give_up(f"the motor stopped before {switch} changed", status)
        values = self.read_status("position", "home_position").values
        return HomeFound(values["home_position"], values["position"])
