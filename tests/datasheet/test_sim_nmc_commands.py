"""The simulated bus: commands that both chips share.

Both chips are tried wherever both sheets speak (PIC-STEP section 3, PIC-SERVO section 4.1).
"""

import pytest

from sim.rawhost import mixed, single

item = pytest.mark.item
both = pytest.mark.parametrize("chip", ["step", "servo"])


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
    assert sim.rules() == ["N-084"]


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
