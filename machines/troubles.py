"""What bits of a chip's status tell of why its motor stands, in words, and what to do.

Sources: PIC-SERVO data sheet sections 4.5 and 5.3, PIC-STEP data sheet sections 4.5 and 5.2.
"""

from __future__ import annotations

from dataclasses import dataclass

from nmc.chips import picservo, picstep


@dataclass(frozen=True, slots=True)
class Trouble:
    """One thing that a chip tells. sure: alone it stops a motor; a limit switch may be on because the axis is there."""

    what: str
    cure: str
    sure: bool = True


ESTOP = Trouble("its emergency stop input is on", "release it, then home again")
SUPPLY = Trouble("its supply is off", "switch it on, then home again")
POSITION_ERROR = Trouble(
    "position error, its servo has switched itself off", "look what blocks or pushes it, then home again"
)
LIMIT1 = Trouble("its limit switch LIMIT1 (forward) is on", "move it off the switch, then home again", sure=False)
LIMIT2 = Trouble("its limit switch LIMIT2 (reverse) is on", "move it off the switch, then home again", sure=False)


def servo_troubles(status: int) -> list[Trouble]:
    """What the status byte of a PIC-SERVO tells. A lost supply sets position error as well (section 4.5)."""
    if not status & picservo.STATUS_POWER_ON:
        return [SUPPLY]
    return [POSITION_ERROR] if status & picservo.STATUS_POSITION_ERROR else []


def stepper_troubles(status: int, inputs: int, *, estop: bool, limits: bool) -> list[Trouble]:
    """What status and inputs byte of a PIC-STEP tell. estop, limits: whether the chip heeds them (section 4.5)."""
    found = [ESTOP] if estop and inputs & picstep.INPUT_ESTOP else []
    found += [SUPPLY] if not status & picstep.STATUS_POWER else []
    found += [LIMIT1] if limits and inputs & picstep.INPUT_LIMIT1 else []
    found += [LIMIT2] if limits and inputs & picstep.INPUT_LIMIT2 else []
    return found


def words_of(names: list[str], trouble: Trouble) -> str:
    """The trouble of these motors: who, what, and what to do."""
    return f"motor{'s' if len(names) > 1 else ''} {', '.join(names)}: {trouble.what}: {trouble.cure}"
