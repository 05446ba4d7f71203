"""A PIC-I/O on the bus, as far as the vendor's host headers tell it (``nmc.chips.picio``)."""

from __future__ import annotations

from nmc.chips import picio
from nmc.codec import Status
from nmc.module import Module


class PicIo(Module):
    """One PIC-I/O: twelve I/O bits, two PWM outputs, three analog inputs, a timer."""

    facts = picio.FACTS

    def set_io_direction(self, inputs: int) -> Status:
        """Bits 0..11: 1 = input, 0 = output."""
        return self.send("set_io_direction", {"inputs": inputs})

    def set_output(self, outputs: int) -> Status:
        """Output bits at once."""
        return self.send("set_output", {"outputs": outputs})

    def set_pwm(self, pwm1: int, pwm2: int) -> Status:
        """Both PWM outputs at once, 0..255."""
        return self.send("set_pwm", {"pwm1": pwm1, "pwm2": pwm2})

    def set_synch_output(self, outputs: int, pwm1: int, pwm2: int) -> Status:
        """Outputs to be set by the next Synch Output."""
        return self.send("set_synch_output", {"outputs": outputs, "pwm1": pwm1, "pwm2": pwm2})

    def synch_output(self) -> Status:
        """Set what Set Synch Output has stored (code of Start Motion, so that a group starts together)."""
        return self.send("synch_output")

    def synch_input(self) -> Status:
        """Store inputs and timer (code of Save Current Position as Home)."""
        return self.send("synch_input")

    def set_timer_mode(self, mode: int) -> Status:
        """Counter and timer mode."""
        return self.send("set_timer_mode", {"mode": mode})

    def input_word(self) -> int:
        """Input bits."""
        return self.read("input_word")
