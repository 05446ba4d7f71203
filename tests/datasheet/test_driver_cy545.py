"""The driver of the CY545 against the chip's manual: what leaves the host, and what never does."""

from __future__ import annotations

import numpy as np
import pytest

from nmc.chips.cy545 import BLOCK, RateTable, parse_rate_table
from nmc.cy545 import Cy545
from nmc.cy545_text import encode, encode_query, read_answer
from nmc.errors import LinkTimeout, LocalFault, RemoteFault
from nmc.recording_link import HOST, RecordingLink
from planner.cy545 import Indexer, RampSettings, choose, profile
from sim.cy545_host import TextHost

item = pytest.mark.item
RATES = RateTable(tuple(50.0 + 40.0 * k for k in range(256)), "a table of equal steps of 40 steps/s")
FAST = RampSettings(200, 255, 250)


class Rig:
    """A chip, started up, whose bytes are recorded."""

    def __init__(self, *, can_abort: bool = True, use_cts: bool = False, **choices) -> None:
        self.host = TextHost(RATES, **choices)
        self.link = RecordingLink(self.host.link)
        self.driver = Cy545(self.link, self.host.link, can_abort=can_abort, use_cts=use_cts)
        self.driver.start_up()
        self.driver.set_rates(FAST.first, FAST.rate, FAST.slope)
        self.link.chunks.clear()

    def said(self) -> bytes:
        return b"".join(chunk.data for chunk in self.link.chunks if chunk.line == HOST)

    def move(self, target: int) -> int:
        steps = abs(target - self.driver.position)
        return self.driver.move_to(target, lasts_ns(steps) if steps else 0)

    @property
    def chip(self):
        return self.host.chip


def lasts_ns(steps: int) -> int:
    axis = Indexer("A", 1, 1.0, RATES, velocity=1e5, acceleration=1e7)
    return profile(axis, FAST, steps).duration_ns


# -- syntax ------------------------------------------------------------------------------------------------------------


@item("CE-01", "CY-046")
@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (("N", 30), b"N 30\r"),
        (("-",), b"-\r"),
        (("G",), b"G\r"),
        (("P", 0), b"P 0\r"),
        (("R", 255), b"R 255\r"),
        (("A", 16_777_215), b"A 16777215\r"),
        (("D", 65_535), b"D 65535\r"),
    ],
)
def test_commands_are_a_letter_a_space_a_decimal_number_and_a_return(words, wanted):
    assert encode(*words) == wanted


@item("CE-02", "CY-003", "CY-011", "CY-020", "CY-043", "X-101")
@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("N", BLOCK), "0 to 16777215"),
        (("A", -1), "0 to 16777215"),
        (("P", BLOCK), "0 to 16777215"),
        (("R", 256), "0 to 255"),
        (("R", 0), "rate 0"),
        (("F", 0), "rate 0"),
        (("S", 0), "1 to 255"),
        (("G", 1), "0 arguments"),
        (("N",), "1 arguments"),
        (("M",), "no command"),
        (("U",), "no command"),
        (("H", 1), "no command"),
    ],
)
def test_what_the_manual_does_not_allow_is_refused_before_a_byte_leaves(words, told):
    with pytest.raises(LocalFault, match=told):
        encode(*words)


@item("CE-08")
def test_bit_commands_change_the_chips_bits_and_the_codes_between_them_are_refused():
    rig = Rig()
    for code, bits in ((19, 0xFFF7), (3, 0xFFFF), (64, 0xFFC0), (213, 0xFFD5), (30, 0xBFD5)):
        rig.driver.command("B", code)
        assert rig.driver.query("B") == rig.chip.bits == bits
    for code in (32, 63):
        with pytest.raises(LocalFault, match="not a bit command"):
            encode("B", code)
    assert rig.host.sim.violations == []


@item("CE-05")
def test_answers_are_read_strictly():
    assert encode_query("P") == b"?P\r"
    assert read_answer(b"P=16777206\r", "P") == 16_777_206
    assert read_answer(b"R=00100\r", "R") == 100
    for bad in (b"P=0000001\r", b"R=00100\r", b"P=00000x01\r", b"P=00000001\n", b""):
        with pytest.raises(ValueError):
            read_answer(bad, "P")
    with pytest.raises(LocalFault, match="not told"):
        encode_query("G")


# -- start-up and waiting ----------------------------------------------------------------------------------------------


@item("CE-03")
def test_start_up_finds_resets_and_checks():
    host = TextHost(RATES)
    host.do("R 7", "N 60", "-", "G")
    link = RecordingLink(host.link)
    driver = Cy545(link, host.link)
    driver.start_up()
    sent = b"".join(chunk.data for chunk in link.chunks if chunk.line == HOST)
    assert sent == b"\r\r?P\rI\r?P\rN 1\r"
    assert (driver.position, host.chip.register, host.chip.values["R"]) == (0, 0, 100)
    assert host.sim.violations == []


def test_start_up_ends_what_an_earlier_host_left_unfinished():
    host = TextHost(RATES)
    host.send("N 12")
    Cy545(host.link, host.link).start_up()
    assert host.chip.register == 0


def test_keeping_takes_the_position_nearest_to_zero_and_nothing_else():
    host = TextHost(RATES)
    host.do("N 30", "-", "G", "R 7", "C")
    driver = Cy545(host.link, host.link)
    assert driver.start_up(keep=True)
    assert driver.position == -30
    assert host.chip.register == BLOCK - 30
    assert not host.chip.continuous
    assert host.chip.values["R"] == 100


def test_a_chip_whose_power_was_off_has_lost_its_position_and_says_so():
    host = TextHost(RATES)
    driver = Cy545(host.link, host.link)
    assert not driver.start_up(keep=True)
    assert driver.start_up(keep=True)  # now it is known to have been started up
    host.do("I")
    assert not driver.start_up(keep=True)


def test_nobody_there_and_a_wrong_rate_are_told():
    host = TextHost(RATES, baud=19_200)
    with pytest.raises(LinkTimeout, match="does not answer"):
        Cy545(host.link, host.link, baud=9600).start_up()


@item("CE-07", "CY-022")
def test_nothing_is_sent_while_the_chip_executes():
    rig = Rig(host_jitter_max_ns=200_000, start_delay_max_ns=250_000)
    rng = np.random.default_rng(7)
    for target in rng.integers(-3000, 3000, 40).tolist():
        rig.move(target)
    assert rig.chip.mechanical == rig.driver.position
    assert rig.host.sim.violations == []
    data = rig.driver.prepare(rig.driver.position + 500)
    rig.driver.begin(data, rig.driver.position + 500, lasts_ns(500))
    before = rig.said()
    for forbidden in (lambda: rig.driver.query("P"), lambda: rig.driver.command("N", 5)):
        with pytest.raises(LocalFault, match="hears nothing"):
            forbidden()
    assert rig.said() == before
    rig.driver.finish()
    assert rig.host.sim.violations == []


@item("CE-06", "CE-07")
def test_with_cts_the_driver_waits_for_it_and_no_longer():
    rig = Rig(use_cts=True)
    begin_ns = rig.link.now_ns()
    data = rig.driver.prepare(2000)
    rig.driver.begin(data, 2000, 100 * lasts_ns(2000))  # it need not know how long it takes
    rig.driver.finish()
    took_ns = rig.link.now_ns() - begin_ns
    assert lasts_ns(2000) < took_ns < lasts_ns(2000) + 60_000_000
    assert rig.host.sim.violations == []


@item("CE-06", "CE-07")
def test_cts_that_stays_off_is_a_fault():
    rig = Rig(use_cts=True)
    rig.host.link.pull_abort(True)  # the motion cannot begin
    data = rig.driver.prepare(2000)
    rig.driver.begin(data, 2000, lasts_ns(2000))
    with pytest.raises(LinkTimeout, match="not clear to send"):
        rig.driver.finish()


@item("CE-07")
def test_a_motion_that_did_not_happen_is_found_out():
    rig = Rig()
    data = rig.driver.prepare(400)
    rig.driver.begin(data, 401, lasts_ns(400))
    with pytest.raises(RemoteFault, match="stands at 400, not at 401"):
        rig.driver.finish()
    assert rig.driver.position == 400


# -- motion and blocks -------------------------------------------------------------------------------------------------


@item("CY-041", "CY-043")
def test_within_a_block_a_move_is_one_absolute_command():
    rig = Rig()
    rig.move(250)
    rig.move(100)
    assert rig.said() == b"P 250\r?P\rP 100\r?P\r"


@item("CY-010", "CY-040", "CY-044", "CY-045", "X-11")
def test_across_blocks_it_is_number_direction_and_go():
    rig = Rig()
    rig.move(20)
    rig.link.chunks.clear()
    rig.move(-10)
    assert rig.said() == b"N 30\r-\rG\r?P\r"
    assert rig.chip.register == 16_777_206
    rig.link.chunks.clear()
    rig.move(0)  # not the long way round
    assert rig.said() == b"N 10\r+\rG\r?P\r"
    assert (rig.chip.mechanical, rig.chip.register) == (0, 0)


@item("CY-011", "CY-045")
def test_many_blocks_away_the_position_is_still_exact():
    rig = Rig()
    target = 0
    for away in (16_777_215, 16_777_215, 9_000_000, -16_777_215, -16_777_215, -16_777_215):
        target += away
        rig.move(target)
        assert rig.chip.mechanical == target
        assert rig.chip.register == target % BLOCK
    assert target < 0
    with pytest.raises(LocalFault, match="more than one motion has"):
        rig.driver.prepare(target + BLOCK)


@item("CY-030", "CY-032", "CY-040")
def test_continuous_mode_needs_a_line_to_stop_it():
    rig = Rig(can_abort=False)
    with pytest.raises(LocalFault, match="INHIBIT_ABORT"):
        rig.driver.run_continuous(True, 0)
    assert rig.said() == b""


@item("CY-030", "CY-032", "CY-040")
def test_continuous_mode_is_stopped_by_the_line_and_read_back():
    rig = Rig()
    rig.driver.run_continuous(False, slowing_ns=lasts_ns(10_000))
    rig.host.wait(3)
    stands = rig.driver.stop()
    assert rig.said() == b"-\rC\rG\r?P\r"
    assert stands == rig.chip.mechanical < -1000
    assert not rig.chip.abort_low
    with pytest.raises(LocalFault, match="initialize first"):
        rig.move(10)  # across the block: relative, and C may still hold
    rig.driver.initialize()
    rig.driver.set_position(stands)
    rig.driver.set_rates(FAST.first, FAST.rate, FAST.slope)
    rig.move(10)
    assert rig.chip.mechanical == 10
    assert rig.host.sim.violations == []


def test_a_stop_without_a_line_lets_the_move_end():
    rig = Rig(can_abort=False)
    data = rig.driver.prepare(5000)
    rig.driver.begin(data, 5000, lasts_ns(5000))
    assert rig.driver.stop() == 5000
    assert rig.host.sim.violations == []


def test_a_stop_with_a_line_ends_it_on_the_way():
    rig = Rig()
    data = rig.driver.prepare(50_000)
    rig.driver.begin(data, 50_000, lasts_ns(50_000))
    rig.host.wait(1.0)
    stands = rig.driver.stop()
    assert 0 < stands < 50_000
    assert stands == rig.chip.mechanical
    assert rig.host.sim.violations == []


def test_rates_are_sent_only_when_they_change():
    rig = Rig()
    rig.driver.set_rates(FAST.first, FAST.rate, 100)
    rig.driver.set_rates(FAST.first, FAST.rate, 100)
    assert rig.said() == b"S 100\r"


# -- rates as the planner chooses them ---------------------------------------------------------------------------------


@item("CY-002", "CY-003", "CY-005")
@pytest.mark.parametrize("crystal", [6.0, 12.0, 16.0])
def test_the_rates_chosen_keep_the_axis_limits_at_any_crystal(crystal):
    axis = Indexer("A", 1, 10.0, RATES, 300.0, 2000.0, pull_in_velocity=40.0, crystal_mhz=crystal)
    chosen = choose(axis)
    rig = Rig(crystal_mhz=crystal)
    rig.driver.set_rates(chosen.first, chosen.rate, chosen.slope)
    rig.driver.move_to(2000, profile(axis, chosen, 2000).duration_ns)
    rig.driver.move_to(2150, profile(axis, chosen, 150).duration_ns)
    rates = 1 / np.diff(rig.host.pulses_s())
    assert rates.max() <= 300 * 10 * (1 + 1e-5)
    assert rates.max() > 300 * 10 - 40 * crystal / 12
    assert rates[0] <= 40 * 10 * (1 + 1e-6)
    assert 1 <= chosen.slope <= 255


@item("X-100")
def test_a_rate_table_is_read_strictly_and_a_stand_in_says_so():
    good = ["rate,steps_per_s_12mhz", *(f"{k},{10 + k}" for k in range(256))]
    assert not parse_rate_table("\n".join(good), "mine.csv").stand_in
    assert parse_rate_table("\n".join(["# a stand-in", *good]), "mine.csv").stand_in
    for change, told in (
        (good[:-1], "255 rates"),
        (["rate,hz", *good[1:]], "mine.csv:1: the header"),
        ([*good[:5], "4,ten", *good[6:]], "mine.csv:6: not a rate"),
        ([*good[:5], "5,14", *good[6:]], "mine.csv:6: rate 5 where 4 comes next"),
        ([*good[:5], "4,2", *good[6:]], "mine.csv:6: the rates must be above 0 and ascend"),
    ):
        with pytest.raises(ValueError, match=told):
            parse_rate_table("\n".join(change), "mine.csv")
