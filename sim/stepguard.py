"""What a PIC-STEP does on its own account: homing (data sheet sections 4.4, 5.1) and its protections (section 4.5)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sim.stepmodes import Mode

if TYPE_CHECKING:
    from sim.picstep import PicStep


def set_homing(chip: PicStep, control: int) -> None:
    """Begin to watch the flagged inputs for a change from their present level (X-74)."""
    chip.zero_bits("ST-067", control, 0xC0)
    if (control & 0x34).bit_count() > 1:
        chip.violation("ST-067", "Set Homing Mode with more than one manner of stopping")
    chip.homing = control | 0x100  # the bit in progress, also with no condition at all
    chip.homing_from = chip.inputs.byte(chip.timer.mechanical)


def inputs_changed(chip: PicStep) -> None:
    """Inputs may have another level than before: homing first (it captures), then the protections."""
    _check_home(chip)
    protect(chip)


def _check_home(chip: PicStep) -> None:
    homing = chip.homing
    if not homing:
        return
    changed = chip.inputs.byte(chip.timer.mechanical) ^ chip.homing_from
    flagged = (homing & 1) << 3 | (homing & 2) << 3 | (homing & 8) << 2
    if not changed & flagged:
        return
    chip.homing = 0
    chip.home_position = chip.timer.position
    chip.log.incident(chip.clock.ns_of(chip.timer.tick), chip.name, f"home captured at {chip.home_position}")
    if homing & 0x04:
        chip.set_amplifier(False)
        chip.timer.halt()
    elif homing & 0x10:
        chip.timer.halt()
    elif homing & 0x20:
        chip.stop(smooth=True)


def inhibited(chip: PicStep, direction: int) -> bool:
    """A motion that a limit or the E-stop does not allow never begins (section 4.5, X-70)."""
    inputs = chip.inputs.byte(chip.timer.mechanical)
    blocked = chip.estop_stop and inputs & 0x01
    blocked |= chip.limit_stop and inputs & (0x08 if direction > 0 else 0x10)
    if blocked or not chip.inputs.power:
        chip.incident("motion inhibited by " + ("power sense" if not chip.inputs.power else "limit or E-stop"))
        chip.loads.forget()
        return True
    return False


def protect(chip: PicStep) -> None:
    """Section 4.5: limits, E-stop, power sense, thermal limit, as the inputs stand now."""
    timer = chip.timer
    inputs = chip.inputs.byte(timer.mechanical)
    moving = timer.mode != Mode.STOPPED
    if not chip.inputs.power:
        _trip(chip, "power sense LOW", True)
    if chip.thermal_limit and chip.inputs.temperature < chip.thermal_limit:
        _trip(chip, "thermal limit", True)
    if moving and chip.limit_stop and inputs & (0x08 if timer.direction > 0 else 0x10):
        _trip(chip, "limit switch", chip.off_on_stop)
    if chip.estop_stop and inputs & 0x01:
        _trip(chip, "E-stop", chip.off_on_stop)


def _trip(chip: PicStep, why: str, motor_off: bool) -> None:
    """Motion ends at once; the state is Stopped with nothing loaded (X-71)."""
    if chip.timer.mode != Mode.STOPPED:
        chip.log.incident(chip.clock.ns_of(chip.timer.tick), chip.name, f"motion terminated: {why}")
        chip.timer.halt()
        chip.loads.forget()
    if motor_off and chip.amp_enabled:
        chip.log.incident(chip.clock.ns_of(chip.timer.tick), chip.name, f"amplifier off: {why}")
        chip.set_amplifier(False)
