"""Output pins of the chips over time: what is noted of them, and what the trace keeps."""

from pathlib import Path

import numpy as np

from sim.rawhost import machine
from sim.spec import IoModule, ServoModule, StepModule
from sim.trace import load


def pins(simulation):
    return [(each.module, each.pin, each.value) for each in simulation.log.outputs]


def test_a_stepper_notes_the_pins_that_differ_and_a_reset_puts_them_back():
    simulation, host = machine([StepModule("X")])
    host.start_up(1)
    host.exchange(1, 0x8, [0x11])  # OUT1 on, OUT5 stays as it was after power-up (section 2.3)
    host.exchange(1, 0x8, [0x11])
    host.exchange(1, 0x8, [0x02])
    host.wait_ms(1)
    assert pins(simulation) == [("X", "out1", 1), ("X", "out1", 0), ("X", "out2", 1), ("X", "out5", 0)]
    host.send(0xFF, 0xF)
    host.wait_ms(1)
    assert pins(simulation)[4:] == [("X", "out2", 0), ("X", "out5", 1)]


def test_pins_of_a_pic_io_show_only_where_they_are_outputs():
    simulation, host = machine([IoModule("io")])
    host.start_up(1)
    host.exchange(1, 0x6, [0x03, 0x00])
    assert pins(simulation) == []
    host.exchange(1, 0x0, [0xFE, 0x0F])  # bit 0 becomes an output
    host.exchange(1, 0x4, [9, 0])
    assert pins(simulation) == [("io", "bit0", 1), ("io", "pwm1", 9)]


def test_a_servo_notes_pwm_mode_and_limit_pins_and_not_what_its_filter_does():
    simulation, host = machine([ServoModule("S", moves=False)])
    host.start_up(1)
    host.exchange(1, 0x8, [0x09])  # limit 1 is an output and HIGH (section 5.2, I/O Control)
    host.exchange(1, 0x7, [0x01])  # amplifier on
    host.exchange(1, 0x4, [0x88, 77])
    host.exchange(1, 0x4, [0xC8, 30])
    host.exchange(1, 0x7, [0x02])
    assert pins(simulation) == [("S", "limit1", 1), ("S", "pwm", 77), ("S", "pwm", -30), ("S", "pwm", 0)]
    gains = [220, 0, 80, 10, 150, 0, 160, 15, 255, 0, 160, 15, 1]
    host.exchange(1, 0x6, gains)
    host.exchange(1, 0x7, [0x05])
    host.wait_ms(50)
    assert len(simulation.log.outputs) == 4
    assert simulation.trace().axes == ()


def test_the_trace_keeps_pins_in_order_of_time_and_files_without_them_read_as_ever(tmp_path: Path):
    simulation, host = machine([StepModule("X"), IoModule("io")])
    host.start_up(2)
    simulation.trace().save(tmp_path / "none.npz")
    with np.load(tmp_path / "none.npz") as file:
        assert not [name for name in file if name.startswith("pin_")]
    assert load(tmp_path / "none.npz").pin_names == ()
    host.exchange(2, 0x4, [200, 3])
    host.exchange(1, 0x8, [0x14])
    host.wait_ms(1)
    simulation.trace().save(tmp_path / "some.npz")
    trace = load(tmp_path / "some.npz")
    assert trace.pin_names == ("X.out3", "io.pwm1", "io.pwm2")
    assert trace.pin_index.tolist() == [1, 2, 0]
    assert trace.pin_value.tolist() == [200, 3, 1]
    assert np.all(np.diff(trace.pin_ns) >= 0)
