"""pylabrobot's driver of a laboratory centrifuge on the virtual machine ``vspin``.

Its authors know nothing of this simulator: network initialisation with baud search, servo commands at address 1, a
PIC-I/O at address 2, homing on the index and a trapezoid back to it.
"""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
import serial  # noqa: TID251 - the client's own transport, replaced by a plain port

pytest.importorskip("pylabrobot.agilent.vspin.vspin")
pytestmark = pytest.mark.clients

BITS_PER_BYTE = 10


class SerialFtdi:
    """The FTDI transport that the driver expects, over a serial port."""

    port = ""

    def __init__(self, human_readable_device_name: str, device_id: str | None = None, **_: Any) -> None:
        self.device_id = device_id
        self._serial: serial.Serial | None = None
        self._baud = 19200

    async def setup(self, **_: Any) -> None:
        self._serial = serial.Serial(self.port, self._baud, timeout=0)

    async def stop(self) -> None:
        assert self._serial is not None
        self._serial.close()

    async def read(self, count: int) -> bytes:
        assert self._serial is not None
        data = self._serial.read(count)
        if not data:
            await asyncio.sleep(0.0005)
        return bytes(data)

    async def write(self, data: bytes) -> int:
        """A pty takes bytes faster than a wire; the driver relies on the wire's pace when it floods the network."""
        assert self._serial is not None
        self._serial.write(data)
        await asyncio.sleep(len(data) * BITS_PER_BYTE / self._baud)
        return len(data)

    async def set_baudrate(self, baud: int) -> None:
        self._baud = baud
        if self._serial is not None:
            self._serial.baudrate = baud

    async def usb_purge_rx_buffer(self) -> None:
        assert self._serial is not None
        self._serial.reset_input_buffer()

    async def request_serial(self) -> str:
        return "virtual"

    async def _nothing(self, *_: Any, **__: Any) -> None:
        pass

    set_latency_timer = set_line_property = set_flowctrl = set_rts = set_dtr = _nothing


@pytest.fixture
def centrifuge(serve_machine, monkeypatch):
    from pylabrobot.agilent.vspin import vspin

    SerialFtdi.port = serve_machine("vspin")
    monkeypatch.setattr(vspin, "FTDI", SerialFtdi)
    # Half a second of patience instead of 0.2: this is a loaded computer, not a chip.
    original = vspin.VSpin._read_exact_response

    async def patient(self, length: int, timeout: float) -> bytes:
        return await original(self, length, max(timeout, 0.5) if timeout > 0.1 else timeout)

    monkeypatch.setattr(vspin.VSpin, "_read_exact_response", patient)
    return vspin


def test_network_initialisation_and_servo_commands(centrifuge) -> None:
    nmc = centrifuge._nmc

    async def session() -> None:
        spin = centrifuge.VSpin("virtual")
        await spin.io.setup()
        await spin._initialize_nmc_network()
        servo = nmc.PIC_SERVO_ADDRESS
        answer = await spin._send_nmc(nmc.build_read_status(servo, 0x20), response_data_length=2)
        assert answer.data == bytes([0, 4])
        answer = await spin._send_nmc(nmc.build_read_status(nmc.PIC_IO_ADDRESS, 0x20), response_data_length=2)
        assert answer.data[0] == nmc.PIC_IO_MODULE_TYPE
        await spin._send_nmc(nmc.build_set_gain(servo, nmc.ServoGains(100, 1000, 50, 1000, 255, 0, 4000, 1, 0)))
        await spin._send_nmc(nmc.build_stop_motor(servo, nmc.STOP_ABRUPT | nmc.AMPLIFIER_ENABLE))
        await spin._send_nmc(nmc.build_clear_bits(servo))
        load = nmc.build_load_trajectory(servo, 0x97, position=4000, velocity=20 * 65536, acceleration=2000)
        await spin._send_nmc(load)
        for _ in range(200):
            answer = await spin._send_nmc(nmc.build_read_status(servo, 0x01), response_data_length=4)
            if answer.status & nmc.STATUS_MOVE_DONE:
                break
            await asyncio.sleep(0.02)
        assert not answer.status & nmc.STATUS_POSITION_ERROR
        assert abs(int.from_bytes(answer.data, "little", signed=True) - 4000) < 40
        await spin._send_nmc(nmc.build_set_output(nmc.PIC_IO_ADDRESS, 0x0100))
        await spin.io.stop()

    asyncio.run(session())


def test_the_whole_setup_with_homing(centrifuge) -> None:
    async def session() -> None:
        spin = centrifuge.VSpin("virtual")
        await spin.setup()
        assert abs(await spin.request_position()) < 100
        assert 0 <= spin._home_position < 8000
        await spin.stop()

    asyncio.run(session())
