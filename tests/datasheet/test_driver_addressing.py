"""Addresses, groups, start-up and reset as the driver does them, PIC-STEP sections 3.2 to 3.4, PIC-SERVO 4.1."""

from __future__ import annotations

import pytest

from nmc.bus import Bus
from nmc.chips import picservo
from nmc.codec import encode
from nmc.errors import LinkTimeout, LocalFault, RemoteFault
from nmc.picstep import PicStep
from nmc.program import Exchange
from nmc.recording_link import HOST, RecordingLink
from nmc.scan import scan
from nmc.setup import ModuleExpectation, set_group, start_up
from nmc.wire import pack
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


# -- addressing -------------------------------------------------------------------------------------------------------


@item("N-036")
def test_enumeration_begins_at_the_far_end() -> None:
    """ST 3.2: Set Address to 0 with 1, 2, 3; the module farthest from the host becomes 1."""
    simulation, link, bus, expected = network("step", "servo", "io")
    start_up(bus, expected)
    assert [simulation.modules[name].address for name in ("step0", "servo1", "io2")] == [1, 2, 3]
    first = [packet for packet in sent(link) if packet[2] == 0x21][:3]
    assert first == [bytes([0xAA, 0, 0x21, n, 0xFF, (0x21 + n + 0xFF) & 0xFF]) for n in (1, 2, 3)]


@item("N-037", "N-055")
def test_enumeration_ends_with_silence_and_the_count_is_compared() -> None:
    """ST 3.4 step 4: the number of modules found must be the number expected."""
    _, link, bus, _ = network("step", "step")
    with pytest.raises(RemoteFault, match="2 modules on the bus, 3 expected"):
        start_up(bus, [STEP] * 3, recover=False)
    assert [packet[3] for packet in sent(link) if packet[2] == 0x21] == [1, 2, 3]
    _, _, bus, _ = network("step", "step")
    with pytest.raises(RemoteFault, match="at least 2"):
        start_up(bus, [STEP], recover=False)


@item("N-038", "N-090", "X-42")
def test_addresses_are_given_out_again_after_a_reset() -> None:
    """ST 3.2: every time the network is powered up or reset; the driver forgets everybody and begins anew."""
    _, _, bus = started("step", "servo")
    bus.exchange(Exchange(0x82, 0xF))
    assert bus.guard.modules == {}
    infos = start_up(bus, [STEP, SERVO])
    assert [info.address for info in infos] == [1, 2]


@item("N-039", "N-041", "N-042")
def test_group_bytes() -> None:
    """ST 3.3, 5.1: groups 128..255; bit 7 of the second byte clear makes a leader, set a member."""
    _, link, bus = started("step", "step")
    step = PicStep(bus, 1)
    for group in (127, 256, 0):
        with pytest.raises(LocalFault, match=r"128\.\.255"):
            step.set_address(1, group)
    step.set_address(1, 0x85, leader=True)
    assert sent(link)[-1][3:5] == bytes([1, 0x05])
    step.set_address(1, 0x85)
    assert sent(link)[-1][3:5] == bytes([1, 0x85])


@item("N-043", "N-060")
def test_groups_change_at_any_time() -> None:
    """ST 3.4: Set Address may re-assign group addresses at any time; the driver follows who leads what."""
    _, _, bus = started("step", "step")
    set_group(bus, 1, 0x81, leader=True)
    assert bus.exchange(Exchange(0x81, 0xC)).status is not None
    set_group(bus, 1, 0x81)
    assert bus.exchange(Exchange(0x81, 0xC)).status is None
    set_group(bus, 2, 0x81, leader=True)
    assert bus.exchange(Exchange(0x81, 0xC)).status is not None


@item("N-045", "N-047")
def test_the_driver_expects_an_answer_from_leaders_only() -> None:
    """ST 3.3: a member is silent on group commands but answers at its own address."""
    _, _, bus = started("step", "step", "servo")
    assert [module.leader for module in bus.guard.modules.values()] == [True, False, False]
    assert bus.exchange(Exchange(0x82, 0xE)).status is not None
    assert bus.exchange(Exchange(2, 0xE)).status is not None


@item("N-046")
def test_one_leader_a_group() -> None:
    """ST 3.3: only one module should be declared the group leader."""
    _, link, bus = started("step", "step")
    before = len(sent(link))
    with pytest.raises(LocalFault, match="already has a leader"):
        set_group(bus, 2, 0x82, leader=True)
    assert len(sent(link)) == before


@item("N-048", "N-057", "N-084")
def test_set_baud_goes_to_everybody_and_nobody_answers() -> None:
    """ST 5.1, SV 5.1: only to a group that includes all controllers, without a leader."""
    _, link, bus = started("step", "step")
    assert pack(0xFF, 0xA, b"\x0a") in sent(link)
    for exchange in (Exchange(1, 0xA, b"\x3f"), Exchange(0x82, 0xA, b"\x3f"), Exchange(0xFF, 0xA, b"\x3f")):
        with pytest.raises(LocalFault, match="Set Baud"):
            bus.exchange(exchange)
    set_group(bus, 1, 0x82)
    assert bus.exchange(Exchange(0x82, 0xA, b"\x0a")).status is None


@item("N-050", "N-051", "N-052", "N-053", "N-054", "N-056", "N-058", "N-059")
def test_the_nine_steps() -> None:
    """ST 3.4, SV 4.1: the order of things after power-up, with their times."""
    _, link, bus, expected = network("step", "servo")
    start_up(bus, expected)
    chunks = link.chunks
    assert chunks[0].line == "b"
    assert chunks[0].data == b"19200"
    hosts = [chunk for chunk in chunks if chunk.line == HOST]
    assert hosts[0].data == bytes(16)
    nulls_gone_ns = hosts[0].time_ns + 160 * 1_000_000_000 // 19200
    assert hosts[1].time_ns - nulls_gone_ns >= 1_000_000
    kinds = [chunk.data[2] & 0x0F if chunk.data[0] == 0xAA else -1 for chunk in hosts]
    order = [kind for number, kind in enumerate(kinds) if number == 0 or kind != kinds[number - 1]]
    assert order == [-1, 0x1, -1, 0x3, 0xA, 0xE, 0x1]  # the second nulls end the search for a third module
    switched = next(number for number, chunk in enumerate(chunks) if chunk.line == "b" and chunk.data == b"115200")
    assert chunks[switched - 1].data[2] == 0x1A
    assert [chunk.data[1:3] for chunk in chunks[switched + 1 :] if chunk.line == HOST][:2] == [b"\x01\x0e", b"\x02\x0e"]


@item("N-056", "N-077", "ST-104", "SV-104", "X-94")
def test_types_and_versions_are_compared() -> None:
    """ST 3.4 step 5: PIC-STEP is type 3, PIC-SERVO type 0 (SV 4.1)."""
    _, _, bus, expected = network("step", "servo", "io")
    infos = start_up(bus, expected)
    assert [(info.device_type, info.version) for info in infos] == [(3, 1), (0, 4), (2, 2)]
    for wanted in ([SERVO, STEP, IO], [STEP, ModuleExpectation("pic-servo", 3), IO]):
        _, _, bus, _ = network("step", "servo", "io")
        with pytest.raises(RemoteFault, match="was expected"):
            start_up(bus, wanted, recover=False)


@item("N-061")
def test_a_simple_network_at_19200() -> None:
    """ST 3.4, footnote: without groups and faster rates only steps 1 and 3 are needed."""
    _, link, bus = started("step", baud=19200)
    assert not any(packet[2] == 0x1A for packet in sent(link))
    assert bus.exchange(Exchange(1, 0xE)).status is not None


@item("N-073", "X-49")
@pytest.mark.parametrize("command", [2, 3])
@pytest.mark.parametrize("mask", [0x40, 0x80, 0xC0, 0x7F])
def test_mask_bits_6_and_7_stay_zero(command: int, mask: int) -> None:
    """ST 5.1, SV 5.2: not used - clear to zero."""
    _, link, bus = started("step", "servo")
    before = len(sent(link))
    for address in (1, 2):
        with pytest.raises(LocalFault):
            bus.exchange(Exchange(address, command, bytes([mask])))
    assert len(sent(link)) == before


@item("N-078")
@pytest.mark.parametrize("address", [1, 2])
def test_the_longest_reply_is_read_whole(address: int) -> None:
    """Derived: mask 0x3F is 14 bytes of items on both chips."""
    _, _, bus = started("step", "servo")
    assert len(bus.exchange(Exchange(address, 3, b"\x3f")).extra) == 14


@item("N-087", "N-088", "N-089", "X-93")
def test_a_mixed_network_is_reset_whole() -> None:
    """ST 5.1: a PIC-SERVO with another group does not obey a Hard Reset to 0xFF; the driver resets it all the same."""
    simulation, _, _ = started("servo", "step", "servo")
    again = Bus(simulation.links[0])
    infos = start_up(again, [SERVO, STEP, SERVO])
    assert [info.chip for info in infos] == ["pic-servo", "pic-step", "pic-servo"]


@item("X-42")
def test_nobody_is_reset_inside_the_chain() -> None:
    """ST 3.2: a reset raises ADDR_OUT and would silence the modules behind."""
    _, _, bus = started("step", "step")
    with pytest.raises(LocalFault, match="silences"):
        bus.exchange(Exchange(1, 0xF))
    bus.exchange(Exchange(2, 0xF))
    assert 2 not in bus.guard.modules


@item("X-44")
def test_a_half_sent_packet_does_not_block_the_network() -> None:
    """ST 3.4 step 2: nulls fill a partially filled command buffer."""
    _, link, bus = started("step")
    link.write(b"\xaa\x01\xf4\x01")
    assert bus.exchange(Exchange(1, 0xE)).status == 0x08
    assert bus.counters.resyncs >= 1


@item("X-50")
def test_no_set_address_to_a_group() -> None:
    """Both sheets are silent: all members would take one address."""
    _, _, bus = started("step", "step")
    with pytest.raises(LocalFault, match="all members one address"):
        bus.exchange(Exchange(0x82, 1, b"\x05\xff"))


@item("N-020", "N-019")
def test_a_rejected_command_is_told_or_repeated() -> None:
    """ST 3.1: a status packet with the error bit comes back and the command was not executed."""
    _, link, bus = started("step")
    flips = [1]
    inner_write = link.inner.write

    def write(data: bytes) -> None:
        inner_write(data[:-1] + bytes([data[-1] ^ flips.pop()]) if flips else data)

    link.inner.write = write
    assert bus.exchange(Exchange(1, 0xE)).status == 0x08
    assert bus.counters.rejected_commands == 1
    flips.append(4)
    with pytest.raises(RemoteFault) as caught:
        bus.exchange(Exchange(1, 0xC))
    assert caught.value.executed is False


@item("N-018")
def test_an_address_where_nobody_is() -> None:
    """ST 3.1: no module answers; the driver says so after its time."""
    _, _, bus = started("step")
    with pytest.raises(LinkTimeout, match="0 of 2 bytes"):
        bus.exchange(Exchange(9, 0xE))


@item("N-080", "N-085")
def test_start_and_latch_across_both_chips() -> None:
    """ST 5.1: load several PIC-STEP and PIC-SERVO chips, then start, and latch, with one packet each."""
    simulation, _, bus = started("step", "servo")
    step = PicStep(bus, 1)
    step.set_parameters("1x", minimum_speed=10)
    step.stop_motor()
    bus.exchange(Exchange(2, 6, encode(picservo.FACTS, "set_gain", _GAIN_VALUES)[1]))
    bus.exchange(Exchange(2, 7, b"\x05"))
    step.load_trajectory(position=400, speed=40, acceleration_time=4)
    values = {"position": 400, "velocity": 65536, "acceleration": 3000, "servo_mode": 1}
    bus.exchange(Exchange(2, 4, encode(picservo.FACTS, "load_trajectory", values)[1]))
    bus.exchange(Exchange(0x82, 5))
    bus.link.sleep_until(bus.link.now_ns() + 150_000_000)
    bus.exchange(Exchange(0x82, 0xC))
    homes = [int.from_bytes(bus.exchange(Exchange(a, 3, b"\x10")).extra, "little") for a in (1, 2)]
    assert all(0 < home < 400 for home in homes)
    assert simulation.violations == []


_GAIN_VALUES = {
    "position_gain": 220,
    "velocity_gain": 2640,
    "integral_gain": 150,
    "integration_limit": 4000,
    "output_limit": 255,
    "current_limit": 0,
    "position_error_limit": 4000,
    "servo_rate_divisor": 1,
    "deadband": 0,
}


@item("N-091")
def test_address_0_is_found_by_a_scan() -> None:
    """ST 3.2: until it is given another, a module answers at address 0."""
    _, _, bus, _ = network("step")
    assert [found.address for found in scan(bus).modules] == [1]
