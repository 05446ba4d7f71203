"""The bus of the simulator against sections 3 (PIC-STEP) and 4.1 (PIC-SERVO) of the data sheets, which say the same.

N- numbers are those of the project's conformance list. Both chips are tried wherever both sheets speak.
"""

import numpy as np
import pytest

from sim.build import build
from sim.rawhost import GROUP, NoReplyError, RawHost, i32, machine, packet, servos, steppers
from sim.servokernel import GOAL_VELOCITY
from sim.spec import BusSpec, ServoModule, SimOptions, StepModule
from sim.uart import arrivals_ns, chip_baud, misread

item = pytest.mark.item
CHIPS = {"step": lambda name="A": StepModule(name), "servo": lambda name="A": ServoModule(name)}
both = pytest.mark.parametrize("chip", CHIPS)


def single(chip, **options):
    sim, host = machine([CHIPS[chip]()])
    host.link.sleep_until(2_000_000)
    return sim, host


def mixed(seed=1):
    """Far end to near end: PIC-STEP, PIC-SERVO, PIC-STEP, PIC-SERVO."""
    return machine([StepModule("A"), ServoModule("B"), StepModule("C"), ServoModule("D")], seed)


# -- framing ----------------------------------------------------------------------------------------------------------


@item("N-001")
@both
def test_a_byte_is_ten_bits(chip):
    """ST 3.1, SV 4.1: 1 start bit, 8 data bits, no parity, 1 stop bit: 4 + 2 bytes take 40 and 20 bit times."""
    sim, host = single(chip)
    host.exchange(0, 0xE)
    trace = sim.trace()
    host_ns = trace.bus_ns[trace.bus_line == 0]
    status_ns = trace.bus_ns[trace.bus_line == 1]
    assert np.diff(host_ns) == pytest.approx(10e9 / 19200, abs=2)
    assert np.diff(status_ns) == pytest.approx(10e9 / chip_baud(63), rel=1e-4)


@item("N-002", "N-082")
@both
@pytest.mark.parametrize("baud", [9600, 57600, 115200])
def test_after_power_up_only_19200_is_understood(chip, baud):
    """ST 3.1, SV 4.5: the default rate is 19200."""
    _, host = single(chip)
    host.link.set_baud(baud)
    host.send(0, 0xE)
    reply = host.link.read(2, host.link.now_ns() + 20_000_000)
    assert len(reply) < 2 or sum(reply[:-1]) & 0xFF != reply[-1]
    _, host = single(chip)
    assert len(host.exchange(0, 0xE)) == 1


@item("N-003", "N-081", "N-082", "ST-013")
@both
@pytest.mark.parametrize(
    ("baud", "brd", "true"), [(9600, 129, 9615), (19200, 63, 19531), (57600, 20, 59524), (115200, 10, 113636)]
)
def test_set_baud_table(chip, baud, brd, true):
    """ST 5.1, SV 5.2 Set Baud Rate: sample values of BRD, and 20 MHz / (16 (BRD + 1)) as SPBRG with BRGH = 1."""
    sim, host = single(chip)
    host.exchange(0, 0x1, [1, 0xFF])
    host.send(0xFF, 0xA, [brd])
    host.wait_ms(5)
    host.link.set_baud(baud)
    host.exchange(1, 0xE)
    trace = sim.trace()
    last_two = trace.bus_ns[trace.bus_line == 1][-2:]
    assert 10e9 / np.diff(last_two)[0] == pytest.approx(true, abs=1)
    assert sim.violations == []


@item("N-004")
def test_lines_do_not_meet():
    """ST 3.1: full duplex, commands and replies have lines of their own, so host bytes do not garble reply bytes."""
    sim, host, _ = steppers()
    host.send(1, 0x3, [0x3F])
    host.link.sleep_until(host.link.now_ns() + 700_000)
    before = sim.buses[0].status.collisions
    host.link.write(b"\x00")
    assert sim.buses[0].status.collisions == before


@item("N-006", "N-008", "N-013", "N-014")
@both
@pytest.mark.parametrize("length", range(16))
def test_packet_length_is_driven_by_the_high_nibble(chip, length):
    """ST 3.1, SV 4.1: header, address, command, 0..15 data bytes, checksum; 4 to 19 bytes in all."""
    _, host = single(chip)
    whole = packet(0, 0xE, bytes(length))
    assert len(whole) == 4 + length
    host.link.write(whole[:-1])
    assert host.silent()
    host.link.write(whole[-1:])
    assert len(host.listen()) == 1


@item("N-007", "N-044", "N-047")
@both
def test_address_is_individual_or_group(chip):
    """ST 3.1, 3.3: both addresses of a module are heard; the individual one is answered, also by a non-leader."""
    _, host = single(chip)
    host.exchange(0, 0x1, [0x17, 0x93])
    host.wait_ms(1)
    assert len(host.exchange(0x17, 0xE)) == 1
    host.send(0x93, 0x2, [0x01])
    assert host.silent()
    assert len(host.exchange(0x17, 0xE, extra=4)) == 5  # the group command was executed


@item("N-009", "N-019", "N-021")
@both
def test_wrong_checksum_is_answered_and_not_executed(chip):
    """ST 3.1, SV 4.1: the command is not executed, a status packet is still returned, with bit 1 set in it."""
    _, host = single(chip)
    bad = bytearray(packet(0, 0x2, [0x01]))
    bad[-1] ^= 0x10
    host.link.write(bytes(bad))
    assert host.listen()[0] & 0x02
    good = host.exchange(0, 0xE)
    assert len(good) == 1
    assert not good[0] & 0x02
    assert len(host.exchange(0, 0x2, [0x01], 4)) == 5


@item("N-009")
@both
def test_checksum_leaves_the_header_out(chip):
    """ST 3.1: 8-bit sum of the address byte through the last data byte."""
    _, host = single(chip)
    body = bytes([0x00, 0x13, 0xFF])
    host.link.write(b"\xaa" + body + bytes([(0xAA + sum(body)) & 0xFF]))
    assert host.listen()[0] & 0x02


@item("N-010")
@both
def test_bytes_before_a_header_are_dropped(chip):
    """ST 3.1: when waiting for a command each module ignores incoming data until it sees a header byte."""
    _, host = single(chip)
    host.link.write(b"\x00\x55\xff\x01" + packet(0, 0xE))
    assert len(host.listen()) == 1


@item("N-011", "X-45")
@both
def test_header_value_inside_a_packet_is_payload(chip):
    """ST 3.1, length-driven framing: 0xAA as address, data and checksum."""
    _, host = single(chip)
    host.exchange(0, 0x1, [0xAA, 0xFF])
    host.wait_ms(1)
    assert len(host.exchange(0xAA, 0xE)) == 1
    body = [0x00, 0x10, 0x9A]  # address 0x00: checksum 0xAA
    assert sum(body) & 0xFF == 0xAA
    host.link.write(packet(0xAA, 0xE, [0xAA]))
    assert len(host.listen()) == 1


@item("N-015", "N-016")
@both
def test_default_reply_is_status_and_checksum(chip):
    """ST 3.1, SV 4.1: status byte and checksum only after power-up; the checksum is the sum of all bytes above."""
    _, host = single(chip)
    host.link.write(packet(0, 0xE))
    reply = host.link.read(16, host.link.now_ns() + 20_000_000)
    assert len(reply) == 2
    assert reply[0] == reply[1]


@item("N-017")
def test_values_are_sent_least_significant_byte_first():
    """ST 5.1 Define Status: all multi-byte data least significant byte first."""
    _, host, modules = steppers()
    host.exchange(1, 0x4, [0x89, *i32(0x0102), *(65000).to_bytes(2, "little"), 100])
    host.wait_ms(2000)
    assert host.items(1, 0x01, 4) == bytes([0x02, 0x01, 0, 0])
    assert modules[0].position == 0x0102


@item("N-018")
@both
def test_foreign_address_has_no_effect_and_no_reply(chip):
    """ST 3.1, SV 4.1."""
    _, host = single(chip)
    host.send(0x42, 0x2, [0x01])
    assert host.silent()
    assert len(host.exchange(0, 0xE)) == 1


@item("N-020")
@both
def test_framing_error_is_like_a_wrong_checksum(chip):
    """ST 3.1, SV 4.1: any other communications error (framing, overrun): not executed, still answered."""
    sim, host = single(chip)
    data = packet(0, 0x2, [0x01])
    sim.buses[0].command.transmit(data, host.link.now_ns(), 19200.0, [True, True, True, False, True])
    assert host.listen()[0] & 0x02
    assert len(host.exchange(0, 0xE)) == 1


@item("N-024", "X-08")
def test_pic_step_answers_within_half_a_millisecond():
    """ST 3.1: the first byte of a status packet is sent within 0.5 ms after the last byte of the command."""
    sim, host, _ = steppers()
    delays = []
    for _ in range(200):
        host.exchange(1, 0xE)
        command = sim.bus_logs[0].host_ns[-1]
        first_bit = sim.bus_logs[0].status_ns[-2] - 10e9 / chip_baud(10)
        delays.append(first_bit - command)
    assert 0 <= min(delays) < 50_000
    assert 400_000 < max(delays) <= 500_001


@item("N-025", "SV-003", "SV-008", "X-08")
def test_pic_servo_answers_at_the_end_of_its_cycle():
    """SV 3.1, 4.1: up to 0.51 ms between command and status packet, which starts at the end of a servo cycle."""
    sim, host, chips = servos()
    clock = chips[0].clock
    delays = []
    for k in range(200):
        host.wait_ms(0.013 * k)
        host.exchange(1, 0xE)
        first_bit = round(sim.bus_logs[0].status_ns[-2] - 10e9 / chip_baud(10))
        tick = clock.tick_at(first_bit + 5)
        assert abs(clock.ns_of(tick) - first_bit) <= 5
        delays.append(first_bit - sim.bus_logs[0].host_ns[-1])
    assert 0 <= min(delays) < 30_000
    assert 480_000 < max(delays) <= 512_001


@item("N-027")
def test_up_to_32_modules():
    """ST 1.0, SV 6.1: a total of 32 controllers; more do not fit."""
    specs = [StepModule(f"M{k}") if k % 2 else ServoModule(f"M{k}") for k in range(32)]
    sim, host = machine(specs)
    host.start_up(32)
    assert [host.items(a, 0x20, 2)[0] for a in range(1, 33)] == [0, 3] * 16
    assert sim.violations == []
    with pytest.raises(ValueError, match="32"):
        build([BusSpec("b", tuple(StepModule(f"M{k}") for k in range(33)))], 1)


# -- addressing -------------------------------------------------------------------------------------------------------


@item("N-030", "N-031", "N-032", "SV-078", "SV-079", "N-091")
@both
def test_power_up_addresses(chip):
    """ST 3.2, 3.3, SV 4.5: individual address 0x00, group 0xFF, not leader, ADDR_OUT HIGH; 0 stays usable."""
    sim, host = single(chip)
    module = sim.modules["A"]
    assert (module.address, module.group, module.leader, module.addr_out_low) == (0x00, 0xFF, False, False)
    assert len(host.exchange(0, 0xE)) == 1
    host.send(0xFF, 0x2, [0x01])
    assert host.silent()
    assert len(host.exchange(0, 0xE, extra=4)) == 5


@item("N-033", "N-034", "N-035", "X-42")
def test_chain_wakes_one_module_after_the_other():
    """ST 3.2, SV 4.1: only the module farthest from the host is alive; Set Address enables the next one."""
    sim, host = mixed()
    host.wait_ms(2)
    names = ["A", "B", "C", "D"]
    for number, kind in enumerate([3, 0, 3, 0], start=1):
        assert [sim.modules[n].alive for n in names] == [k < number for k in range(4)]
        assert host.items(0, 0x20, 2)[0] == kind
        host.exchange(0, 0x1, [number, 0xFF])
        host.wait_ms(1)
    assert host.exchange(1, 0x1, [9, 0xFF])
    host.wait_ms(1)
    assert all(sim.modules[n].addr_out_low for n in names)  # it stays LOW


@item("N-039", "N-040", "N-041", "N-042", "N-045", "N-043")
@both
@pytest.mark.parametrize(
    ("byte", "group", "leads"),
    [
        (0x80, 0x80, False),
        (0xFF, 0xFF, False),
        (0x00, 0x80, True),
        (0x7F, 0xFF, True),
        (0x23, 0xA3, True),
        (0xA3, 0xA3, False),
    ],
)
def test_group_byte(chip, byte, group, leads):
    """ST 5.1, SV 5.2 Set Address: bit 7 clear makes the module leader of group byte | 0x80; members stay silent."""
    sim, host = single(chip)
    for address in (1, 0x7E):
        host.exchange(sim.modules["A"].address, 0x1, [address, byte])
        host.wait_ms(1)
        module = sim.modules["A"]
        assert (module.address, module.group, module.leader) == (address, group, leads)
        host.send(group, 0xE)
        assert host.silent() != leads
        host.link.flush_input()


@item("N-044", "N-045", "N-080", "N-085")
def test_group_command_reaches_every_member_and_the_leader_answers():
    """ST 3.3, SV 4.1, 5.2: all members execute; Save as Home latches both chip types on one packet."""
    sim, host = mixed()
    host.start_up(4)
    for address in (1, 3):
        host.exchange(address, 0x6, [3, 1, 100, 50, 0])
        host.exchange(address, 0x7, [0x01])
        host.exchange(address, 0x4, [0x08, 0x00, 0xF0, 10])
    for address in (2, 4):
        host.exchange(address, 0x4, [0x36, *i32(65536), *i32(65536)])
    host.wait_ms(1)
    assert len(host.exchange(GROUP, 0x5)) == 1
    assert host.silent(2_000_000)
    host.wait_ms(500)
    assert len(host.exchange(GROUP, 0xC)) == 1
    host.wait_ms(2)
    for address, name in ((1, "A"), (3, "C")):
        assert 0 < host.home(address) <= sim.modules[name].position
        assert sim.modules[name].moving
    for address, name in ((2, "B"), (4, "D")):
        assert sim.modules[name].n[GOAL_VELOCITY] == 65536
        assert host.home(address) == 0  # no gains: the first error switches the servo off
    assert sim.violations == []


# -- start-up ---------------------------------------------------------------------------------------------------------


@item("N-062")
@both
@pytest.mark.parametrize("sent", range(1, 19))
def test_sixteen_nulls_finish_any_half_received_packet(chip, sent):
    """ST 3.4 step 2: a string of 16 null bytes fills up any partially filled command buffer (15 data and checksum)."""
    _, host = single(chip)
    host.link.write(packet(0x55, 0xE, bytes([0x77] * 15))[:sent])
    host.wait_ms(20)
    host.link.write(bytes(16))
    host.wait_ms(20)
    host.link.flush_input()
    assert len(host.exchange(0, 0xE)) == 1


@item("N-062")
def test_stray_header_and_nulls_are_a_reset_position():
    """Derived from ST 3.1 and 5.1: AA 00 00 00 is a valid Reset Position to address 0, and is obeyed."""
    sim, host = machine([StepModule("A")])
    host.wait_ms(2)
    host.exchange(0, 0x6, [3, 1, 0, 0, 0])
    host.exchange(0, 0x7, [0x01])
    host.exchange(0, 0x4, [0x89, *i32(7), 0x00, 0xF0, 10])
    host.wait_ms(500)
    assert sim.modules["A"].position == 7
    host.link.write(b"\xaa" + bytes(16))
    host.wait_ms(20)
    assert sim.modules["A"].position == 0


# -- shared commands --------------------------------------------------------------------------------------------------


@item("N-070", "N-071", "N-072", "N-074", "N-075", "N-076", "N-077", "N-078")
@both
def test_status_items(chip):
    """ST 5.1, SV 5.2: Define Status stays, Read Status is for one reply, items in the order of their bits."""
    sizes = {0x01: 4, 0x02: 1, 0x04: 2, 0x08: 1, 0x10: 4, 0x20: 2}
    _, host = single(chip)
    for mask, size in sizes.items():
        assert len(host.exchange(0, 0x3, [mask], size)) == 1 + size
        assert len(host.exchange(0, 0xE)) == 1
        assert len(host.exchange(0, 0x2, [mask], size)) == 1 + size
        assert len(host.exchange(0, 0xE, extra=size)) == 1 + size
        host.exchange(0, 0x2, [0])
    whole = host.exchange(0, 0x3, [0x3F], 14)
    assert len(whole) == 15
    parts = b"".join(host.exchange(0, 0x3, [mask], size)[1:] for mask, size in sizes.items())
    assert whole[1:] == parts
    assert parts[-2:] == (bytes([3, 1]) if chip == "step" else bytes([0, 4]))
    host.exchange(0, 0x2, [0x21], 6)
    assert len(host.exchange(0, 0x3, [0x08], 1)) == 2
    assert len(host.exchange(0, 0xE, extra=6)) == 7


@item("N-083")
@both
def test_answer_to_set_baud_comes_at_the_new_rate(chip):
    """ST 5.1, SV 5.2: a status packet returned from this command would be at the new baud rate."""
    sim, host = single(chip)
    host.send(0, 0xA, [129])
    sim.buses[0].status.host_baud = 9600.0
    assert len(host.listen()) == 1
    ns = sim.bus_logs[0].status_ns
    assert 10e9 / (ns[1] - ns[0]) == pytest.approx(9615, abs=1)
    assert [v.rule for v in sim.violations] == ["N-084"]


@item("N-086")
@both
def test_nop_changes_nothing(chip):
    """ST 5.1, SV 5.2: does nothing except return the currently defined status data."""
    _, host = single(chip)
    first = host.exchange(0, 0x3, [0x3F], 14)
    for _ in range(5):
        host.exchange(0, 0xE)
    assert host.exchange(0, 0x3, [0x3F], 14) == first


@item("N-087", "N-090")
@both
def test_hard_reset(chip):
    """ST 5.1, SV 5.2: power-up state, no status; so address 0, group 0xFF, ADDR_OUT HIGH, 19200 baud, no items."""
    sim, host = single(chip)
    host.exchange(0, 0x1, [5, 0x13])
    host.exchange(5, 0x2, [0x01], 4)
    host.send(0x93, 0xA, [10])
    host.wait_ms(5)
    host.link.set_baud(115200)
    host.link.flush_input()
    host.send(5, 0xF)
    assert host.silent()
    host.link.set_baud(19200)
    host.link.flush_input()
    module = sim.modules["A"]
    assert (module.address, module.group, module.leader, module.addr_out_low) == (0x00, 0xFF, False, False)
    assert len(host.exchange(0, 0xE)) == 1


@item("N-088", "N-089", "X-93")
def test_hard_reset_to_ff_reaches_every_step_but_not_every_servo():
    """ST 5.1: PIC-STEP obeys a Hard Reset to 0xFF whatever its group; earlier NMC controllers do not."""
    sim, host = mixed()
    host.start_up(4)
    host.send(0xFF, 0xF)
    host.wait_ms(5)
    assert [m.address for m in sim.modules.values()] == [0, 2, 0, 4]


@item("N-090")
def test_hard_reset_silences_what_is_behind_it():
    """ST 2.3, 3.2: ADDR_OUT goes HIGH again, so the modules behind lose ADDR_IN."""
    sim, host = mixed()
    host.start_up(4)
    host.send(2, 0xF)
    host.wait_ms(5)
    assert [m.alive for m in sim.modules.values()] == [True, True, False, True]
    host.send(3, 0xE)
    assert host.silent()


# -- silences of the sheets, as chosen --------------------------------------------------------------------------------


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
    assert [v.rule for v in sim.violations] == ["X-40", "X-40"]


@item("X-41")
@both
def test_undefined_commands_are_answered_like_nop(chip):
    """Choice: reply as No Operation, logged."""
    sim, host = single(chip)
    undefined = [0xB, 0xD] if chip == "step" else [0xD]
    for command in undefined:
        assert len(host.exchange(0, command)) == 1
    host.wait_ms(1)
    assert [v.rule for v in sim.violations] == ["X-41"] * len(undefined)


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
    assert {v.rule for v in sim.violations} == {"X-49"}


@item("X-50")
def test_set_address_to_a_group_makes_addresses_collide():
    """Choice: executed by all members, logged; the collision is then real."""
    sim, host = mixed()
    host.start_up(4)
    host.exchange(GROUP, 0x1, [7, 0x81])
    host.wait_ms(2)
    assert [m.address for m in sim.modules.values()] == [7] * 4
    assert {v.rule for v in sim.violations} == {"X-50"}
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
    assert [v.rule for v in sim.violations] == ["N-022"]
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
        assert [v.rule for v in sim.violations] == rules


def test_a_host_raises_when_nobody_answers():
    sim, host = machine([StepModule("A")])
    with pytest.raises(NoReplyError, match="silence"):
        host.exchange(9, 0xE)
    assert isinstance(host, RawHost)
    assert sim.violations == []
    assert SimOptions().reached_stop_is_stopped
