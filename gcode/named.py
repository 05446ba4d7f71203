"""The predefined named parameters of LinuxCNC: windows on the state, read-only."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from gcode.errors import GcodeError
from gcode.machine import Machine
from gcode.offsets import SYSTEMS
from gcode.state import AXIS_INDEX, State

if TYPE_CHECKING:
    from configparser import ConfigParser

Window = Callable[[], float]


def install(machine: Machine, line: Window, call_level: Window) -> None:
    """Puts all windows of ``machine`` into its parameters."""
    parameters, state = machine.parameters, machine.state
    windows = parameters.windows
    for name, read in MODES.items():
        windows[name] = _bound(state, read)
    for letter, axis in AXIS_INDEX.items():
        windows[f"_{letter}"] = _position(state, axis)
        windows[f"_abs_{letter}"] = _absolute(state, axis)
    windows["_line"] = line
    windows["_call_level"] = call_level
    windows["_remap_level"] = windows["_task"] = lambda: 0.0
    windows["_value"] = lambda: parameters.returned or 0.0
    windows["_value_returned"] = lambda: float(parameters.returned is not None)
    windows["_current_tool"] = lambda: parameters.values.get(5400, 0.0)
    windows["_selected_tool"] = lambda: float(state.selected_tool if state.selected_tool is not None else 0)
    windows["_current_pocket"] = lambda: _pocket(machine, state.tool_in_spindle)
    windows["_selected_pocket"] = lambda: _pocket(machine, state.selected_tool)
    windows["_metric_machine"] = lambda: float(state.machine_unit_mm == 1.0)
    windows["_vmajor"] = lambda: 2.9
    windows["_vminor"] = lambda: 0.0


def _bound(state: State, read: Callable[[State], float]) -> Window:
    return lambda: float(read(state))


def _position(state: State, axis: int) -> Window:
    return lambda: state.position[axis]


def _absolute(state: State, axis: int) -> Window:
    return lambda: state.absolute()[axis]


def _pocket(machine: Machine, number: int | None) -> float:
    if not number or machine.tools is None or number not in machine.tools:
        return -1.0
    return float(machine.tools[number].pocket) or -1.0


MODES: dict[str, Callable[[State], float]] = {
    "_motion_mode": lambda s: s.motion,
    "_plane": lambda s: s.plane,
    "_ccomp": lambda s: 400 if s.compensation == 400 else 410 if s.compensation in {410, 411} else 420,
    "_metric": lambda s: s.unit_mm == 1.0,
    "_imperial": lambda s: s.unit_mm != 1.0,
    "_absolute": lambda s: not s.incremental,
    "_incremental": lambda s: s.incremental,
    "_inverse_time": lambda s: s.feed_mode == 930,
    "_units_per_minute": lambda s: s.feed_mode == 940,
    "_units_per_rev": lambda s: s.feed_mode == 950,
    "_coord_system": lambda s: SYSTEMS[s.system - 1],
    "_tool_offset": lambda s: any(s.tool_offset),
    "_retract_r_plane": lambda s: s.retract == 990,
    "_retract_old_z": lambda s: s.retract == 980,
    "_spindle_rpm_mode": lambda s: s.spindle_mode == 970,
    "_spindle_css_mode": lambda s: s.spindle_mode == 960,
    "_ijk_absolute_mode": lambda s: s.ijk_absolute,
    "_lathe_diameter_mode": lambda s: s.lathe_diameter,
    "_lathe_radius_mode": lambda s: not s.lathe_diameter,
    "_spindle_on": lambda s: s.spindle_direction != 0,
    "_spindle_cw": lambda s: s.spindle_direction > 0,
    "_mist": lambda s: s.mist,
    "_flood": lambda s: s.flood,
    "_speed_override": lambda s: s.speed_override,
    "_feed_override": lambda s: s.feed_override,
    "_adaptive_feed": lambda s: s.adaptive_feed,
    "_feed_hold": lambda s: s.feed_hold,
    "_feed": lambda s: s.feed,
    "_rpm": lambda s: abs(s.spindle_rpm),
}


def ini_value(ini: ConfigParser | None, name: str) -> float:
    """``#<_ini[section]name>``, and the refusal of ``#<_hal[...]>``. Raises GC032 and GC039."""
    if name.startswith("_hal["):
        raise GcodeError(
            "GC039",
            f"#<{name}> reads a HAL pin, which this machine does not have",
            "replace it by a number or parameter",
        )
    section, _, key = name[len("_ini[") :].partition("]")
    if ini is None:
        raise GcodeError("GC032", f"#<{name}> needs an ini file", "give one with --ini")
    for known in ini.sections():
        if known.lower() == section:
            text = ini.get(known, key, fallback=None)
            if text is None:
                break
            try:
                return float(text)
            except ValueError:
                raise GcodeError("GC032", f"[{known}]{key.upper()} is not a number: {text}", "name a number") from None
    raise GcodeError("GC032", f"[{section.upper()}]{key.upper()} is not in the ini file", "check section and name")
