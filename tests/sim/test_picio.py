"""PIC-I/O as a small module type."""

from sim.rawhost import machine
from sim.spec import IoFollow, IoModule, ServoModule


def test_pins_outputs_and_latches():
    sim, host = machine([ServoModule("S"), IoModule("IO", inputs=0x0A5, analog=(1, 2, 3))])
    host.start_up(2)
    assert host.items(2, 0x20, 2) == bytes([2, 2])
    assert host.items(2, 0x01, 2) == bytes([0xA5, 0x00])
    assert host.items(2, 0x0E, 3) == bytes([1, 2, 3])
    host.exchange(2, 0x0, [0x0F, 0x00])  # bits 0-3 inputs, the others outputs
    host.exchange(2, 0x6, [0x50, 0x0F])
    assert host.items(2, 0x01, 2) == bytes([0x55, 0x0F])
    host.exchange(2, 0x7, [0x00, 0x00, 9, 8])
    assert host.items(2, 0x01, 2) == bytes([0x55, 0x0F])
    host.exchange(2, 0xC)
    host.exchange(2, 0x5)
    assert host.items(2, 0x01, 2) == bytes([0x05, 0x00])
    assert host.items(2, 0x40, 2) == bytes([0x55, 0x0F])
    host.exchange(2, 0x4, [7, 6])
    assert sim.modules["IO"].pwm == (7, 6)
    assert sim.violations == []


def test_timer_runs_at_5_mhz_over_its_divisor():
    _, host = machine([IoModule("IO")])
    host.start_up(1)
    host.exchange(1, 0x8, [0x21])
    before = int.from_bytes(host.items(1, 0x10, 4), "little"), host.link.now_ns()
    host.wait_ms(100)
    after = int.from_bytes(host.items(1, 0x10, 4), "little"), host.link.now_ns()
    assert abs((after[0] - before[0]) - (after[1] - before[1]) / 800) < 1000
    host.exchange(1, 0x8, [0x00])
    assert host.items(1, 0x10, 4) == bytes(4)


def test_reset_and_full_mask():
    _, host = machine([IoModule("IO")])
    host.start_up(1)
    assert len(host.exchange(1, 0x3, [0xFF], 17)) == 18
    host.exchange(1, 0x0, [0, 0])
    host.send(1, 0xF)
    host.wait_ms(5)
    host.link.set_baud(19200)
    assert host.items(0, 0x01, 2) == bytes(2)


def test_wrong_commands_are_logged():
    sim, host = machine([IoModule("IO")])
    host.start_up(1)
    host.exchange(1, 0xD)
    host.exchange(1, 0x6, [1])
    assert [v.rule for v in sim.violations] == ["X-41", "X-40"]


def test_inputs_follow_actuators():
    _, host = machine([IoModule("IO", inputs=0x001, follows=(IoFollow(7, 10), IoFollow(4, 8, inverted=True)))])
    host.start_up(1)
    host.exchange(1, 0x0, [0xFF, 0x08])
    for outputs, seen in ((0x000, 0x011), (0x400, 0x491), (0x100, 0x101)):
        host.exchange(1, 0x6, outputs.to_bytes(2, "little"))
        assert host.items(1, 0x01, 2) == seen.to_bytes(2, "little")
