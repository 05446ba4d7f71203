"""Where PIC-SERVOs stand after a run: what they were told last, and where their shafts come to rest.

A command is exact the moment the chip has answered it. A shaft is not: friction holds it a few counts short until the
integral term has grown enough to pull it on, which takes some tenths of a second.

    shaft      ______________ command
           __/      <- creeps home, WITHIN_NS at most; then it is judged wherever it is
    ______/
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from machines.bringup import Connection, drivers
from machines.outcome import Outcome
from machines.schema import MachineConfig
from machines.wiring import SERVO_STANDS_WITHIN, motors
from nmc.chips.common import LOAD_TRAJECTORY, STOP_MOTOR
from nmc.chips.picservo import STOP_HERE
from nmc.link import Link
from nmc.picservo import PicServo
from nmc.program import Evidence
from planner.motors import ServoMotor
from planner.stream_servo import STOP_HERE_BYTES

WITHIN_NS = 1_500_000_000
POLL_NS = 10_000_000
STILL_COUNTS = 1
"""Between two reads ``POLL_NS`` apart a shaft that has come to rest moves no further than an encoder edge."""


class LastCommands:
    """Where every PIC-SERVO was told to stand by the last command that its chip has answered.

    ``counts``: by motor; a motor that was last told to move on is not in it. ``needed``: there are any PIC-SERVOs.
    """

    def __init__(self, config: MachineConfig) -> None:
        self._names = {(m.bus, m.address): m.name for m in motors(config) if isinstance(m, ServoMotor)}
        self.counts: dict[str, int] = {}
        self.needed = bool(self._names)

    def see(self, evidence: Evidence) -> None:
        """Take note of an exchange."""
        exchange = evidence.exchange
        if evidence.status is None or exchange.command not in (STOP_MOTOR, LOAD_TRAJECTORY):
            return
        name = self._names.get((exchange.bus, exchange.address))
        if name is None:
            return
        if exchange.command == STOP_MOTOR and len(exchange.data) == STOP_HERE_BYTES and exchange.data[0] & STOP_HERE:
            self.counts[name] = int.from_bytes(exchange.data[1:5], "little", signed=True)
        else:
            self.counts.pop(name, None)


def settle(connection: Connection, wanted: Mapping[str, int]) -> None:
    """Wait until the shafts have come to where they are ``wanted`` (counts by motor), at most ``WITHIN_NS``."""
    servos = {name: chip for name, chip in drivers(connection).items() if isinstance(chip, PicServo)}
    reads: dict[str, Callable[[], int]] = {name: servos[name].position for name in wanted}
    _wait(connection.links[0], reads, wanted)


def with_settled_shafts(connection: Connection, outcome: Outcome) -> Outcome:
    """On the twin, let time pass as ``settle`` does, without a byte on the wire, and see where the shafts then stand.

    Take its trace before: this belongs to no run.
    """
    simulation, wanted = connection.simulation, outcome.commanded
    if simulation is None or not wanted:
        return outcome
    servos = simulation.servos()

    def read_of(name: str) -> Callable[[], int]:
        return lambda: servos[name].position

    shafts = _wait(connection.links[0], {name: read_of(name) for name in wanted}, wanted)
    return replace(outcome, shafts=outcome.shafts | shafts)


def _wait(link: Link, reads: Mapping[str, Callable[[], int]], wanted: Mapping[str, int]) -> dict[str, int]:
    """Read until every shaft is in its place and stands, or the time is over; what was read last."""
    deadline_ns = link.now_ns() + WITHIN_NS
    stood = {name: read() for name, read in reads.items()}
    while link.now_ns() < deadline_ns:
        link.sleep_until(link.now_ns() + POLL_NS)
        now = {name: read() for name, read in reads.items()}
        still = all(abs(now[name] - stood[name]) <= STILL_COUNTS for name in now)
        stood = now
        if still and all(abs(now[name] - wanted[name]) <= SERVO_STANDS_WITHIN for name in now):
            break
    return stood
