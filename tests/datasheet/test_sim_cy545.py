"""The simulated CY545 against its manual: chapter 5, and what is known of the others.

Figures are the manual's own, or follow from them by the arithmetic shown; rates come from a table made up here, so that
the mechanism is tested and no table.
"""

from __future__ import annotations

import numpy as np
import pytest

from nmc.chips.cy545 import BLOCK, RateTable
from sim.cy545_host import TextHost
from sim.spec import Switch

item = pytest.mark.item
RATES = RateTable(tuple(50.0 + 40.0 * k for k in range(256)), "a table of equal steps of 40 steps/s")


def host(**choices) -> TextHost:
    return TextHost(RATES, **choices)


def gaps_s(rig: TextHost):
    return np.diff(rig.pulses_s())


# -- rates and ramps ---------------------------------------------------------------------------------------------------


@item("CY-001", "X-12")
def test_r_is_the_maximum_rate_and_f_the_first():
    rig = host()
    rig.do("R 60", "F 10", "S 200", "N 6000", "+", "G")
    rates = 1 / gaps_s(rig)
    assert rates[0] == pytest.approx(50 + 40 * 10, rel=1e-6)
    assert rates.max() == pytest.approx(50 + 40 * 60, rel=1e-6)
    assert rates[-1] == pytest.approx(rates[0], rel=1e-6)


@item("CY-002")
@pytest.mark.parametrize("crystal", [6.0, 11.0592, 12.0, 16.0])
def test_rates_scale_with_the_crystal(crystal):
    rig = host(crystal_mhz=crystal)
    rig.do("R 30", "F 30", "N 50", "+", "G")
    assert 1 / gaps_s(rig) == pytest.approx((50 + 40 * 30) * crystal / 12, rel=1e-5)


@item("CY-003", "CE-09")
@pytest.mark.parametrize("slope", [1, 175, 225, 255])
def test_the_slope_is_3906_d_over_256_minus_s(slope):
    rig = host()
    top = 12 if slope == 1 else 40
    rig.do(f"R {top}", "F 10", f"S {slope}", "C", "+")
    rig.send("G\r")
    rig.wait(1.0)
    pulses = rig.pulses_s()
    rates = 1 / np.diff(pulses)
    reached = pulses[int(np.argmax(rates > rates.max() * (1 - 1e-6)))] - pulses[0]
    acceleration = 3906 * 40 / (256 - slope)
    wanted = 40 * (top - 10) / acceleration
    assert reached == pytest.approx(wanted, rel=0.002, abs=1 / 450)


@item("CY-003")
def test_slope_zero_is_refused():
    rig = host()
    rig.do("S 0")
    assert rig.rules() == ["CY-003"]
    assert rig.ask("S") == "S=00220"


@item("CY-004")
def test_the_way_down_is_the_way_up_reversed():
    rig = host()
    rig.do("R 100", "F 5", "S 200", "N 3001", "+", "G")
    gaps = np.rint(gaps_s(rig) * 1e9)
    assert len(gaps) == 3000
    # step k and step N-1-k last equally long; the last one's length is not seen between pulses
    assert np.abs(gaps[1:] - gaps[1:][::-1]).max() <= 1


@item("CY-005")
def test_a_short_move_reaches_the_highest_rate_it_can_and_comes_down():
    rig = host()
    rig.do("R 250", "F 5", "S 200", "N 301", "+", "G")
    rates = 1 / gaps_s(rig)
    peak = int(rates.argmax())
    assert rates.max() < 0.5 * (50 + 40 * 250)
    assert abs(peak - 150) < 15
    assert (np.diff(rates[:peak]) > -1e-3).all()
    assert (np.diff(rates[peak:]) < 1e-3).all()
    assert rig.chip.register == 301


@item("X-104")
def test_f_above_r_runs_at_r_without_a_ramp():
    rig = host()
    rig.do("F 90", "R 20", "N 100", "+", "G")
    assert 1 / gaps_s(rig) == pytest.approx(50 + 40 * 20, rel=1e-6)


@item("X-100")
def test_rates_come_from_the_table_that_the_user_brings():
    table = RateTable(tuple(11.0 + k for k in range(256)), "another table")
    rig = TextHost(table)
    rig.do("R 89", "F 89", "N 10", "+", "G")
    assert 1 / gaps_s(rig) == pytest.approx(100.0, rel=1e-6)


@item("X-101")
@pytest.mark.parametrize("letter", ["R", "F"])
def test_rate_zero_is_refused(letter):
    rig = host()
    before = rig.ask(letter)
    rig.do(f"{letter} 0")
    assert rig.rules() == ["X-101"]
    assert rig.ask(letter) == before


# -- number, direction, position ---------------------------------------------------------------------------------------


@item("CY-010", "CY-040")
def test_n_is_stored_and_g_steps_it():
    rig = host()
    rig.do("N 123", "+")
    rig.wait(1)
    assert rig.chip.mechanical == 0
    assert rig.ask("N") == "N=00000123"
    rig.do("G", "G")
    assert rig.chip.mechanical == 246  # the last N holds
    rig.do("-", "G")
    assert rig.chip.mechanical == 123


@item("CY-011")
def test_a_relative_move_has_up_to_24_bits():
    rig = host()
    rig.do("R 255", "F 255", "N 16777215", "-", "G")
    assert rig.chip.mechanical == -16_777_215
    rig.do("N 16777216")
    assert rig.rules() == ["CE-01"]
    assert rig.ask("N") == "N=16777215"


@item("CY-012", "CY-013", "CY-021")
def test_direction_commands_drive_ccw_and_the_register_follows():
    rig = host()
    rig.do("A 1000", "N 10", "+")
    assert not rig.chip.ccw_high
    rig.do("G")
    assert rig.ask("P") == "P=00001010"
    rig.do("-")
    assert rig.chip.ccw_high
    rig.do("G", "G")
    assert rig.ask("P") == "P=00000990"


@item("CY-014")
def test_with_minus_selected_an_external_low_forces_clockwise():
    rig = host()
    rig.do("N 10", "-")
    rig.chip.pull_ccw(True)
    assert not rig.chip.ccw_high
    rig.do("G")
    assert rig.chip.mechanical == 10
    rig.chip.pull_ccw(False)
    rig.do("G")
    assert rig.chip.mechanical == 0


@item("CY-020")
def test_a_sets_the_24_bit_position():
    rig = host()
    for value in (0, 1, 16_777_215, 123_456):
        rig.do(f"A {value}")
        assert rig.ask("P") == f"P={value:08d}"
    rig.do("A 16777216")
    assert rig.rules() == ["CE-01"]
    assert rig.chip.mechanical == 0


@item("CY-022", "CE-07", "X-105")
def test_a_query_while_stepping_is_not_answered_then():
    rig = host()
    rig.do("R 20", "F 20", "N 400", "+")
    rig.send("G\r")
    rig.wait(0.1)
    rig.send("?P\r")
    rig.wait(0.1)
    assert rig.link.read(1, rig.link.now_ns()) == b""
    assert set(rig.rules()) == {"CE-07"}
    rig.until_ready()
    rig.wait(0.1)
    assert rig.link.read(99, rig.link.now_ns()) == b"P=00000400\r"  # three characters were kept


@item("CE-07", "X-105")
def test_more_than_three_characters_during_a_motion_are_lost():
    rig = host()
    rig.do("R 20", "F 20", "N 400", "+")
    rig.send("G\r")
    rig.send("A 777\r")
    rig.until_ready()
    rig.send("\r")  # ends the three characters that were kept: A, space, 7
    rig.until_ready()
    assert rig.ask("P") == "P=00000007"
    lost = [v.consequence for v in rig.sim.violations if "lost" in v.consequence]
    assert len(lost) == 3


@item("CY-023")
@pytest.mark.parametrize("register", [0, 5, 16_777_210])
def test_a_relative_move_does_not_mind_the_position(register):
    rig = host()
    rig.do(f"A {register}", "N 40", "+", "G")
    assert rig.chip.mechanical == 40


# -- continuous mode, abort, jog ---------------------------------------------------------------------------------------


@item("CY-030", "CY-031")
def test_c_moves_nothing_and_g_then_runs_on():
    rig = host()
    rig.do("R 60", "F 10", "S 250", "C", "+")
    rig.wait(1)
    assert rig.chip.mechanical == 0
    rig.send("G\r")
    rig.wait(5)
    assert rig.chip.busy
    rates = 1 / gaps_s(rig)
    assert rates[-1000:] == pytest.approx(50 + 40 * 60, rel=1e-6)
    assert (np.diff(rates) > -1e-3).all()


def running(**choices) -> TextHost:
    rig = host(**choices)
    rig.do("R 60", "F 10", "S 200", "C", "+")
    rig.send("G\r")
    rig.wait(2)
    return rig


@item("CY-032")
def test_abort_slows_down_and_stops_at_the_first_rate():
    rig = running()
    rig.link.pull_abort(True)
    ramp_s = 50 * 56 * 256e-6
    rig.wait(ramp_s * 0.9)
    assert rig.chip.busy
    rig.wait(ramp_s * 0.1 + 0.01)
    assert not rig.chip.busy
    rates = 1 / gaps_s(rig)
    assert rates[-1] == pytest.approx(50 + 40 * 11, rel=1e-6)  # the last step above F, then none at F
    stands = rig.chip.mechanical
    rig.wait(1)
    assert rig.chip.mechanical == stands == rig.chip.register


@item("X-106")
def test_abort_let_go_early_speeds_up_again():
    rig = running()
    rig.link.pull_abort(True)
    rig.wait(0.2)
    rig.link.pull_abort(False)
    rig.wait(2)
    assert rig.chip.busy
    rates = 1 / gaps_s(rig)
    assert rates[-1] == pytest.approx(50 + 40 * 60, rel=1e-6)
    arrived = int(np.argmax(rates > rates[-1] * (1 - 1e-6)))
    assert rates[arrived:].min() < 0.8 * rates[-1]


def test_abort_in_a_finite_move_let_go_early_still_ends_on_the_target():
    rig = host()
    rig.do("R 60", "F 10", "S 200", "N 5000", "+")
    rig.send("G\r")
    rig.wait(1.5)
    rig.link.pull_abort(True)
    rig.wait(0.3)
    rig.link.pull_abort(False)
    rig.until_ready()
    assert rig.chip.mechanical == 5000


def test_a_motion_waits_while_inhibit_is_low():
    rig = host()
    rig.link.pull_abort(True)
    rig.do("N 10", "+")
    rig.send("G\r")
    rig.wait(1)
    assert rig.chip.mechanical == 0
    rig.link.pull_abort(False)
    rig.until_ready()
    assert rig.chip.mechanical == 10


@item("CY-033")
def test_slew_low_at_the_start_selects_continuous_mode():
    rig = host()
    rig.do("N 10", "+")
    rig.chip.set_slew(True)
    rig.send("G\r")
    rig.chip.set_slew(False)
    rig.wait(0.001)
    rig.chip.set_slew(True)
    rig.wait(2)
    free = rig.chip.mechanical
    rig.chip.set_slew(False)
    assert free == 10  # it was high again when stepping began
    rig.chip.set_slew(True)
    rig.send("G\r")
    rig.wait(2)
    assert rig.chip.mechanical > 100


@item("CY-047", "CE-11")
@pytest.mark.parametrize(("way", "sign"), [("cw", 1), ("ccw", -1)])
def test_jog_moves_by_hand_at_a_twentieth_of_the_first_rate(way, sign):
    rig = host()
    rig.do("F 10", "R 100")
    rig.chip.set_jog(way)
    rig.wait(2.0)
    rig.chip.set_jog(None)
    rig.wait(0.5)
    assert 1 / gaps_s(rig) == pytest.approx(450 / 20, rel=1e-6)
    assert rig.chip.mechanical * sign == 46  # the first at once, then 22.5 a second
    assert rig.chip.register == rig.chip.mechanical % BLOCK
    assert not rig.chip.busy


# -- absolute moves and the block --------------------------------------------------------------------------------------


@item("CY-041", "CY-042")
def test_p_goes_to_the_target_the_way_of_its_sign():
    rig = host()
    rig.do("A 500", "P 800")
    assert rig.chip.mechanical == 300
    assert not rig.chip.ccw_high
    rig.do("P 100")
    assert rig.chip.mechanical == -400
    assert rig.chip.ccw_high
    assert rig.ask("P") == "P=00000100"


@item("CY-043")
def test_an_absolute_move_stays_within_the_block():
    rig = host()
    rig.do("R 255", "F 255", "A 16777215", "P 0")
    assert rig.chip.mechanical == -16_777_215
    rig.do("P 16777216")
    assert rig.rules() == ["CE-01"]


@item("CY-044", "CY-046", "X-11")
def test_the_wrap_example_byte_for_byte():
    rig = host()
    rig.do("R 255", "F 255")
    rig.do("A 20")
    for command in (b"N 30\r", b"-\r", b"G\r"):
        rig.send(command.decode("ascii"))
        rig.until_ready()
    assert rig.chip.mechanical == -30
    assert rig.ask("P") == "P=16777206"  # 2^24 - 10; the manual prints 16777205
    started = rig.chip.mechanical
    rig.send("P 0\r")
    rig.until_ready()
    assert rig.chip.mechanical - started == -16_777_206
    assert rig.ask("P") == "P=00000000"
    trace = rig.sim.trace()
    sent = bytes(trace.bus_byte[trace.bus_line == 0])
    assert sent.endswith(b"A 20\rN 30\r-\rG\r?P\rP 0\r?P\r")
    assert rig.sim.violations == []


@item("X-102", "X-103")
def test_no_way_to_go_is_no_motion():
    rig = host()
    rig.do("A 77", "P 77", "N 0", "+", "G")
    assert rig.pulses_s().size == 0
    assert not rig.chip.busy
    assert rig.sim.violations == []


# -- what is known of the other chapters -------------------------------------------------------------------------------


@item("CE-01", "CY-046")
@pytest.mark.parametrize(
    ("line", "value"),
    [("N 255", 255), ("N 0FFH", 255), ("N 10H", 16), ("N  7", 7), ("N 00012", 12)],
)
def test_numbers_are_decimal_or_hexadecimal(line, value):
    rig = host()
    rig.do(line)
    assert rig.ask("N") == f"N={value:08d}"
    assert rig.sim.violations == []


@item("CE-01")
@pytest.mark.parametrize("line", ["N255", "N FFH", "N", "N 1 2", "N x", "+ 1", "N -5", "N 1,2"])
def test_what_is_no_command_is_not_executed(line):
    rig = host()
    rig.do(line)
    assert rig.ask("N") == "N=00000200"
    assert set(rig.rules()) == {"CE-01"}


@item("CE-02")
@pytest.mark.parametrize("letter", ["M", "U", "V", "n", "*", "H", "T"])
def test_letters_that_are_no_command_or_not_modelled_are_told(letter):
    rig = host()
    rig.do(f"{letter} 1")
    assert rig.rules() == ["CE-02"]
    known = letter in "HT"
    assert ("not modelled" in rig.sim.violations[0].consequence) == known


@item("CE-03")
def test_power_on_and_i_leave_the_defaults():
    rig = host()
    wanted = ["R=00100", "F=00014", "S=00220", "N=00000200", "P=00000000", "O=00128"]
    assert [rig.ask(letter) for letter in "RFSNPO"] == wanted
    assert rig.chip.bits == 0xFFFF
    rig.do("R 5", "F 3", "S 9", "N 8", "A 7", "-", "B 16", "C", "I")
    assert [rig.ask(letter) for letter in "RFSNPO"] == wanted
    assert rig.chip.bits == 0xFFFF
    rig.do("G")  # neither continuous nor counter-clockwise any more
    assert rig.chip.mechanical == 200


@item("CE-04")
@pytest.mark.parametrize("crystal", [12.0, 6.0])
def test_a_delay_lasts_milliseconds_at_12_mhz(crystal):
    rig = host(crystal_mhz=crystal)
    rig.send("D 250\r")
    begin_ns = rig.link.now_ns()
    rig.until_ready()
    assert (rig.link.now_ns() - begin_ns) * 1e-9 == pytest.approx(0.250 * 12 / crystal, abs=0.001)
    rig.do("D 65536")
    assert rig.rules() == ["CE-01"]


@item("CE-05")
def test_answers_have_five_or_eight_digits_and_a_carriage_return():
    rig = host()
    rig.send("?R\r")
    rig.wait(0.05)
    assert rig.link.read(99, rig.link.now_ns()) == b"R=00100\r"
    rig.send("?P\r")
    rig.wait(0.05)
    assert rig.link.read(99, rig.link.now_ns()) == b"P=00000000\r"


@item("CE-06", "CE-07")
def test_cts_tells_busy_once_the_mode_register_turns_it_on():
    rig = host()
    rig.do("R 20", "F 20", "N 400", "+")
    rig.send("G\r")
    rig.wait(0.01)
    assert rig.link.clear_to_send()  # default 80H: CTS is off
    rig.until_ready()
    rig.do("O 160")
    assert rig.link.clear_to_send()
    rig.send("G\r")
    rig.wait(0.01)
    assert not rig.link.clear_to_send()
    rig.send("?P\r")  # what was on its way fits the buffer, and is no breach with CTS
    rig.until_ready()
    rig.wait(0.1)
    assert rig.link.read(99, rig.link.now_ns()) == b"P=00000800\r"
    assert rig.sim.violations == []


@item("CE-06")
def test_binary_mode_is_not_taken():
    rig = host()
    rig.do("O 0")
    assert rig.ask("O") == "O=00128"
    assert rig.rules() == ["CE-06"]


@item("CE-08")
@pytest.mark.parametrize(
    ("commands", "bits"),
    [
        (["B 16"], 0xFFFE),
        (["B 24"], 0xFEFF),
        (["B 16", "B 0"], 0xFFFF),
        (["B 31", "B 15"], 0xFFFF),
        (["/B 3"], 0xFFF7),
        (["B 19", "/B 19"], 0xFFFF),
        (["B 64"], 0xFFC0),
        (["B 64", "B 106"], 0xFFEA),
        (["B 149"], 0xFFD5),
        (["B 64", "B 213"], 0xFFD5),
    ],
)
def test_bit_commands(commands, bits):
    rig = host()
    rig.do(*commands)
    assert rig.chip.bits == bits
    assert rig.ask("B") == f"B={bits:05d}"


@item("CE-10")
def test_pulse_is_low_at_the_start_of_each_step():
    rig = host()
    assert rig.chip.pulse_high
    rig.do("R 10", "F 10", "N 4", "+")
    rig.send("G\r")
    levels = []
    for _ in range(4000):
        rig.wait(2e-6)
        levels.append(rig.chip.pulse_high)
    falls = np.flatnonzero(np.diff(np.array(levels, dtype=int)) == -1)
    rises = np.flatnonzero(np.diff(np.array(levels, dtype=int)) == 1)
    assert len(falls) == 4
    assert len(set((rises - falls).tolist())) <= 2  # a fixed time, seen through a comb of 2 us
    rig.until_ready()
    assert rig.chip.pulse_high


def test_the_home_switch_is_on_a_wire_of_its_own():
    rig = host(switch=Switch("home", None, -20))
    assert not rig.link.switch_closed()
    rig.do("N 20", "-", "G")
    assert rig.link.switch_closed()
