"""A host that dies at any byte leaves a machine at rest; a host that comes back finds the bus closed."""

from __future__ import annotations

import pytest

from nmc.errors import NmcError
from nmc.executor import play
from nmc.picstep import PicStep
from nmc.program import Evidence, Exchange
from nmc.setup import set_group
from nmc.watchdog import GuardedLink, Phase, Ward, Watchdog, patrol
from sim.spec import StepModule

GROUPS = (0x81, 0x82)
STREAM_ENDS_AT = 60


class CountStream:
    """Two axes on long legs: a load each and a group Start, and now and then a change of group."""

    def __init__(self) -> None:
        self.number = 0

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        self.number += 1
        if self.number > STREAM_ENDS_AT:
            return None
        turn = self.number % 5
        if turn == 0:
            return Exchange(0x81, 5)
        if turn > 2:
            return Exchange(3, 1, bytes([3, 0x81 if turn == 3 else 0x02]))
        return Exchange(turn, 4, bytes([8]) + (60000 + self.number).to_bytes(2, "little") + b"\x05")


class DyingLink:
    """Lets ``after`` bytes out, then the host is dead: nothing leaves and nothing is heard any more."""

    def __init__(self, link, after: int) -> None:
        self.link, self.left = link, after

    def __getattr__(self, name: str):
        return getattr(self.link, name)

    def write(self, data: bytes) -> None:
        self.link.write(data[: self.left])
        self.left -= len(data)
        if self.left <= 0:
            raise SystemExit


def running(steppers, *, guarded: bool = True):
    """Two axes of three on endless-looking legs, streaming group led by module 1, watchdog armed."""
    simulation, bus = steppers(StepModule("x"), StepModule("y"), StepModule("z"), jitter_ns=200_000)
    wards = [Ward(address, "pic-step") for address in (1, 2, 3)]
    dog = Watchdog(wards, GROUPS, baud=115200, latency_ns=1_000_000)
    for address in (1, 2, 3):
        step = PicStep(bus, address)
        step.set_parameters("2x", minimum_speed=1)
        step.stop_motor()
    set_group(bus, 2, 0x81)
    set_group(bus, 3, 0x82)
    set_group(bus, 1, 0x81, leader=True)
    set_group(bus, 3, 0x82, leader=True)
    for address in (1, 2):
        PicStep(bus, address).load_trajectory(position=100_000, timer_count=60000)
    bus.exchange(Exchange(0x81, 5))
    if guarded:
        bus.link = GuardedLink(bus.link, dog)
    dog.arm(bus.link.now_ns())
    return simulation, bus, dog


def moving(simulation) -> list[str]:
    before = {name: module.position for name, module in simulation.modules.items()}
    simulation.world.run_until(simulation.world.now_ns + 200_000_000)
    simulation.trace()
    return [name for name, module in simulation.modules.items() if module.position != before[name]]


@pytest.mark.parametrize("after", [*range(1, 12), *range(60, 76), 150, 233, 301])
def test_death_at_any_byte_of_the_stream(steppers, after: int) -> None:
    simulation, bus, dog = running(steppers, guarded=False)
    host = bus.link
    bus.link = DyingLink(host, after)
    try:
        for _ in play(bus, CountStream()):
            dog.arm(host.now_ns())
    except SystemExit:
        pass
    died_ns = host.now_ns()
    host.sleep_until(dog.due_ns)
    assert dog.check(host.now_ns())
    patrol(dog, host, rounds=20)
    assert dog.phase is Phase.STANDING
    assert host.now_ns() - died_ns < 100_000_000  # the group stop comes at 50, then everybody is asked
    assert moving(simulation) == []


def test_the_stop_is_in_force_one_exchange_after_the_timeout(steppers) -> None:
    simulation, bus, dog = running(steppers)
    list(play(bus, CountStream()))
    link = bus.link.inner
    last_ns = link.now_ns()
    dog.arm(last_ns)
    link.sleep_until(dog.due_ns)
    dog.check(link.now_ns())
    patrol(dog, link, rounds=20)
    assert moving(simulation) == []
    steps = simulation.trace()
    stopped_ns = max(
        int(first + period * (count - 1))
        for first, period, count in zip(steps.run_first_ns, steps.run_period_ns, steps.run_count, strict=True)
    )
    assert stopped_ns - last_ns < 50_000_000 + 1_500_000


def test_the_second_group_is_stopped_as_soon_as_the_first_has_answered() -> None:
    """Axes of one path may be in both groups: they leave it by their speed times what lies between the stops."""
    dog = Watchdog([Ward(1, "pic-step")], GROUPS, baud=115200, latency_ns=16_000_000)
    dog.trip(0)
    dog.heard(dog.next_bytes(0) and b"")
    at_ns = dog.listen_until_ns
    assert dog.next_bytes(at_ns)[1] == 0x81
    byte_ns, reply_ns = 10 * 1_000_000_000 // 115200, 500_000
    assert 7 * byte_ns + reply_ns <= dog.listen_until_ns - at_ns < 7 * byte_ns + reply_ns + 20_000
    dog.heard(b"")
    assert dog.next_bytes(dog.listen_until_ns)[1] == 0x82


def test_a_take_over_says_nothing_that_the_sheets_forbid(steppers) -> None:
    simulation, bus, dog = running(steppers)
    list(play(bus, CountStream()))
    set_group(bus, 2, 0x82)
    link = bus.link.inner
    link.sleep_until(dog.due_ns)
    dog.check(link.now_ns())
    patrol(dog, link, rounds=20)
    assert moving(simulation) == []
    assert simulation.violations == []


def test_a_living_host_is_left_alone(steppers) -> None:
    simulation, bus, dog = running(steppers)
    list(play(bus, CountStream()))
    bus.link.sleep_until(bus.link.now_ns() + 300_000_000)
    bus.exchange(Exchange(1, 0xE))
    assert not dog.fenced
    assert simulation.violations == []


def test_a_host_that_hangs_and_comes_back_is_fenced(steppers) -> None:
    simulation, bus, dog = running(steppers)
    list(play(bus, CountStream()))
    bus.link.inner.sleep_until(bus.link.now_ns() + 80_000_000)
    with pytest.raises(NmcError, match="holds the bus"):
        bus.exchange(Exchange(1, 0xE))
    assert dog.phase is Phase.STANDING
    assert moving(simulation) == []
    with pytest.raises(NmcError):
        bus.exchange(Exchange(1, 0xE))
    dog.arm(bus.link.now_ns())
    assert dog.fenced
    dog.reset()
    assert bus.exchange(Exchange(1, 0xE)).status is not None


def test_an_idle_watchdog_lets_the_host_sleep(steppers) -> None:
    _, bus, dog = running(steppers)
    dog.disarm()
    bus.link.inner.sleep_until(bus.link.now_ns() + 10_000_000_000)
    bus.exchange(Exchange(1, 7, b"\x05"))
    assert dog.phase is Phase.IDLE


def test_it_repeats_until_the_last_module_stands() -> None:
    dog = Watchdog([Ward(1, "pic-step"), Ward(2, "pic-servo")], (0x81,), baud=115200)
    dog.trip(0)
    answers = {
        b"\xaa\x81\x17\x05\x9d": b"",
        b"\xaa\x01\x17\x05\x1d": b"\x0d\x0d",
        b"\xaa\x01\x0e\x0f": b"\x0d\x0d",  # still moving
        b"\xaa\x02\x17\x05\x1e": b"\x03\x03",  # communications error
    }
    sent = []
    for turn in range(12):
        data = dog.next_bytes(turn)
        sent.append(data)
        dog.heard(answers.get(data, b""))
    assert dog.phase is Phase.STOPPING
    answers[b"\xaa\x01\x0e\x0f"] = b"\x0c\x0c"
    answers[b"\xaa\x02\x17\x05\x1e"] = b"\x09\x09"
    for turn in range(6):
        data = dog.next_bytes(turn)
        dog.heard(answers.get(data, b""))
    assert dog.phase is Phase.STANDING
    assert dog.next_bytes(0) == b""
    assert sent[0] == bytes(16)
    assert sent[1] == b"\xaa\x81\x17\x05\x9d"


def test_too_short_a_timeout_is_refused() -> None:
    with pytest.raises(ValueError, match="nulls and group stops"):
        Watchdog([], (), baud=9600, timeout_ns=20_000_000)
