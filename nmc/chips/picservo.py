"""PIC-SERVO version 4 with PIC-ENC (type 0): servo controller. Sections are those of its data sheet."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from nmc.chips.common import (
    ADDRESSING_COMMANDS,
    LOAD_TRAJECTORY,
    POSITION_MAX,
    SAVE_HOME,
    START_MOTION,
    STOP_MOTOR,
    Bits,
    ChipFacts,
    CommandFact,
    Field,
    StatusItem,
    status_bytes_table,
)
from nmc.chips.common import SERVO_TICK_NS as TICK_NS

DEVICE_TYPE = 0
VERSION = 4

# Section 3: 1953.125 Hz at 20 MHz; the tick is 512 us
SERVO_RATE_HZ = 1e9 / TICK_NS
PWM_HZ = 19_531.25
COMMAND_RATE_MAX_HZ = 1_000
ENCODER_EDGE_MIN_NS = 2_000  # section 3.2: 500 kHz
ENC_SELECT_NS = 2_800
ENC_RESET_NS = 2_800
COUNTS_PER_LINE = 4  # section 4.2
ENCODER_MODULUS = 65_536

# Section 4.4: velocity and acceleration carry 16 fractional bits, per servo tick
FRACTION_BITS = 16
FRACTION = 1 << FRACTION_BITS
VELOCITY_MAX = 0x7FFF_FFFF
ACCELERATION_MAX = 0x7FFF_FFFF
PWM_MAX = 0xFF

# Section 5.2 "Set Gain"
GAIN_MAX = 0x7FFF
POSITION_ERROR_LIMIT_MAX = 0x3FFF
INTEGRATION_LIMIT_SCALE = 256
INTEGRAL_DIVISOR = 256  # section 4.3: integral_error is the running sum / 256
OUTPUT_DIVISOR = 256  # section 4.3: PWM = output / 256
SERVO_RATE_DIVISOR_MAX = 0xFF

# Status byte, section 5.3
STATUS_MOVE_DONE = 0x01
STATUS_CHECKSUM_ERROR = 0x02
STATUS_OVERCURRENT = 0x04
STATUS_POWER_ON = 0x08
STATUS_POSITION_ERROR = 0x10
STATUS_LIMIT1 = 0x20
STATUS_LIMIT2 = 0x40
STATUS_HOMING = 0x80
STATUS_BITS = (
    "move_done",
    "checksum_error",
    "overcurrent",
    "power_on",
    "position_error",
    "limit1",
    "limit2",
    "home_in_progress",
)

# Auxiliary status byte, section 5.3
AUX_INDEX = 0x01  # complement of the INDEX input
AUX_POSITION_WRAP = 0x02
AUX_SERVO_ON = 0x04
AUX_ACCEL_DONE = 0x08
AUX_SLEW_DONE = 0x10
AUX_SERVO_OVERRUN = 0x20
AUX_BITS = ("index", "position_wrap", "servo_on", "accel_done", "slew_done", "servo_overrun")

# Status items, section 5.2 "Define Status"
ITEM_POSITION = 0x01
ITEM_AD = 0x02
ITEM_VELOCITY = 0x04
ITEM_AUX = 0x08
ITEM_HOME = 0x10
ITEM_TYPE_VERSION = 0x20
STATUS_ITEMS = (
    StatusItem("position", 0, 4, signed=True),
    StatusItem("ad_value", 1, 1),
    StatusItem("velocity", 2, 2, signed=True),  # the *negative* of the velocity, counts per tick
    StatusItem("auxiliary", 3, 1),
    StatusItem("home_position", 4, 4, signed=True),
    StatusItem("type_version", 5, 2),
)

# Load Trajectory control byte, section 5.2
LOAD_POSITION = 0x01
LOAD_VELOCITY = 0x02
LOAD_ACCELERATION = 0x04
LOAD_PWM = 0x08
LOAD_SERVO_MODE = 0x10
LOAD_VELOCITY_MODE = 0x20
LOAD_REVERSE = 0x40
LOAD_START_NOW = 0x80

# Stop Motor control byte, section 5.2
STOP_AMP_ENABLE = 0x01
STOP_MOTOR_OFF = 0x02
STOP_ABRUPTLY = 0x04
STOP_SMOOTHLY = 0x08
STOP_HERE = 0x10

COMMANDS: Mapping[int, CommandFact] = MappingProxyType(
    {
        fact.code: fact
        for fact in (
            *ADDRESSING_COMMANDS,
            CommandFact("reset_position", 0x0, (0,), "5.2 Reset Position", while_moving="no"),
            CommandFact(
                "load_trajectory",
                LOAD_TRAJECTORY,
                tuple(range(1, 15)),
                "5.2 Load Trajectory",
                control=(
                    Bits("position_loaded", 0),
                    Bits("velocity_loaded", 1),
                    Bits("acceleration_loaded", 2),
                    Bits("pwm_loaded", 3),
                    Bits("servo_mode", 4),
                    Bits("velocity_mode", 5),
                    Bits("reverse", 6),
                    Bits("start_now", 7),
                ),
                fields=(
                    Field("position", 4, -POSITION_MAX, POSITION_MAX, signed=True, when="position_loaded"),
                    Field("velocity", 4, 0, VELOCITY_MAX, when="velocity_loaded"),
                    Field("acceleration", 4, 0, ACCELERATION_MAX, when="acceleration_loaded"),
                    Field("pwm", 1, 0, PWM_MAX, when="pwm_loaded"),
                ),
                repeatable=True,  # without start_now only: the bus looks at bit 7
                while_moving="depends",
            ),
            CommandFact("start_motion", START_MOTION, (0,), "5.2 Start Motion", while_moving="depends"),
            CommandFact(
                "set_gain",
                0x6,
                (13, 14),
                "5.2 Set Gain",
                fields=(
                    Field("position_gain", 2, 0, GAIN_MAX),
                    Field("velocity_gain", 2, 0, GAIN_MAX),
                    Field("integral_gain", 2, 0, GAIN_MAX),
                    Field("integration_limit", 2, 0, GAIN_MAX),
                    Field("output_limit", 1, 0, 0xFF),
                    Field("current_limit", 1, 0, 0xFF),
                    Field("position_error_limit", 2, 0, POSITION_ERROR_LIMIT_MAX),
                    Field("servo_rate_divisor", 1, 1, SERVO_RATE_DIVISOR_MAX),
                    Field("deadband", 1, 0, 0xFF),
                ),
                repeatable=True,
            ),
            CommandFact(
                "stop_motor",
                STOP_MOTOR,
                (1, 5),
                "5.2 Stop Motor",
                control=(
                    Bits("amplifier_enable", 0),
                    Bits("motor_off", 1),
                    Bits("stop_abruptly", 2),
                    Bits("stop_smoothly", 3),
                    Bits("stop_here", 4),
                ),
                fields=(Field("stopping_position", 4, -POSITION_MAX, POSITION_MAX, signed=True, when="stop_here"),),
                repeatable=True,
            ),
            CommandFact(
                "io_control",
                0x8,
                (1,),
                "5.2 I/O Control",
                control=(
                    Bits("limit1_output", 0),
                    Bits("limit2_output", 1),
                    Bits("limit1_is_input", 2),
                    Bits("limit2_is_input", 3),
                ),
                repeatable=True,
            ),
            CommandFact(
                "set_homing_mode",
                0x9,
                (1,),
                "5.2 Set Homing Mode",
                control=(
                    Bits("on_limit1", 0),
                    Bits("on_limit2", 1),
                    Bits("motor_off", 2),
                    Bits("on_index", 3),
                    Bits("stop_abruptly", 4),
                    Bits("stop_smoothly", 5),
                    Bits("on_position_error", 6),
                    Bits("on_current_limit", 7),
                ),
            ),
            CommandFact("clear_sticky_bits", 0xB, (0,), "5.2 Clear Sticky Bits"),
            CommandFact("save_current_position_as_home", SAVE_HOME, (0,), "5.2 Save Current Position as Home"),
        )
    }
)

FACTS = ChipFacts(
    name="pic-servo",
    device_type=DEVICE_TYPE,
    version=VERSION,
    commands=COMMANDS,
    status_items=STATUS_ITEMS,
    status_bits=STATUS_BITS,
    byte_items=MappingProxyType({"auxiliary": AUX_BITS}),
    status_bytes=status_bytes_table(STATUS_ITEMS),
    command_interval_ns=1_000_000_000 // COMMAND_RATE_MAX_HZ,
)
