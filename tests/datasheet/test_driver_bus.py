"""What the driver must do on the bus, PIC-STEP section 3 and PIC-SERVO section 4.1: framing, rates, times."""

from __future__ import annotations

import pytest

from nmc.bus import Bus
from nmc.chips import picservo, picstep
from nmc.chips.common import BAUD_DIVISORS, SILENT_WAIT_NS, true_baud
from nmc.codec import encode
from nmc.errors import LocalFault
from nmc.program import Exchange
from nmc.recording_link import HOST, STATUS, RecordingLink
from nmc.setup import ModuleExpectation, change_baud, set_group, start_up
from nmc.wire import PacketReader, pack
from sim.build import build
from sim.spec import BusSpec, IoModule, ServoModule, StepModule

item = pytest.mark.item
STEP, SERVO, IO = ModuleExpectation("pic-step"), ModuleExpectation("pic-servo"), ModuleExpectation("pic-io")
CHIPS = {"step": (StepModule, STEP), "servo": (ServoModule, SERVO), "io": (IoModule, IO)}


def network(*chips: str, seed: int = 1):
    """(simulation, recording link, bus, expectations) of a powered-up network that nobody has spoken to."""
    modules = tuple(CHIPS[chip][0](f"{chip}{number}") for number, chip in enumerate(chips))
    simulation = build([BusSpec("bus", modules)], seed)
    link = RecordingLink(simulation.links[0])
    return simulation, link, Bus(link), [CHIPS[chip][1] for chip in chips]


def started(*chips: str, baud: int = 115_200):
    simulation, link, bus, expected = network(*chips)
    start_up(bus, expected, baud)
    return simulation, link, bus


def sent(link: RecordingLink) -> list[bytes]:
    return [chunk.data for chunk in link.chunks if chunk.line == HOST]


# -- framing ----------------------------------------------------------------------------------------------------------


@item("N-001", "N-002", "N-003", "N-081")
@pytest.mark.parametrize("baud", [9600, 19200, 57600, 115200])
def test_every_listed_rate_is_used(baud: int) -> None:
    """ST 3.1, 5.1: 8N1 (a simulated byte is ten bits), 19200 after power-up, any listed rate afterwards."""
    divisors = {9600: 129, 19200: 63, 57600: 20, 115200: 10}
    _, link, bus = started("step", "servo", baud=baud)
    assert divisors == BAUD_DIVISORS
    assert bus.exchange(Exchange(1, 0xE)).status is not None
    rates = [int(chunk.data) for chunk in link.chunks if chunk.line == "b"]
    assert rates[0] == 19200
    assert bus.baud == baud
    if baud != 19200:
        assert pack(0xFF, 0xA, bytes([divisors[baud]])) in sent(link)


@item("N-082", "X-10")
def test_true_rates_and_a_better_divisor_for_57600() -> None:
    """Derived from SPBRG on 20 MHz: 9615, 19531, 59524 (+3.34 %), 113636 (-1.36 %); BRD 21 is 56818."""
    assert [round(true_baud(divisor)) for divisor in (129, 63, 20, 10, 21)] == [9615, 19531, 59524, 113636, 56818]
    _, _, bus = started("step", "step")
    change_baud(bus, 57600, 21)
    assert bus.exchange(Exchange(2, 0xE)).status is not None
    with pytest.raises(LocalFault, match="divisor"):
        bus.set_baud(57600, 19)


@item("N-006", "N-007", "N-008", "N-009", "N-013", "N-014")
def test_shape_of_a_command_packet() -> None:
    """ST 3.1: 0xAA, address, length and command, data, sum of address to last data byte; 4 to 19 bytes."""
    assert pack(5, 0xE) == bytes([0xAA, 5, 0x0E, 5 + 0x0E])
    data = bytes(range(100, 115))
    packet = pack(0xAA, 4, data)
    assert packet[:3] == bytes([0xAA, 0xAA, 0xF4])
    assert packet[3:-1] == data
    assert packet[-1] == (0xAA + 0xF4 + sum(data)) & 0xFF
    assert len(packet) == 19
    _, gains = encode(picservo.FACTS, "set_gain", dict.fromkeys(_GAINS, 1))
    assert len(pack(1, 6, gains)) == 18


_GAINS = [field.name for field in picservo.FACTS.command("set_gain").fields]


@item("N-012")
def test_length_nibble_always_equals_the_data() -> None:
    """ST 3.1: the host has to see to it; every packet that the driver ever sends is read back whole."""
    _, link, bus = started("step", "servo", "io")
    change_baud(bus, 19200)
    stream = b"".join(sent(link))
    packets = [p for p in PacketReader().feed(stream) if hasattr(p, "intact")]
    assert len(packets) > 20
    assert all(packet.intact for packet in packets)


@item("N-013", "N-015", "N-016")
def test_the_smallest_reply_is_two_bytes() -> None:
    """SV 3.1: a reply without items is status and checksum, and the driver reads just that."""
    _, link, bus = started("step")
    link.chunks.clear()
    bus.exchange(Exchange(1, 0xE))
    assert [len(chunk.data) for chunk in link.chunks if chunk.line == STATUS] == [2]


@item("N-017")
def test_multi_byte_values_are_least_significant_byte_first() -> None:
    """SV 5.2, Load Trajectory: 4 bytes of position, least significant byte first; replies alike (ST 5.1)."""
    _, data = encode(picstep.FACTS, "load_trajectory", {"position": 0x01020304})
    assert data == bytes([0x01, 4, 3, 2, 1])
    _, data = encode(picservo.FACTS, "load_trajectory", {"position": -2})
    assert data == bytes([0x01, 0xFE, 0xFF, 0xFF, 0xFF])


@item("N-022")
@pytest.mark.parametrize("chips", [("step",), ("servo",), ("step", "servo", "io")])
def test_the_next_command_waits_for_the_answer(chips: tuple[str, ...]) -> None:
    """ST 3.1, SV 4.1: no command before the reply to the one before; nothing else between them on the wire."""
    simulation, link, bus = started(*chips)
    link.chunks.clear()
    for _ in range(20):
        for address in range(1, len(chips) + 1):
            bus.exchange(Exchange(address, 0xE))
    assert "".join(chunk.line for chunk in link.chunks) == "><" * 20 * len(chips)
    assert simulation.violations == []


@item("N-023")
@pytest.mark.parametrize("chips", [("step", "step"), ("servo", "servo")])
def test_after_a_silent_group_half_a_millisecond_passes(chips: tuple[str, ...]) -> None:
    """ST 3.3: at least 0.5 ms; SV 4.1: at least 0.51 ms. The driver waits 0.512 ms from the end of the packet."""
    _, link, bus = started(*chips)
    for address in (1, 2):
        set_group(bus, address, 0x90)
    before_ns = link.now_ns()
    assert bus.exchange(Exchange(0x90, 0xC)).status is None
    assert SILENT_WAIT_NS >= 510_000
    assert link.now_ns() - before_ns >= 4 * 10e9 / 115200 + SILENT_WAIT_NS


@item("N-026")
def test_a_pic_servo_gets_at_most_a_thousand_commands_a_second() -> None:
    """SV 3.1: command rate 1000 Hz max (approx.)."""
    _, link, bus = started("servo")
    before_ns = link.now_ns()
    for _ in range(100):
        bus.exchange(Exchange(1, 0xE))
    assert link.now_ns() - before_ns >= 99 * 1_000_000


@item("N-027", "N-039", "X-43")
def test_32_modules_and_no_more() -> None:
    """ST 1.0: up to 32 controllers; the driver gives them the addresses 1 to 32."""
    _, _, bus, _ = network(*["step"] * 32)
    infos = start_up(bus, [STEP] * 32)
    assert [info.address for info in infos] == list(range(1, 33))
    with pytest.raises(LocalFault, match="at most 32"):
        start_up(bus, [STEP] * 33)
