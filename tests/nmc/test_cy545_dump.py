"""The line of a CY545 as text, from its bytes."""

from nmc.chips.cy545 import RateTable
from nmc.cy545 import Cy545
from nmc.cy545_dump import dump_cy545
from nmc.recording_link import HOST, STATUS, Chunk, RecordingLink
from sim.cy545_host import TextHost

RATES = RateTable(tuple(50.0 + 40.0 * k for k in range(256)), "a table of equal steps")


def words(chunks: list[Chunk]) -> list[str]:
    return [f"{line.direction} {line.words}" for line in dump_cy545(chunks)]


def test_what_the_driver_says_is_told_without_complaint() -> None:
    host = TextHost(RATES)
    link = RecordingLink(host.link)
    driver = Cy545(link, host.link)
    driver.start_up()
    driver.set_rates(10, 60, 200)
    driver.move_to(-400, 2_000_000_000)
    lines = list(dump_cy545(link.chunks))
    said = [f"{line.direction} {line.words}" for line in lines]
    assert said[:4] == ["> carriage return", "> carriage return", "> query P", "< P is 0"]
    moving = ["> number 400", "> counter_clockwise", "> go", "> query P", "< P is 16776816"]
    assert said[-5:] == moving
    assert not any(line.complaints for line in lines)


def test_characters_one_by_one_make_the_same_lines() -> None:
    text = b"N 0FFH\rG\r"
    single = [Chunk(k * 1000, HOST, bytes((value,))) for k, value in enumerate(text)]
    assert words(single) == words([Chunk(0, HOST, text)]) == ["> number 0FFH", "> go"]
    assert [line.time_ns for line in dump_cy545(single)] == [0, 7000]


def test_what_the_manual_does_not_allow_is_complained_of() -> None:
    chunks = [
        Chunk(0, HOST, b"R 0\rN 16777216\rM\rG 1\r?Q\rB x\r"),
        Chunk(9, STATUS, b"P=123\rhello\r"),
        Chunk(20, HOST, b"N 1"),
    ]
    lines = list(dump_cy545(chunks))
    assert len(lines) == 9
    assert all(line.complaints for line in lines)
    assert lines[-1].words == "unfinished"
