"""The simulated bus where the sheets are silent: the choices taken.

Both chips are tried wherever both sheets speak (PIC-STEP section 3, PIC-SERVO section 4.1).
"""

import pytest

from sim.rawhost import GROUP, NoReplyError, RawHost, machine, mixed, packet, single, steppers
from sim.spec import SimOptions, StepModule
from sim.uart import arrivals_ns, chip_baud, misread

item = pytest.mark.item
both = pytest.mark.parametrize("chip", ["step", "servo"])


@item("X-40")
@both
def test_wrong_data_length(chip):
    """Too short: not executed, answered without error, logged; too long: the rest is ignored, logged."""
    sim, host = single(chip)
    assert not host.exchange(0, 0x1, [7])[0] & 0x02
    assert sim.modules["A"].address == 0
    host.exchange(0, 0x1, [7, 0xFF, 1, 2])
    host.wait_ms(1)
    assert sim.modules["A"].address == 7
    assert sim.rules() == ["X-40", "X-40"]


@item("X-41")
@both
def test_undefined_commands_are_answered_like_nop(chip):
    """Choice: reply as No Operation, logged."""
    sim, host = single(chip)
    undefined = [0xB, 0xD] if chip == "step" else [0xD]
    for command in undefined:
        assert len(host.exchange(0, command)) == 1
    host.wait_ms(1)
    assert sim.rules() == ["X-41"] * len(undefined)


@item("X-43")
@both
def test_individual_address_equal_to_the_group(chip):
    """Choice: executed once, answered."""
    _, host = single(chip)
    host.exchange(0, 0x1, [0x90, 0x90])
    host.wait_ms(1)
    assert len(host.exchange(0x90, 0xE)) == 1
    assert host.silent()


@item("X-44")
@both
def test_incomplete_packet_waits_for_ever(chip):
    """Choice: no time-out between bytes."""
    _, host = single(chip)
    whole = packet(0, 0xE)
    for value in whole:
        host.link.write(bytes([value]))
        host.wait_ms(500)
    assert len(host.listen()) == 1


@item("X-46")
@both
def test_status_mask_survives_set_address(chip):
    """Choice: the mask is retained, the answer shows it."""
    _, host = single(chip)
    host.exchange(0, 0x2, [0x01], 4)
    assert len(host.exchange(0, 0x1, [3, 0xFF], 4)) == 5
    host.wait_ms(1)
    assert len(host.exchange(3, 0xE, extra=4)) == 5


@item("X-49")
@both
def test_mask_bits_that_do_not_exist(chip):
    """Choice: no extra bytes, logged."""
    sim, host = single(chip)
    assert len(host.exchange(0, 0x3, [0xC0])) == 1
    assert len(host.exchange(0, 0x3, [0xE0], 2)) == 3
    host.wait_ms(1)
    assert set(sim.rules()) == {"X-49"}


@item("X-50")
def test_set_address_to_a_group_makes_addresses_collide():
    """Choice: executed by all members, logged; the collision is then real."""
    sim, host = mixed()
    host.start_up(4)
    host.exchange(GROUP, 0x1, [7, 0x81])
    host.wait_ms(2)
    assert [m.address for m in sim.modules.values()] == [7] * 4
    assert set(sim.rules()) == {"X-50"}
    for _ in range(20):
        host.send(7, 0xE)
        host.wait_ms(10)
        host.link.flush_input()
    assert sim.buses[0].status.collisions > 10


@item("X-52", "SV-006")
@both
def test_a_byte_before_the_reply_takes_the_reply_away(chip):
    """SV 4.1: if the host sends any data before a status packet is received, all slaves drop it and listen."""
    sim, host = single(chip)
    host.send(0, 0x3, [0x3F])
    host.link.sleep_until(sim.buses[0].command.free_ns + 600_000)
    host.link.write(b"\x00")
    host.wait_ms(20)
    got = len(host.link.read(100, host.link.now_ns()))
    assert got < 16
    assert sim.rules() == ["N-022"]
    assert len(host.exchange(0, 0xE)) == 1


@item("N-022")
def test_two_leaders_collide():
    """ST 3.3: only one module should be the leader of a group; two answers at once are noise."""
    sim, host, _ = steppers(2)
    host.exchange(2, 0x1, [2, GROUP & 0x7F])
    clean = 0
    for _ in range(30):
        host.send(GROUP, 0x3, [0x3F])
        reply = host.link.read(16, host.link.now_ns() + 10_000_000)
        clean += len(reply) == 16 and sum(reply[:-1]) & 0xFF == reply[-1]
        host.wait_ms(5)
        host.link.flush_input()
    assert sim.buses[0].status.collisions > 20
    assert clean < 10


@item("X-10")
def test_mismatch_of_four_percent_is_read_and_more_is_not():
    """Choice: the true rate is used and a mismatch up to 4 % accepted."""
    for mismatch, understood in ((0.039, True), (-0.039, True), (0.041, False), (-0.041, False)):
        sim, host = machine([StepModule("A")])
        host.wait_ms(2)
        sim.buses[0].command.transmit(packet(0, 0x2, [0x01]), host.link.now_ns(), chip_baud(63) * (1 + mismatch))
        host.wait_ms(20)
        assert (sim.modules["A"].mask == 0x01) == understood


def test_misreading_is_what_sampling_gives():
    """A receiver three times too fast sees several bytes for one 0x55; one far too slow sees one for many."""
    assert arrivals_ns(0, 2, 1e9) == [10, 20]
    fast = misread([0x55], 0, 10_000, 30_000)  # 0 1 0 1 ...: each bit is three of the receiver's
    assert [value for _, value in fast] == [0b00011100, 0b00011100, 0b11111100]
    slow = misread([0x00] * 12, 0, 115_200, 9600)
    assert 1 <= len(slow) <= 2


@item("N-018")
def test_leaderless_group_leaves_the_line_silent():
    """ST 3.3: no status will be coming back from any controller."""
    sim, host = mixed()
    host.start_up(4)
    host.exchange(1, 0x1, [1, GROUP])
    host.wait_ms(1)
    host.send(GROUP, 0xE)
    assert host.silent()
    assert sim.violations == []


@item("N-023")
def test_talking_less_than_half_a_millisecond_after_a_silent_command_is_logged():
    """ST 3.3: the host should wait at least 0.5 ms so as not to overwrite the previous command."""
    sim, host, _ = steppers(2)
    host.exchange(1, 0x1, [1, GROUP])
    host.wait_ms(1)
    for wait_us, rules in ((600, []), (100, ["N-023"])):
        sim.log.violations.clear()
        host.send(GROUP, 0xE)
        host.link.sleep_until(sim.buses[0].command.free_ns + wait_us * 1000)
        host.exchange(1, 0xE)
        assert sim.rules() == rules


def test_a_host_raises_when_nobody_answers():
    sim, host = machine([StepModule("A")])
    with pytest.raises(NoReplyError, match="silence"):
        host.exchange(9, 0xE)
    assert isinstance(host, RawHost)
    assert sim.violations == []
    assert SimOptions().reached_stop_is_stopped
