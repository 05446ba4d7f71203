"""Recorded bytes as decoded packets."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nmc.bus import Bus
from nmc.chips import picstep
from nmc.dump import Dump, chunks_of_bytes, dump_lines
from nmc.picstep import PicStep
from nmc.recording_link import Chunk, RecordingLink, read_record
from nmc.setup import ModuleExpectation, start_up
from nmc.wire import pack
from sim.build import build
from sim.spec import BusSpec, StepModule


@pytest.fixture
def recorded():
    """A start-up of two PIC-STEPs, a legal load and one that Table 4 forbids."""
    simulation = build([BusSpec("bus", (StepModule("x"), StepModule("y")))], 3)
    link = RecordingLink(simulation.links[0])
    bus = Bus(link)
    start_up(bus, [ModuleExpectation("pic-step")] * 2)
    step = PicStep(bus, 1)
    step.set_parameters("1x")
    step.stop_motor()
    step.define_status("position")
    step.load_trajectory(position=10, timer_count=60000, start_now=True)
    step.poll(2_000_000)
    link.write(pack(1, 4, b"\x89\x00\x00\x00\x00\x00\xe0\x01"))
    link.read(6, link.now_ns() + 10_000_000)
    return simulation, link


def test_start_up_in_words(recorded) -> None:
    _, link = recorded
    lines = list(dump_lines(link.chunks))
    words = [line.words for line in lines]
    assert "16 nulls" in words
    assert "  0 set_address individual=1 group_byte=255" in words
    assert "  1 power_sense type=3 version=1" in words
    assert "gFF set_baud_rate divisor=10" in words
    assert "host rate 115200 baud" in words
    assert "  1 load_trajectory start_now position=10 timer_count=60000 nearest_speed=1" in words
    assert words[-1].endswith("moving,power_sense position=0")


def test_violations_are_named(recorded) -> None:
    _, link = recorded
    complaints = [text for line in dump_lines(link.chunks) for text in line.complaints]
    assert len(complaints) == 1
    assert "UNPROFILED_STOP" in complaints[0]
    assert "Table 4" in complaints[0]


def test_a_stop_position_that_waits_for_the_rest_is_no_violation() -> None:
    """Loaded in motion, started when the module has arrived, which nothing on the wire says before the answer."""
    simulation = build([BusSpec("bus", (StepModule("x"),))], 3)
    link = RecordingLink(simulation.links[0])
    bus = Bus(link)
    start_up(bus, [ModuleExpectation("pic-step")])
    step = PicStep(bus, 1)
    step.set_parameters("1x")
    step.stop_motor()
    step.load_trajectory(position=10, timer_count=60000, start_now=True)
    count = b"\x60\xea\x01"
    link.write(pack(1, 4, b"\x09\x14\x00\x00\x00" + count))
    link.read(2, link.now_ns() + 10_000_000)
    link.sleep_until(link.now_ns() + 200_000_000)
    link.write(pack(1, 5, b""))
    link.read(2, link.now_ns() + 10_000_000)
    link.sleep_until(link.now_ns() + 200_000_000)
    assert simulation.steppers()["x"].position == 20
    assert simulation.rules() == []
    assert [line for line in dump_lines(link.chunks) if line.complaints] == []


def test_the_simulators_log_decodes_the_same(recorded) -> None:
    simulation, link = recorded
    trace = simulation.trace()
    ours = [line.words for line in dump_lines(link.chunks) if line.direction in "<>"]
    theirs = [line.words for line in dump_lines(chunks_of_bytes(trace.bus_ns, trace.bus_line, trace.bus_byte))]
    assert theirs == ours


def test_a_record_as_text_and_back(recorded) -> None:
    _, link = recorded
    text = list(link.lines())
    assert list(read_record(text)) == link.chunks
    assert list(read_record(["# comment", "", "5 > aa 01 0e 0f"])) == [Chunk(5, ">", b"\xaa\x01\x0e\x0f")]


@pytest.mark.parametrize("line", ["5", "x > aa", "5 > zz", "5 ? aa", "5 > 1ff"])
def test_a_bad_record_names_its_line(line: str) -> None:
    with pytest.raises(ValueError, match="line 2"):
        list(read_record(["1 > aa", line]))


def test_damage_is_shown() -> None:
    chunks = [Chunk(0, ">", b"\xaa\x01\x0e\x10"), Chunk(1, "<", b"\x08\x09"), Chunk(2, "<", b"\x08\x08")]
    lines = list(dump_lines(chunks, picstep.FACTS))
    assert [bool(line.complaints) for line in lines] == [True, True, True]
    assert lines[0].words.endswith("damaged packet")


@given(st.lists(st.tuples(st.sampled_from("<>b"), st.binary(max_size=25)), max_size=30))
def test_no_bytes_make_it_raise(parts: list[tuple[str, bytes]]) -> None:
    dump = Dump()
    for time_ns, (direction, data) in enumerate(parts):
        for line in dump.feed(Chunk(time_ns, direction, data)):
            line.text()
    list(dump.finish())


PACKETS = st.builds(
    pack,
    st.sampled_from([0, 1, 2, 0x81, 0xFF]),
    st.integers(0, 15),
    st.binary(max_size=15),
)
ANSWERS = st.sampled_from([b"\x08\x08", b"\x09\x09", b"\x08\x03\x01\x0c", b"\x08\x00\x04\x0c", b"\x0a\x0a"])


@given(st.lists(st.tuples(PACKETS, ANSWERS), max_size=30))
def test_no_packets_make_it_raise(exchanges: list[tuple[bytes, bytes]]) -> None:
    """Whole packets reach the mode guards, which must take any command too."""
    dump = Dump()
    opening = [(pack(0, 1, b"\x01\xff"), b"\x08\x08"), (pack(1, 3, b"\x20"), b"\x08\x03\x01\x0c")]
    for command, answer in opening + exchanges:
        for direction, data in ((">", command), ("<", answer)):
            for line in dump.feed(Chunk(0, direction, data)):
                line.text()
