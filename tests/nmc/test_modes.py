"""Table 4 and the rules around it, as the guard in front of every load."""

from __future__ import annotations

import pytest

from nmc.chips.table4 import TABLE_4, Cell, Mode, goal_of
from nmc.errors import LocalFault, RemoteFault
from nmc.guard import Guard
from nmc.modes import StepTracker
from nmc.program import Exchange
from nmc.servo_modes import ServoTracker

MOVING, REST = 0x09, 0x08
LOAD, START, STOP, PARAMETERS = 4, 5, 7, 6


def load(position: int | None = None, speed: int = 0, acc: int = 0, count: int = 0, flags: int = 0) -> bytes:
    control = flags
    body = b""
    if position is not None:
        control |= 1
        body += position.to_bytes(4, "little", signed=True)
    if speed:
        control |= 2
        body += bytes([speed])
    if acc:
        control |= 4
        body += bytes([acc])
    if count:
        control |= 8
        body += count.to_bytes(2, "little") + b"\x01"
    return bytes([control]) + body


def in_mode(mode: Mode) -> StepTracker:
    """A tracker that has been led into ``mode`` by legal commands."""
    tracker = StepTracker(1)
    tracker.executed(PARAMETERS, bytes(5))
    send(tracker, LOAD, load(None, 9, 9, flags=0x80), REST)
    send(tracker, STOP, b"\x05", REST)
    way = {
        Mode.TRAPEZOID: load(1000, 100, 10),
        Mode.VELOCITY: load(None, 100, 10),
        Mode.UNPROFILED_STOP: load(1000, count=60000),
        Mode.UNPROFILED: load(count=60000),
    }
    if mode is not Mode.STOPPED:
        data = way[mode]
        send(tracker, LOAD, bytes([data[0] | 0x80]) + data[1:], REST)
    assert tracker.mode is mode
    return tracker


def send(tracker: StepTracker | ServoTracker, command: int, data: bytes = b"", status: int = MOVING) -> None:
    tracker.check(command, data, endless=True)
    tracker.answered(command, data, status, b"")


LOADS = {
    "position": load(2000),
    "position+speed": load(2000, 50),
    "position+speed+acc": load(2000, 50, 5),
    "speed": load(None, 50),
    "acc": load(None, 0, 5),
    "nothing": load(),
    "count": load(count=50000),
    "position+count": load(2000, count=50000),
    "speed+count": load(None, 50, count=50000),
    "acc+count": load(None, 0, 5, 50000),
    "position+speed+count": load(2000, 50, count=50000),
}
ALLOWED = {
    Mode.STOPPED: {
        "position": Mode.TRAPEZOID,
        "position+speed": Mode.TRAPEZOID,
        "position+speed+acc": Mode.TRAPEZOID,
        "speed": Mode.VELOCITY,
        "acc": Mode.VELOCITY,
        "nothing": Mode.VELOCITY,
        "count": Mode.UNPROFILED,
        "position+count": Mode.UNPROFILED_STOP,
    },
    Mode.TRAPEZOID: {"count": Mode.UNPROFILED_STOP},
    Mode.VELOCITY: {
        "speed": Mode.VELOCITY,
        "acc": Mode.VELOCITY,
        "nothing": Mode.VELOCITY,
        "count": Mode.UNPROFILED,
    },
    Mode.UNPROFILED_STOP: {
        "speed": Mode.VELOCITY,
        "acc": Mode.VELOCITY,
        "nothing": Mode.VELOCITY,
        "count": Mode.UNPROFILED_STOP,
    },
    Mode.UNPROFILED: {
        "speed": Mode.VELOCITY,
        "acc": Mode.VELOCITY,
        "nothing": Mode.VELOCITY,
        "count": Mode.UNPROFILED,
    },
}


@pytest.mark.parametrize("mode", list(Mode))
@pytest.mark.parametrize("name", list(LOADS))
def test_every_load_from_every_mode(mode: Mode, name: str) -> None:
    tracker = in_mode(mode)
    data = LOADS[name]
    goal = ALLOWED[mode].get(name)
    assert goal_of(mode, data[0]) is goal
    if goal is None:
        with pytest.raises(LocalFault, match="Table 4"):
            tracker.check(LOAD, data, endless=True)
        return
    send(tracker, LOAD, data)
    assert tracker.mode is mode, "a load without start-now has no effect"
    send(tracker, START)
    assert tracker.mode is goal


def test_all_25_cells_stand_in_the_table() -> None:
    assert len(TABLE_4) == 25
    assert sum(isinstance(cell, Cell) for cell in TABLE_4.values()) == 12


def test_streaming_position_and_count_then_counts() -> None:
    tracker = in_mode(Mode.STOPPED)
    send(tracker, LOAD, load(1000, count=40000), REST)
    send(tracker, START, status=REST)
    for count in (45000, 50000, 55000):
        send(tracker, LOAD, load(count=count))
        send(tracker, START)
    with pytest.raises(LocalFault, match="Table 4"):
        tracker.check(LOAD, load(2000, count=60000))
    tracker.at_rest()
    tracker.check(LOAD, load(2000, count=60000))


def test_the_moving_bit_tells_of_a_reached_stop() -> None:
    tracker = in_mode(Mode.UNPROFILED_STOP)
    tracker.answered(0xE, b"", REST, b"")
    assert tracker.mode is Mode.STOPPED


def test_a_pending_count_does_not_start_once_the_stop_is_reached() -> None:
    tracker = in_mode(Mode.UNPROFILED_STOP)
    send(tracker, LOAD, load(count=50000), REST)  # the reply says: already stopped
    with pytest.raises(LocalFault, match="would mean UNPROFILED"):
        tracker.check(START, b"")


def test_a_count_started_at_once_on_a_stopped_axis_is_reported() -> None:
    tracker = in_mode(Mode.UNPROFILED_STOP)
    data = load(count=50000, flags=0x80)
    tracker.check(LOAD, data)
    with pytest.raises(RemoteFault, match="runs for ever"):
        tracker.answered(LOAD, data, REST, b"")
    assert tracker.mode is Mode.UNPROFILED


def test_a_count_from_stopped_must_be_meant() -> None:
    tracker = in_mode(Mode.STOPPED)
    with pytest.raises(LocalFault, match="for ever"):
        tracker.check(LOAD, load(count=50000))
    tracker.check(LOAD, load(count=50000), endless=True)


def running_to(position: int) -> StepTracker:
    """A tracker that runs forward to a stop position."""
    tracker = in_mode(Mode.STOPPED)
    send(tracker, LOAD, load(position, count=60000, flags=0x80), REST)
    return tracker


def test_a_stop_position_may_be_kept_for_the_rest_to_come() -> None:
    """Section 5.1: no effect whatsoever until a Start Motion, which then finds it Stopped."""
    tracker = running_to(1000)
    tracker.check(LOAD, load(2000, count=60000), for_rest=True)
    tracker.answered(LOAD, load(2000, count=60000), MOVING, b"")
    assert tracker.mode is Mode.UNPROFILED_STOP
    assert tracker.awaits_rest
    with pytest.raises(LocalFault, match="nothing allowed"):
        tracker.check(START, b"")
    tracker.at_rest()
    send(tracker, START, status=REST)
    assert tracker.mode is Mode.UNPROFILED_STOP
    assert tracker.stop_position == 2000


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (load(2000, count=60000, flags=0x80), "not be started at once"),
        (load(2000, count=60000, flags=0x10), "a reversal needs a Stop Motor first"),
        (load(1000, count=60000), "no length"),
        (load(900, count=60000), "points the other way"),
        (load(count=60000), "runs for ever"),
    ],
)
def test_what_is_kept_for_the_rest_is_judged_as_if_it_stood_there(data: bytes, words: str) -> None:
    with pytest.raises(LocalFault, match=words):
        running_to(1000).check(LOAD, data, for_rest=True)


@pytest.mark.parametrize("mode", [Mode.VELOCITY, Mode.UNPROFILED])
def test_a_move_without_end_has_no_rest_to_come(mode: Mode) -> None:
    with pytest.raises(LocalFault, match="Table 4"):
        in_mode(mode).check(LOAD, load(2000, count=60000), for_rest=True)


def test_a_group_start_of_kept_loads_needs_every_member_at_rest() -> None:
    guard = Guard()
    for address in (1, 2):
        tracker = running_to(1000)
        tracker.address, tracker.group, tracker.leader = address, 0x81, address == 1
        guard.enrol(tracker)
        kept = Exchange(address, LOAD, load(2000, count=60000), for_rest=True)
        guard.check(kept)
        guard.settle(kept, tracker, MOVING, b"")
    for rests in ((), (1,), (2,)):
        with pytest.raises(LocalFault, match="nothing allowed"):
            guard.check(Exchange(0x81, START))
        guard.check(Exchange(1, 0xE, at_rest=rests))
    guard.check(Exchange(0x81, START, at_rest=(1, 2)))


def test_a_stale_start_is_refused() -> None:
    tracker = in_mode(Mode.UNPROFILED_STOP)
    with pytest.raises(LocalFault, match="old load"):
        tracker.check(START, b"")


@pytest.mark.parametrize("mode", [Mode.VELOCITY, Mode.UNPROFILED_STOP, Mode.UNPROFILED])
def test_direction_does_not_change_while_moving(mode: Mode) -> None:
    tracker = in_mode(mode)
    data = load(None, 50, flags=0x10) if mode is Mode.VELOCITY else load(count=50000, flags=0x10)
    with pytest.raises(LocalFault, match="direction"):
        tracker.check(LOAD, data)


def test_a_reversal_from_a_reached_stop_needs_stop_motor() -> None:
    tracker = in_mode(Mode.UNPROFILED_STOP)
    tracker.at_rest()
    back = load(0, count=50000, flags=0x10)
    with pytest.raises(LocalFault, match="Stop Motor first"):
        tracker.check(LOAD, back)
    tracker.check(LOAD, load(2000, count=50000))
    send(tracker, STOP, b"\x05", REST)
    tracker.check(LOAD, back)


def test_a_strict_machine_wants_stop_motor_after_every_run() -> None:
    tracker = StepTracker(1, reached_stop_is_stopped=False)
    send(tracker, PARAMETERS, bytes([0, 1, 0, 0, 0]), REST)
    send(tracker, LOAD, load(1000, count=60000, flags=0x80), REST)
    send(tracker, 0xE, status=REST)
    with pytest.raises(LocalFault, match="reached_stop_is_stopped"):
        tracker.check(LOAD, load(2000, count=60000))


def test_after_a_smooth_stop_a_trapezoid_needs_its_speed() -> None:
    tracker = in_mode(Mode.TRAPEZOID)
    send(tracker, STOP, b"\x09")
    with pytest.raises(LocalFault, match="Table 4"):
        tracker.check(LOAD, load(5000, 10))
    send(tracker, 0xE, status=REST)
    with pytest.raises(LocalFault, match="speed"):
        tracker.check(LOAD, load(5000))
    send(tracker, LOAD, load(5000, 10), REST)


def test_a_profile_needs_a_speed_and_an_acceleration_that_were_started() -> None:
    tracker = StepTracker(1)
    tracker.executed(PARAMETERS, bytes(5))
    with pytest.raises(LocalFault, match="no acceleration"):
        tracker.check(LOAD, load(1000, 10))
    send(tracker, LOAD, load(1000, 10, 10), REST)
    with pytest.raises(LocalFault, match="no speed"):
        tracker.check(LOAD, load(2000))  # would overwrite the load that brought them
    send(tracker, START, status=REST)
    send(tracker, 0xE, status=REST)
    send(tracker, LOAD, load(2000), REST)


def test_goal_distance_is_at_most_the_largest_position() -> None:
    tracker = in_mode(Mode.STOPPED)
    tracker.seen(REST, (-10).to_bytes(4, "little", signed=True), 1)
    with pytest.raises(LocalFault, match="0x7FFFFFFF"):
        tracker.check(LOAD, load(0x7FFFFFFF, 10, 10))
    tracker.check(LOAD, load(0x7FFFFFFF - 10, 10, 10))


def test_a_stop_position_behind_the_direction_is_refused() -> None:
    tracker = in_mode(Mode.STOPPED)
    tracker.seen(REST, (100).to_bytes(4, "little"), 1)
    tracker.check(LOAD, load(200, count=60000))
    tracker.check(LOAD, load(0, count=60000, flags=0x10))
    for bad in (load(0, count=60000), load(200, count=60000, flags=0x10)):
        with pytest.raises(LocalFault, match="points the other way"):
            tracker.check(LOAD, bad)


def test_a_move_of_no_length_is_refused_where_the_position_is_known() -> None:
    tracker = in_mode(Mode.STOPPED)
    tracker.executed(0, b"")
    for nowhere in (load(0, 10, 10), load(0, count=60000)):
        with pytest.raises(LocalFault, match="no length"):
            tracker.check(LOAD, nowhere)
    send(tracker, LOAD, load(5, count=60000, flags=0x80), REST)
    tracker.at_rest()
    tracker.check(LOAD, load(0, 10, 10))


SERVO_DONE, SERVO_BUSY = 0x09, 0x08


def servo(control: int, position: int = 0, velocity: int = 0, acceleration: int = 0) -> bytes:
    data = bytes([control])
    for bit, value in ((1, position), (2, velocity), (4, acceleration)):
        if control & bit:
            data += value.to_bytes(4, "little", signed=bit == 1)
    return data


@pytest.fixture
def tuned() -> ServoTracker:
    tracker = ServoTracker(1)
    tracker.executed(6, bytes(14))
    return tracker


def test_servo_loads_while_moving(tuned: ServoTracker) -> None:
    send(tuned, LOAD, servo(0x97, 1000, 65536, 100), SERVO_BUSY)
    with pytest.raises(LocalFault, match="while moving"):
        tuned.check(LOAD, servo(0x97, 2000, 65536, 100))
    with pytest.raises(LocalFault, match="while moving"):
        tuned.check(0, b"")
    send(tuned, LOAD, servo(0x17, 2000, 65536, 100), SERVO_BUSY)
    with pytest.raises(LocalFault, match="while moving"):
        tuned.check(START, b"")
    send(tuned, LOAD, servo(0xB6, 0, 65536, 100), SERVO_BUSY)
    send(tuned, 0xE, b"", SERVO_DONE)
    assert tuned.moving, "move_done at constant velocity is not rest"
    send(tuned, STOP, b"\x05", SERVO_DONE)
    assert not tuned.moving
    send(tuned, LOAD, servo(0x97, 1000, 65536, 100), SERVO_BUSY)
    send(tuned, 0xE, b"", SERVO_DONE)
    send(tuned, LOAD, servo(0x91, 0), SERVO_BUSY)


def test_servo_needs_gains_velocity_and_acceleration() -> None:
    tracker = ServoTracker(1)
    with pytest.raises(LocalFault, match="Set Gain"):
        tracker.check(LOAD, servo(0x97, 1000, 65536, 100))
    tracker.executed(6, bytes(14))
    with pytest.raises(LocalFault, match="never ends"):
        tracker.check(LOAD, servo(0x91, 1000))


def test_stop_here_stream_passes(tuned: ServoTracker) -> None:
    for position in range(0, 10_000, 700):
        send(tuned, STOP, b"\x11" + position.to_bytes(4, "little"), SERVO_DONE)
    with pytest.raises(LocalFault):
        tuned.check(STOP, b"\x11\x00\x00\x00\x80")
    with pytest.raises(LocalFault):
        tuned.check(STOP, b"\x11")
