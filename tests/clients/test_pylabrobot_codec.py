"""Our encoders against those of pylabrobot, whose authors had a real centrifuge on their desk.

Whatever both can say must be the same bytes: an error in either would show as a difference.
"""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nmc.chips import picio, picservo
from nmc.chips.common import BAUD_DIVISORS, HARD_RESET, SET_BAUD
from nmc.codec import decode_status, encode
from nmc.wire import pack, unpack_reply

theirs = pytest.importorskip("pylabrobot.agilent.vspin._nmc")
pytestmark = pytest.mark.clients

ADDRESS = st.integers(0, 32)
BYTE = st.integers(0, 255)
WORD = st.integers(0, 0x7FFF)
POSITION = st.integers(-0x7FFFFFFF, 0x7FFFFFFF)
MAGNITUDE = st.integers(0, 0x7FFFFFFF)


def ours(address: int, name: str, facts=picservo.FACTS, **values: int) -> bytes:
    command, data = encode(facts, name, values)
    return pack(address, command, data)


@given(ADDRESS, BYTE)
def test_set_address(address: int, group: int) -> None:
    assert ours(0, "set_address", individual=address, group_byte=group) == theirs.build_set_address(address, group)


@given(ADDRESS, st.integers(0, 0x3F))
def test_status_masks(address: int, mask: int) -> None:
    assert ours(address, "define_status", items=mask) == theirs.build_define_status(address, mask)
    assert ours(address, "read_status", items=mask) == theirs.build_read_status(address, mask)
    assert picservo.FACTS.status_bytes[mask] == theirs.servo_status_data_length(mask)


@given(ADDRESS, st.integers(0, 0xFF))
def test_status_masks_of_a_pic_io(address: int, mask: int) -> None:
    assert ours(address, "define_status", picio.FACTS, items=mask) == theirs.build_define_status(address, mask)
    assert picio.FACTS.status_bytes[mask] == theirs.io_status_data_length(mask)


@given(ADDRESS)
def test_commands_without_data(address: int) -> None:
    assert ours(address, "no_operation") == theirs.build_no_op(address)
    assert ours(address, "clear_sticky_bits") == theirs.build_clear_bits(address)
    assert ours(address, "reset_position") == theirs.build_reset_position(address)
    assert pack(0xFF, HARD_RESET) == theirs.build_hard_reset()


@pytest.mark.parametrize("baud", [19200, 57600, 115200])
def test_set_baud(baud: int) -> None:
    assert pack(0xFF, SET_BAUD, bytes([BAUD_DIVISORS[baud]])) == theirs.build_set_baud(baud)


@given(ADDRESS, st.sampled_from(["motor_off", "stop_abruptly", "stop_smoothly", ""]), st.booleans())
def test_stop_motor(address: int, manner: str, amplifier: bool) -> None:
    values = {"amplifier_enable": int(amplifier)} | ({manner: 1} if manner else {})
    mode = int(amplifier) | {"motor_off": 2, "stop_abruptly": 4, "stop_smoothly": 8, "": 0}[manner]
    assert ours(address, "stop_motor", **values) == theirs.build_stop_motor(address, mode)


@given(ADDRESS, st.sets(st.sampled_from([0, 1, 3, 6, 7])), st.sampled_from([None, 2, 4, 5]))
def test_set_homing(address: int, events: set[int], stop: int | None) -> None:
    names = {0: "on_limit1", 1: "on_limit2", 3: "on_index", 6: "on_position_error", 7: "on_current_limit"}
    stops = {2: "motor_off", 4: "stop_abruptly", 5: "stop_smoothly"}
    values = {names[event]: 1 for event in events} | ({stops[stop]: 1} if stop else {})
    mode = sum(1 << bit for bit in events) | (1 << stop if stop else 0)
    assert ours(address, "set_homing_mode", **values) == theirs.build_set_homing(address, mode)


@given(ADDRESS, WORD, WORD, WORD, WORD, BYTE, BYTE, st.integers(0, 0x3FFF), st.integers(1, 255), BYTE)
def test_set_gain(
    address: int, kp: int, kd: int, ki: int, il: int, ol: int, cl: int, el: int, sr: int, deadband: int
) -> None:
    mine = ours(
        address,
        "set_gain",
        position_gain=kp,
        velocity_gain=kd,
        integral_gain=ki,
        integration_limit=il,
        output_limit=ol,
        current_limit=cl,
        position_error_limit=el,
        servo_rate_divisor=sr,
        deadband=deadband,
    )
    assert mine == theirs.build_set_gain(address, theirs.ServoGains(kp, kd, ki, il, ol, cl, el, sr, deadband))


@given(
    ADDRESS,
    st.none() | POSITION,
    st.none() | MAGNITUDE,
    st.none() | MAGNITUDE,
    st.none() | BYTE,
    st.integers(0, 15),
)
def test_load_trajectory(
    address: int, position: int | None, velocity: int | None, acceleration: int | None, pwm: int | None, high: int
) -> None:
    flags = {"servo_mode": high & 1, "velocity_mode": high >> 1 & 1, "reverse": high >> 2 & 1, "start_now": high >> 3}
    given_values = {"position": position, "velocity": velocity, "acceleration": acceleration, "pwm": pwm}
    given_values = {name: value for name, value in given_values.items() if value is not None}
    bits = {"position": 1, "velocity": 2, "acceleration": 4, "pwm": 8}
    mode = sum(bits[name] for name in given_values) | high << 4
    mine = ours(address, "load_trajectory", **flags, **given_values)
    assert mine == theirs.build_load_trajectory(address, mode, **given_values)


@given(ADDRESS, st.integers(0, 0xFFFF))
def test_pic_io_words(address: int, word: int) -> None:
    assert ours(address, "set_output", picio.FACTS, outputs=word) == theirs.build_set_output(address, word)
    assert ours(address, "set_io_direction", picio.FACTS, inputs=word) == theirs.build_set_io_direction(address, word)


@given(st.integers(0, 0x3F), st.binary(min_size=14, max_size=14), BYTE.map(lambda status: status & ~2))
def test_status_packets_are_read_alike(mask: int, body: bytes, status: int) -> None:
    extra = body[: picservo.FACTS.status_bytes[mask]]
    frame = bytes([status]) + extra
    frame += bytes([sum(frame) & 0xFF])
    reply = unpack_reply(frame, len(extra))
    assert reply is not None
    mine = decode_status(picservo.FACTS, reply.status, mask, reply.extra).values
    other = theirs.parse_servo_status(frame, mask)
    names = {
        "position": "position",
        "ad_value": "analog",
        "velocity": "velocity",
        "auxiliary": "auxiliary",
        "home_position": "home_position",
        "type": "module_type",
        "version": "module_version",
    }
    for own, foreign in names.items():
        assert mine.get(own) == getattr(other, foreign)


def test_a_frame_captured_on_a_real_centrifuge() -> None:
    """Idle with the servo off: move_done and position_error are set, as section 5.3 says."""
    reply = unpack_reply(bytes.fromhex("11222500004f00001 8e0050000a4".replace(" ", "")), 12)
    assert reply is not None
    status = decode_status(picservo.FACTS, reply.status, 0x1F, reply.extra)
    assert status.flags == {"move_done", "position_error"}
    assert status.values["position"] == 0x2522
