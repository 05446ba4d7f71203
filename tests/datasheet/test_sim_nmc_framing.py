"""The simulated bus: bytes, packets, checksums, replies.

Both chips are tried wherever both sheets speak (PIC-STEP section 3, PIC-SERVO section 4.1).
"""

import numpy as np
import pytest

from sim.build import build
from sim.rawhost import i32, machine, packet, servos, single, steppers
from sim.spec import BusSpec, ServoModule, StepModule
from sim.uart import chip_baud

item = pytest.mark.item
both = pytest.mark.parametrize("chip", ["step", "servo"])


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
