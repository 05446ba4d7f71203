"""What the watchdog switches off: behind the stops of the motion, and again until it is answered."""

from __future__ import annotations

from nmc.chips.common import STOP_MOTOR
from nmc.watchdog import Phase, Switch, Ward, Watchdog
from nmc.wire import checksum, pack

FLOOD = Switch(3, pack(3, 0x8, b"\x10"))
SPINDLE = Switch(4, pack(4, STOP_MOTOR, b"\x02"))
GOOD = bytes([0x08])
STANDS = GOOD + bytes([checksum(GOOD)])


def expired(*switches: Switch) -> Watchdog:
    dog = Watchdog([Ward(1, "pic-step"), Ward(2, "pic-servo")], (0x81, 0x82), baud=115200, switches=switches)
    dog.arm(0)
    assert dog.check(dog.due_ns or 0)
    return dog


def carried_out(dog: Watchdog, answers: dict[bytes, list[bytes]]) -> list[bytes]:
    """What it says, with these answers to each packet in turn; good ones when they have run out."""
    said: list[bytes] = []
    now_ns = 0
    while dog.phase is not Phase.STANDING and len(said) < 60:
        packet = dog.next_bytes(now_ns)
        said.append(packet)
        now_ns = dog.listen_until_ns
        left = answers.get(packet, [])
        dog.heard(left.pop(0) if left else STANDS)
    return said


def test_motors_are_told_to_stop_before_anything_is_switched_off() -> None:
    said = carried_out(expired(SPINDLE, FLOOD), {})
    stops = [packet for packet in said if packet[2:3] == bytes([0x17]) and packet[1] != SPINDLE.address]
    assert [packet[1] for packet in stops] == [0x81, 0x82, 1, 2]
    assert said.index(SPINDLE.packet) > max(said.index(packet) for packet in stops)
    assert said.index(FLOOD.packet) == said.index(SPINDLE.packet) + 1
    assert said.count(SPINDLE.packet) == said.count(FLOOD.packet) == 1


def test_what_was_not_answered_well_is_said_again() -> None:
    rejected = bytes([0x0A, checksum(bytes([0x0A]))])  # a communications error
    said = carried_out(expired(SPINDLE, FLOOD), {SPINDLE.packet: [b"", rejected, b"\x08\x09"]})
    assert said.count(SPINDLE.packet) == 4
    assert said.count(FLOOD.packet) == 1


def test_a_motor_that_never_answers_does_not_keep_the_spindle_on() -> None:
    dog = expired(SPINDLE)
    packet = dog.next_bytes(0)
    said = []
    for _ in range(40):
        dog.heard(b"" if packet[1:2] == b"\x02" else STANDS)
        packet = dog.next_bytes(0)
        said.append(packet)
    assert said.count(SPINDLE.packet) == 1
    assert dog.phase is Phase.STOPPING


def test_without_switches_it_stands_as_ever() -> None:
    assert FLOOD.packet not in carried_out(expired(), {})
