"""Rules of a machine file that span several tables, on the raw TOML values.

They run beside the checks of single keys, not after them, so that a file's mistakes all come out at once. Values of
the wrong type are skipped here: the schema reports them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from machines.arith import evaluate
from machines.cy545rates import STAND_IN, read_rates
from machines.outputs_rules import members as spindle_members
from machines.outputs_rules import output_checks
from machines.usercommands import user_command_checks
from nmc.chips.picstep import SPEED_MODES, STEP_RATE_MAX_HZ

Found = tuple[tuple[str, ...], str, str]
"""Key path, message, hint."""

AXIS_NAMES = "XYZABCUVW"


def cross_checks(data: Mapping[str, Any]) -> Iterator[Found]:
    """Every mistake that no single table shows."""
    yield from _axis_names(data)
    yield from _buses(data)
    yield from _addresses(data)
    yield from _rates(data)
    yield from _references(data)
    yield from _home_switches(data)
    yield from _lines(data)
    yield from output_checks(data)
    yield from user_command_checks(data)


def _table(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = data.get(name, {})
    return table if isinstance(table, dict) else {}


def _members(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """All that hangs on a bus: axes, further motors, other modules, the spindle's."""
    for section in ("axis", "motor", "module"):
        for name, table in _table(data, section).items():
            if isinstance(table, dict):
                yield (section, name), table
    yield from spindle_members(data)


def _axis_names(data: Mapping[str, Any]) -> Iterator[Found]:
    for name in _table(data, "axis"):
        if len(name) != 1 or name not in AXIS_NAMES:
            hint = f"did you mean [axis.{name.upper()}]?" if name.upper() in AXIS_NAMES and len(name) == 1 else ""
            yield ("axis", name), f"an axis is one of the letters {' '.join(AXIS_NAMES)}", hint


def _buses(data: Mapping[str, Any]) -> Iterator[Found]:
    buses = _table(data, "bus")
    for path, table in _members(data):
        bus = table.get("bus")
        if isinstance(bus, str) and bus not in buses:
            known = ", ".join(buses) or "none"
            yield (*path, "bus"), f"there is no [bus.{bus}]", f"buses of this file: {known}"


def _addresses(data: Mapping[str, Any]) -> Iterator[Found]:
    """Addresses of a bus must be 1..n: they are given along the chain at start-up, without gaps."""
    taken: dict[str, dict[int, str]] = {}
    for path, table in _members(data):
        bus, address = table.get("bus"), _integer(table.get("address"))
        if not isinstance(bus, str) or address is None:
            continue
        here = taken.setdefault(bus, {})
        if address in here:
            message = f"address {address} of bus {bus} is already that of {here[address]}"
            yield (*path, "address"), message, "every module of a bus has its own address"
        else:
            here[address] = ".".join(path)
    for bus, here in taken.items():
        missing = sorted(set(range(1, max(here) + 1)) - set(here))
        if missing and max(here) <= 127:
            gap = ", ".join(map(str, missing))
            message = f"no module of bus {bus} has address {gap}"
            yield (
                (*here[max(here)].split("."), "address"),
                message,
                "addresses follow the chain: 1, 2, 3 ... without gaps",
            )


def _rates(data: Mapping[str, Any]) -> Iterator[Found]:
    """The step rate at an axis's greatest velocity is one that the chip, and the speed mode named for it, can give.

    A mode's greatest rate is that of timer count 65452 (data sheet section 4.1). An axis led faster than that would
    fall behind its plan and end short by the steps that it has missed.
    """
    axes = _table(data, "axis")
    for path, table in _members(data):
        axis = table if path[0] == "axis" else axes.get(str(table.get("axis")))
        if table.get("chip") != "pic-step" or not isinstance(axis, dict):
            continue
        velocity, scale = _number(axis.get("max_velocity")), _number(table.get("steps_per_unit"))
        if velocity is None or scale is None:
            continue
        rate_hz = abs(velocity * scale)
        message = f"{velocity:g} a second at {scale:g} steps each are {rate_hz:,.0f} steps/s"
        if rate_hz > STEP_RATE_MAX_HZ:
            key = "max_velocity" if path[0] == "axis" else "steps_per_unit"
            yield (*path, key), message, f"a PIC-STEP gives at most {STEP_RATE_MAX_HZ:,} steps/s"
            continue
        step = table.get("step")
        mode = step.get("speed_mode") if isinstance(step, dict) else None
        if isinstance(mode, str) and mode in SPEED_MODES and rate_hz > SPEED_MODES[mode].rate_max_hz:
            message = f"speed mode {mode} gives at most {SPEED_MODES[mode].rate_max_hz:,.0f} steps/s, but {message}"
            reach = next(name for name, each in SPEED_MODES.items() if rate_hz <= each.rate_max_hz)
            slower = _rounded_down(SPEED_MODES[mode].rate_max_hz / abs(scale))
            whose = "max_velocity" if path[0] == "axis" else f"max_velocity of [axis.{table.get('axis')}]"
            yield (*path, "step", "speed_mode"), message, f'write "{reach}" or "auto", or {whose} at most {slower:g}'


def _rounded_down(value: float) -> float:
    """Three digits of a number, not more than it."""
    digits = 2 - math.floor(math.log10(value))
    return math.floor(value * 10.0**digits) / 10.0**digits


def _references(data: Mapping[str, Any]) -> Iterator[Found]:
    axes, motors = _table(data, "axis"), _table(data, "motor")
    for name, table in motors.items():
        axis = table.get("axis") if isinstance(table, dict) else None
        if isinstance(axis, str) and axis not in axes:
            yield (
                ("motor", name, "axis"),
                f"there is no [axis.{axis}]",
                f"axes of this file: {', '.join(axes) or 'none'}",
            )
        if name in axes:
            yield ("motor", name), f"[axis.{name}] is already a motor of that name", "name it e.g. Y2"
    for name in _table(_table(data, "sim"), "axis"):
        if name not in axes and name not in motors:
            yield ("sim", "axis", name), f"there is no axis or motor {name}", ""


_SWITCHES = {"pic-step": ("limit1", "limit2", "home"), "pic-servo": ("limit1", "limit2", "index"), "cy545": ("home",)}


def _home_switches(data: Mapping[str, Any]) -> Iterator[Found]:
    """Not every chip has every switch input; and homing ends at zero, so zero must lie in the travel."""
    for name, table in _table(data, "axis").items():
        home = table.get("home") if isinstance(table, dict) else None
        if not isinstance(home, dict):
            continue
        chip, switch = table.get("chip"), home.get("switch", "home")
        known = _SWITCHES.get(chip, ()) if isinstance(chip, str) else ()
        if known and isinstance(switch, str) and switch not in known:
            yield ("axis", name, "home", "switch"), f"a {chip} has no {switch} input", f"it has {', '.join(known)}"
        travel = table.get("travel")
        ends = [_number(end) for end in travel] if isinstance(travel, list) and len(travel) == 2 else [None]
        if None not in ends and not ends[0] <= 0 <= ends[1]:  # type: ignore[operator]  # None is ruled out
            yield ("axis", name, "travel"), "must contain 0 where homing ends", "choose home.position accordingly"
    for name, table in _table(_table(data, "sim"), "axis").items():
        axis = _table(data, "axis").get(name)
        if (
            isinstance(table, dict)
            and "home_at" in table
            and isinstance(axis, dict)
            and axis.get("chip") == "pic-servo"
        ):
            yield ("sim", "axis", name, "home_at"), "a pic-servo has no home input", "use limit1_at or limit2_at"


def _lines(data: Mapping[str, Any]) -> Iterator[Found]:
    """A CY545 has a line for itself, and a rate table that can be read."""
    members = list(_members(data))
    for path, table in members:
        if table.get("chip") != "cy545":
            continue
        others = [".".join(other) for other, each in members if other != path and each.get("bus") == table.get("bus")]
        if others:
            message = f"bus {table.get('bus')} also has {', '.join(others)}"
            yield (*path, "bus"), message, "a CY545 needs a serial line of its own: give it another [bus.NAME]"
        name = table.get("rate_table", STAND_IN)
        if isinstance(name, str) and name:
            try:
                read_rates(name)
            except ValueError as error:
                hint = "columns rate,steps_per_s_12mhz, one row for each of the rates 0..255"
                yield (*path, "rate_table"), str(error), hint
        home = table.get("home")
        missing = [key for key in ("abort_line", "home_line") if table.get(key, "none") == "none"]
        if isinstance(home, dict) and missing:
            message = f"homing a CY545 needs {' and '.join(missing)}"
            yield (*path, "home"), message, "outputs of the port: rts, dtr; inputs: cts, dsr, cd, ri"


def _number(value: Any) -> float | None:
    if isinstance(value, str):
        try:
            return evaluate(value)
        except ValueError:
            return None
    return float(value) if type(value) in (int, float) else None


def _integer(value: Any) -> int | None:
    found = _number(value)
    return int(found) if found is not None and found == round(found) and 1 <= found <= 255 else None
