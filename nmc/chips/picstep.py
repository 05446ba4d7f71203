"""PIC-STEP (type 3, version 1): step and direction generator. Sections are those of its data sheet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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

DEVICE_TYPE = 3
VERSION = 1

# Section 4.1, the step timer: a 16 bit up-counter; its roll-over makes one pulse and reloads the count
TIMER_MODULUS = 65_536
COUNT_MIN = 1
COUNT_MAX = 65_452
RELOAD_NS = 3_200  # {2, 4, 8, 16} counts at the four clocks: the same 3.2 us in every mode
STEP_PULSE_NS = 4_800  # section 2.3, pin 12
STEP_RATE_MAX_HZ = 50_000  # section 1

# Section 4.2, profiles
SPEED_MIN = 1
SPEED_MAX = 250
ACCELERATION_MIN = 1
ACCELERATION_MAX = 255
ACCELERATION_UNIT_NS = 250_000

# Section 4.6
HOLDING_DELAY_NS = 250_000_000
CURRENT_PWM_HZ = 40_000


@dataclass(frozen=True, slots=True)
class SpeedMode:
    """One of the four clocks of the step timer (sections 4.1 and 4.2, tables 2 and 3).

    bits: value of bits 1,0 of Set Parameters' mode byte. tick_ns: one timer count. extra_counts: what the sheet's
    count formula adds. rate_step_hz: step rate of profile speed 1.
    """

    name: str
    bits: int
    clock_hz: int
    tick_ns: int
    extra_counts: int
    rate_step_hz: int

    def period_ns(self, count: int) -> int:
        """Step period of an initial timer count: (65536 - count + extra) / clock."""
        return (TIMER_MODULUS - count) * self.tick_ns + RELOAD_NS

    def profile_count(self, speed: int) -> int:
        """Timer count nearest to an integer profile speed 1..250."""
        return TIMER_MODULUS + self.extra_counts - round(self.clock_hz / (self.rate_step_hz * speed))

    @property
    def rate_min_hz(self) -> float:
        """Lowest unprofiled step rate (count 1)."""
        return 1e9 / self.period_ns(COUNT_MIN)

    @property
    def rate_max_hz(self) -> float:
        """Highest unprofiled step rate (count 65452)."""
        return 1e9 / self.period_ns(COUNT_MAX)


SPEED_MODES: Mapping[str, SpeedMode] = MappingProxyType(
    {
        "1x": SpeedMode("1x", 0b11, 625_000, 1_600, 2, 25),
        "2x": SpeedMode("2x", 0b10, 1_250_000, 800, 4, 50),
        "4x": SpeedMode("4x", 0b01, 2_500_000, 400, 8, 100),
        "8x": SpeedMode("8x", 0b00, 5_000_000, 200, 16, 200),
    }
)

# Status byte, section 5.2
STATUS_MOVING = 0x01
STATUS_COMM_ERROR = 0x02
STATUS_AMP_ENABLED = 0x04
STATUS_POWER = 0x08
STATUS_AT_SPEED = 0x10
STATUS_VELOCITY_MODE = 0x20
STATUS_TRAPEZOID_MODE = 0x40
STATUS_HOMING = 0x80
STATUS_BITS = (
    "moving",
    "communications_error",
    "amplifier_enabled",
    "power_sense",
    "at_commanded_speed",
    "velocity_profile_mode",
    "trapezoidal_profile_mode",
    "homing_in_progress",
)

# Inputs byte, section 5.2 (bits 6 and 7 are undefined and must be masked)
INPUT_ESTOP = 0x01
INPUT_IN1 = 0x02
INPUT_IN2 = 0x04
INPUT_LIMIT1 = 0x08
INPUT_LIMIT2 = 0x10
INPUT_HOME = 0x20
INPUTS_DEFINED = 0x3F
INPUT_BITS = ("estop", "in1", "in2", "limit1", "limit2", "home_switch")

# Status items, section 5.1 "Define Status"
ITEM_POSITION = 0x01
ITEM_AD = 0x02
ITEM_TIMER_COUNT = 0x04
ITEM_INPUTS = 0x08
ITEM_HOME = 0x10
ITEM_TYPE_VERSION = 0x20
STATUS_ITEMS = (
    StatusItem("position", 0, 4, signed=True),
    StatusItem("ad_value", 1, 1),
    StatusItem("timer_count", 2, 2),
    StatusItem("inputs", 3, 1),
    StatusItem("home_position", 4, 4, signed=True),
    StatusItem("type_version", 5, 2),
)

# Load Trajectory control byte, section 5.1
LOAD_POSITION = 0x01
LOAD_SPEED = 0x02
LOAD_ACCELERATION = 0x04
LOAD_COUNT = 0x08
LOAD_REVERSE = 0x10
LOAD_START_NOW = 0x80

# Stop Motor control byte
STOP_AMP_ENABLE = 0x01
STOP_ABRUPTLY = 0x04
STOP_SMOOTHLY = 0x08

COMMANDS: Mapping[int, CommandFact] = MappingProxyType(
    {
        fact.code: fact
        for fact in (
            *ADDRESSING_COMMANDS,
            CommandFact("reset_position", 0x0, (0,), "5.1 Reset Position", while_moving="no"),
            CommandFact(
                "load_trajectory",
                LOAD_TRAJECTORY,
                tuple(range(1, 11)),
                "5.1 Load Trajectory",
                control=(
                    Bits("position_loaded", 0),
                    Bits("speed_loaded", 1),
                    Bits("acceleration_loaded", 2),
                    Bits("timer_count_loaded", 3),
                    Bits("reverse", 4),
                    Bits("start_now", 7),
                ),
                fields=(
                    Field("position", 4, -POSITION_MAX, POSITION_MAX, signed=True, when="position_loaded"),
                    Field("speed", 1, SPEED_MIN, SPEED_MAX, when="speed_loaded"),
                    Field("acceleration_time", 1, ACCELERATION_MIN, ACCELERATION_MAX, when="acceleration_loaded"),
                    Field("timer_count", 2, COUNT_MIN, COUNT_MAX, when="timer_count_loaded"),
                    Field("nearest_speed", 1, SPEED_MIN, SPEED_MAX, when="timer_count_loaded"),
                ),
                repeatable=True,  # without start_now only: the bus looks at bit 7
                while_moving="depends",
            ),
            CommandFact("start_motion", START_MOTION, (0,), "5.1 Start Motion", while_moving="depends"),
            CommandFact(
                "set_parameters",
                0x6,
                (5,),
                "5.1 Set Parameters",
                control=(
                    Bits("speed_mode", 0, 2),
                    Bits("disable_limit_stop", 2),
                    Bits("disable_estop", 3),
                    Bits("motor_off_on_stop", 4),
                ),
                fields=(
                    Field("minimum_speed", 1, SPEED_MIN, SPEED_MAX),
                    Field("running_current", 1, 0, 255),
                    Field("holding_current", 1, 0, 255),
                    Field("thermal_limit", 1, 0, 255),
                ),
                repeatable=True,
            ),
            CommandFact(
                "stop_motor",
                STOP_MOTOR,
                (1,),
                "5.1 Stop Motor",
                control=(Bits("amplifier_enable", 0), Bits("stop_abruptly", 2), Bits("stop_smoothly", 3)),
                repeatable=True,
            ),
            CommandFact("set_outputs", 0x8, (1,), "5.1 Set Outputs", control=(Bits("outputs", 0, 5),), repeatable=True),
            CommandFact(
                "set_homing_mode",
                0x9,
                (1,),
                "5.1 Set Homing Mode",
                control=(
                    Bits("on_limit1", 0),
                    Bits("on_limit2", 1),
                    Bits("motor_off", 2),
                    Bits("on_home_switch", 3),
                    Bits("stop_abruptly", 4),
                    Bits("stop_smoothly", 5),
                ),
            ),
            CommandFact("save_current_position_as_home", SAVE_HOME, (0,), "5.1 Save Current Position as Home"),
        )
    }
)

FACTS = ChipFacts(
    name="pic-step",
    device_type=DEVICE_TYPE,
    version=VERSION,
    commands=COMMANDS,
    status_items=STATUS_ITEMS,
    status_bits=STATUS_BITS,
    byte_items=MappingProxyType({"inputs": INPUT_BITS}),
    status_bytes=status_bytes_table(STATUS_ITEMS),
)
