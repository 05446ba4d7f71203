"""Several buses at once: one command in flight on each, and what goes wrong on one holds up none of the others."""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator, Sequence

import pytest

from nmc.bus import Bus
from nmc.errors import LinkTimeout, LocalFault, NmcError, RemoteFault
from nmc.executor import play_together, stop_all, stop_together
from nmc.link import Link
from nmc.program import Evidence, Exchange
from nmc.recording_link import RecordingLink
from nmc.serial_link import DescriptorLink
from nmc.setup import ModuleExpectation, start_up
from nmc.talk import Wait
from nmc.together import Together
from nmc.watchdog import GuardedLink, Phase, Ward, Watchdog
from sim.build import Simulation, build
from sim.spec import BusSpec, StepModule

NOP, LOAD, STOP, READ = 0xE, 4, 7, 3
RUN = bytes([0x89]) + (100_000).to_bytes(4, "little") + (60000).to_bytes(2, "little") + b"\x01"
MS = 1_000_000


class Listed:
    """A source that gives what it was given, and keeps what came back."""

    def __init__(self, exchanges: Sequence[Exchange]) -> None:
        self.left = list(exchanges)
        self.heard: list[Evidence] = []

    def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
        self.heard += [evidence] if evidence is not None else []
        return self.left.pop(0) if self.left else None


class Rig:
    """Buses of one simulated world, a PIC-STEP and its neighbour on each, ready to move."""

    def __init__(self, buses: int = 2, jitter_ns: int = 0, wrap: type | None = None) -> None:
        specs = [
            BusSpec(f"b{n}", (StepModule(f"x{n}"), StepModule(f"y{n}")), host_jitter_max_ns=jitter_ns)
            for n in range(buses)
        ]
        self.simulation: Simulation = build(specs, seed=1)
        self.links: list[Link] = [wrap(link) if wrap else link for link in self.simulation.links]
        self.buses = [Bus(link, name=f"b{n}") for n, link in enumerate(self.links)]
        for bus in self.buses:
            start_up(bus, [ModuleExpectation("pic-step", leader=False)] * 2)
            for address in (1, 2):
                bus.exchange(Exchange(address, 6, bytes([0, 1, 10, 5, 0])))
                bus.exchange(Exchange(address, STOP, b"\x01"))

    def moving(self) -> list[str]:
        return [name for name, module in self.simulation.modules.items() if module.moving]


def polls(count: int, address: int = 1) -> Listed:
    return Listed([Exchange(address, NOP) for _ in range(count)])


def overlaps(first: Sequence[Evidence], second: Sequence[Evidence]) -> int:
    return sum(a.sent_ns < b.replied_ns and b.sent_ns < a.replied_ns for a in first for b in second)


def test_buses_overlap_and_none_is_slower_than_alone() -> None:
    alone, both = Rig(), Rig()
    begin_ns = alone.links[0].now_ns()
    assert begin_ns == both.links[0].now_ns()
    list(play_together(alone.buses[:1], {0: polls(50)}))
    sources = {0: polls(50), 1: polls(50)}
    said = list(play_together(both.buses, sources))
    assert len(said) == 100
    assert both.links[0].now_ns() - begin_ns < 1.05 * (alone.links[0].now_ns() - begin_ns)
    assert overlaps(sources[0].heard, sources[1].heard) >= 50
    assert all(each.status is not None for each in said)
    assert both.simulation.violations == []


def test_one_bus_played_together_sends_the_bytes_that_it_sends_alone() -> None:
    exchanges = [Exchange(1, NOP), Exchange(1, READ, b"\x01", send_at_ns=0), Exchange(0x82, 0xC), Exchange(2, NOP)]
    logs = []
    for together in (False, True):
        rig = Rig(buses=1, jitter_ns=200_000)
        now = rig.links[0].now_ns()
        timed = [Exchange(e.address, e.command, e.data, send_at_ns=now + n * 3 * MS) for n, e in enumerate(exchanges)]
        if together:
            list(play_together(rig.buses, {0: Listed(timed)}))
        else:
            for exchange in timed:
                rig.buses[0].exchange(exchange)
        trace = rig.simulation.trace()
        logs.append((trace.bus_ns.tolist(), trace.bus_byte.tolist(), rig.links[0].now_ns()))
    assert logs[0] == logs[1]


def test_a_bus_that_waits_for_its_time_holds_up_no_other() -> None:
    rig = Rig()
    now = rig.links[0].now_ns()
    late = Listed([Exchange(1, NOP, send_at_ns=now + 50 * MS)])
    said = list(play_together(rig.buses, {0: late, 1: polls(10)}))
    assert [each.sent_ns for each in said][-1] == now + 50 * MS
    assert said[9].replied_ns < now + 15 * MS


def test_silent_groups_and_different_lengths_on_several_buses() -> None:
    rig = Rig(buses=3, jitter_ns=MS)
    sources = {n: Listed([Exchange(1, READ, b"\x3f"), Exchange(0x82, 0xC), Exchange(2, NOP)] * 5) for n in range(3)}
    said = list(play_together(rig.buses, sources))
    assert len(said) == 45
    assert {len(each.extra) for each in said if each.exchange.command == READ} == {14}
    assert rig.simulation.violations == []


def test_a_lost_answer_is_retried_while_the_other_bus_goes_on() -> None:
    rig = Rig()
    deaf = [1]

    def noise(coming: list[tuple[int, int]]) -> list[tuple[int, int]]:
        deaf[0] -= 1
        return [] if deaf[0] >= 0 else coming

    rig.simulation.buses[0].status.noise = noise
    sources = {0: polls(1), 1: polls(40)}
    said = list(play_together(rig.buses, sources))
    assert len(said) == 41
    assert rig.buses[0].counters.retries == 1
    assert sources[0].heard[0].replied_ns > 40 * MS + rig.simulation.world.now_ns - 80 * MS
    gaps = [b.sent_ns - a.replied_ns for a, b in zip(sources[1].heard, sources[1].heard[1:], strict=False)]
    assert max(gaps) < MS, "bus 1 never waited"


def test_an_error_of_one_bus_leaves_the_other_when_its_answer_is_in() -> None:
    rig = Rig()
    rig.simulation.buses[0].status.noise = lambda coming: []
    sources = {0: Listed([Exchange(1, LOAD, RUN)]), 1: polls(10_000)}
    with pytest.raises(LinkTimeout):
        list(play_together(rig.buses, sources))
    assert rig.buses[0].guard.modules[1].unsure
    assert rig.simulation.violations == []
    rig.simulation.buses[0].status.noise = None
    assert stop_together(rig.buses) >= 1
    rig.links[0].sleep_until(rig.links[0].now_ns() + 5 * MS)
    assert rig.moving() == []
    assert rig.simulation.violations == []
    assert rig.buses[1].exchange(Exchange(1, NOP)).status is not None


def test_what_is_refused_before_it_leaves_ends_all() -> None:
    rig = Rig()
    bad = Listed([Exchange(1, NOP), Exchange(1, LOAD, b"\x08\x00\x00\x01")])
    with pytest.raises(LocalFault):
        list(play_together(rig.buses, {0: bad, 1: polls(10_000)}))
    assert rig.simulation.violations == []


@pytest.mark.parametrize("taken", range(1, 9))
def test_closing_it_in_the_middle_leaves_silent_lines(taken: int) -> None:
    rig = Rig(jitter_ns=300_000)
    now = rig.links[0].now_ns()
    waiting = Listed([Exchange(1, NOP, send_at_ns=now + 900 * MS)])
    playing = play_together(rig.buses, {0: waiting, 1: polls(1000)})
    for _ in range(taken):
        next(playing)
    playing.close()
    assert rig.links[0].now_ns() < now + 40 * MS, "what waited to be sent was dropped"
    for bus in rig.buses:
        assert bus.exchange(Exchange(1, NOP)).status is not None
    assert rig.simulation.violations == []


def test_a_load_whose_answer_is_given_up_leaves_its_module_unsure() -> None:
    rig = Rig()
    together = Together[Evidence](rig.buses)
    with together:
        together.begin(0, rig.buses[0].talk(Exchange(1, LOAD, RUN)))
        rig.simulation.buses[0].status.noise = lambda coming: []
        begun_ns = rig.links[0].now_ns()
    assert rig.links[0].now_ns() - begun_ns < 25 * MS
    with pytest.raises(LocalFault, match="unknown"):
        rig.buses[0].exchange(Exchange(1, LOAD, b"\x08" + (60000).to_bytes(2, "little") + b"\x01"))


def test_somebody_else_may_speak_between_two_evidences() -> None:
    rig = Rig()
    read = []
    sources = {0: polls(20), 1: polls(20, address=2)}
    for evidence in play_together(rig.buses, sources):
        for bus in rig.buses:
            read.append(bus.exchange(Exchange(2, READ, b"\x01")).status)
        assert evidence.status is not None
    assert len(read) == 80
    assert all(status is not None for status in read)
    assert [len(source.heard) for source in sources.values()] == [20, 20]
    assert rig.simulation.violations == []
    assert all(bus.clear is None for bus in rig.buses)


def test_two_commands_on_one_bus_are_refused() -> None:
    rig = Rig()
    with Together[Evidence](rig.buses) as together:
        together.begin(0, rig.buses[0].talk(Exchange(1, NOP)))
        with pytest.raises(ValueError, match="in flight on bus 0"):
            together.begin(0, rig.buses[0].talk(Exchange(1, NOP)))


def test_stops_go_to_all_buses_at_the_same_time() -> None:
    rig = Rig(buses=3)
    for bus in rig.buses:
        for address in (1, 2):
            bus.exchange(Exchange(address, LOAD, RUN))
    assert len(rig.moving()) == 6
    alone = Rig(buses=1)
    begin_ns = alone.links[0].now_ns()
    stop_all(alone.buses[0])
    alone_ns = alone.links[0].now_ns() - begin_ns
    begin_ns = rig.links[0].now_ns()
    stop_together(rig.buses)
    assert rig.links[0].now_ns() - begin_ns < 1.2 * alone_ns
    assert rig.moving() == []
    assert rig.simulation.violations == []


def test_a_bus_that_answers_no_more_holds_up_no_stop() -> None:
    rig = Rig()
    for bus in rig.buses:
        bus.exchange(Exchange(1, LOAD, RUN))
    for module in ("x0", "y0"):
        rig.simulation.modules[module].broken = True
    rig.simulation.buses[0].rewire()
    begin_ns = rig.links[0].now_ns()
    with pytest.raises(NmcError, match="bus b0, module 1: could not be stopped: module 1, 2"):
        stop_together(rig.buses, rounds=3)
    trace = rig.simulation.trace()
    stops = trace.bus_ns[(trace.bus_line == 2) & (trace.bus_ns > begin_ns) & (trace.bus_byte == 0x17)]
    assert stops[0] < begin_ns + 2 * MS, "the other bus was told at once"
    assert not rig.simulation.modules["x1"].moving


def test_a_port_that_is_gone_holds_up_no_stop() -> None:
    rig = Rig()
    rig.buses[1].exchange(Exchange(1, LOAD, RUN))

    def gone(data: bytes) -> None:
        raise NmcError("port: it is gone")

    rig.links[0].write = gone  # type: ignore[method-assign]
    with pytest.raises(NmcError, match="it is gone"):
        stop_together(rig.buses)
    assert rig.moving() == []


def test_every_bus_that_could_not_be_stopped_is_named() -> None:
    rig = Rig()
    for bus in rig.simulation.buses:
        bus.status.noise = lambda coming: []
    with pytest.raises(NmcError, match=r"bus b0, module 1: could .* 1, 2; bus b1, module 1: could .* 1, 2"):
        stop_together(rig.buses, rounds=2)


def test_records_are_kept_of_each_bus() -> None:
    rig = Rig(wrap=RecordingLink)
    before = [len(link.chunks) for link in rig.links]
    list(play_together(rig.buses, {0: polls(5), 1: polls(7)}))
    kept = [link.chunks[n:] for link, n in zip(rig.links, before, strict=True)]
    assert [sum(chunk.line == ">" for chunk in each) for each in kept] == [5, 7]
    assert [sum(len(chunk.data) for chunk in each if chunk.line == "<") for each in kept] == [10, 14]


def test_a_bus_with_nothing_to_say_still_shows_its_watchdog_that_the_host_lives() -> None:
    rig = Rig()
    dogs = [Watchdog([Ward(1, "pic-step"), Ward(2, "pic-step")], (0x81, 0x82), baud=115200) for _ in rig.buses]
    buses = [Bus(GuardedLink(link, dog)) for link, dog in zip(rig.links, dogs, strict=True)]
    for bus, old in zip(buses, rig.buses, strict=True):
        bus.guard = old.guard
        bus.set_host_baud(115200)
    for dog in dogs:
        dog.arm(rig.links[0].now_ns())
    now = rig.links[0].now_ns()
    long = Listed([Exchange(1, NOP, send_at_ns=now + n * 45 * MS) for n in range(1, 10)])
    list(play_together(buses, {0: long, 1: polls(3)}))
    assert [dog.phase for dog in dogs] == [Phase.WATCHING] * 2
    assert rig.links[0].now_ns() > now + 400 * MS


def test_links_that_cannot_be_waited_on_together_are_refused(make_rig) -> None:
    rigs = [make_rig(3), make_rig(3)]
    with pytest.raises(ValueError, match="FakeLink cannot be waited on"):
        list(play_together([rig.bus for rig in rigs], {0: polls(1), 1: polls(1)}))
    assert stop_together([rigs[0].bus]) == 1


class Pty(DescriptorLink):
    """A pseudo-terminal with a module behind it that answers every packet at once."""

    def __init__(self, answers: bytes) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        super().__init__(slave, "pty")
        self.answers = answers

    def write(self, data: bytes) -> None:
        super().write(data)
        os.read(self.master, len(data))
        if self.answers:
            os.write(self.master, self.answers)

    def close(self) -> None:
        os.close(self.master)
        os.close(self.descriptor)


@pytest.fixture
def ptys() -> Iterator[list[Pty]]:
    links = [Pty(b"\x08\x08"), Pty(b"\x08\x08")]
    yield links
    for link in links:
        link.close()


def test_two_descriptors_are_waited_on_with_one_select(ptys: list[Pty]) -> None:
    buses = [Bus(link) for link in ptys]
    sources = {0: polls(20), 1: polls(20)}
    said = list(play_together(buses, sources))
    assert [each.status for each in said] == [8] * 40
    assert [len(source.heard) for source in sources.values()] == [20, 20]


def test_a_descriptor_with_half_an_answer_is_not_ready(ptys: list[Pty]) -> None:
    one, other = ptys
    os.write(one.master, b"\x08")
    assert one.receive(2) == b"\x08"
    assert one.receive(2) == b""
    os.write(other.master, b"\x01\x02\x03")
    one.root.wait_first([(one, 1), (other, 1)], one.now_ns() + 10_000 * MS)
    assert other.receive(2) == b"\x01\x02"
    assert other.receive(0) == b""
    assert other.receive(9) == b"\x03"


def test_a_descriptor_that_is_gone_is_named_and_the_other_bus_left_in_peace(ptys: list[Pty]) -> None:
    one, other = ptys
    one.answers = b""
    other.answers = b""

    class Gone(Listed):
        def next(self, now_ns: int, evidence: Evidence | None) -> Exchange | None:
            if evidence is None:
                return super().next(now_ns, evidence)
            return None

    together = Together[bytes]([Bus(link) for link in ptys])

    def reading(link: Pty) -> Iterator[Wait]:
        got = yield Wait(link.now_ns() + 10_000 * MS, 1)
        return got

    together.begin(0, reading(one))  # type: ignore[arg-type]
    together.begin(1, reading(other))  # type: ignore[arg-type]
    os.close(one.master)
    one.master = os.dup(other.master)
    with pytest.raises(NmcError, match="pty"):
        together.finish_one()
    os.write(other.master, b"\x42")
    assert together.finish_one() == (1, b"\x42")


def test_an_armed_fault_on_one_bus_is_raised_with_its_module() -> None:
    rig = Rig()
    rig.buses[1].arm_faults(2, low=0x08)
    rig.simulation.steppers()["y1"].inputs.power = False
    with pytest.raises(RemoteFault, match="bus b1, module 2") as caught:
        list(play_together(rig.buses, {0: polls(1000), 1: polls(1000, address=2)}))
    assert caught.value.address == 2
    assert rig.simulation.violations == []
