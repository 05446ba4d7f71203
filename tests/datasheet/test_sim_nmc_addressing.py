"""The simulated bus: addresses, groups, the ADDR chain, start-up.

Both chips are tried wherever both sheets speak (PIC-STEP section 3, PIC-SERVO section 4.1).
"""

import pytest

from sim.rawhost import GROUP, i32, machine, mixed, packet, single
from sim.servokernel import GOAL_VELOCITY
from sim.spec import StepModule

item = pytest.mark.item
both = pytest.mark.parametrize("chip", ["step", "servo"])


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
