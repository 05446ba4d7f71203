"""Rules of a machine file about spindle, coolant and outputs that span several tables, on the raw TOML values.

Every mistake comes with its key path, message and hint, beside those of ``checks.py``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from machines.arith import evaluate

Found = tuple[tuple[str, ...], str, str]

SWITCH_PINS = {
    "pic-step": ("out1", "out2", "out3", "out4", "out5"),
    "pic-servo": ("limit1", "limit2"),
    "pic-io": tuple(f"bit{number}" for number in range(12)),
}
VALUE_PINS = {"pic-step": (), "pic-servo": ("pwm",), "pic-io": ("pwm1", "pwm2")}
SPINDLE = "spindle"
_ENCODER_COUNTS_S = 500_000  # PIC-SERVO data sheet, section 3.2
_NEEDED = {
    "velocity": ("bus", "address", "counts_per_rev", "servo"),
    "pwm": ("bus", "address"),
    "output": ("on",),
}
_ALLOWED = {
    "velocity": ("bus", "address", "counts_per_rev", "servo", "clockwise"),
    "pwm": ("bus", "address", "counts_per_rev", "clockwise", "pwm_at_min", "pwm_at_max"),
    "output": ("on", "reverse", "speed", "pwm_at_min", "pwm_at_max"),
}
_COMMON = ("drive", "max_rpm", "min_rpm", "ramp_time", "settle_time", "at_speed")
LEAST_SETTLE_S = 0.1
"""The speed is read twice after the ramp, so long apart that a tick or a late answer does not count."""


def output_checks(data: Mapping[str, Any]) -> Iterator[Found]:
    """Every mistake in the tables of spindle, coolant and outputs that no single key shows."""
    spindle = data.get(SPINDLE)
    if isinstance(spindle, dict):
        yield from _spindle(spindle)
    for name in (SPINDLE,):
        for section in ("axis", "motor", "module"):
            if name in _table(data, section):
                yield (section, name), f"{name} is the name of the spindle's own module", "name it otherwise"
    for section in ("output", "analog"):
        for key in _table(data, section):
            if not key.isdigit() or str(int(key)) != key:
                letter = "P" if section == "output" else "E"
                yield (
                    (section, key),
                    f"an output has a number, as in [{section}.0]",
                    f"it is the {letter} of the program",
                )
    yield from _pins(data)


def members(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any]]]:
    """The spindle's module, if it has one on a bus."""
    spindle = data.get(SPINDLE)
    if isinstance(spindle, dict) and spindle.get("drive") in ("velocity", "pwm"):
        yield (SPINDLE,), spindle


def _spindle(table: Mapping[str, Any]) -> Iterator[Found]:
    drive = table.get("drive")
    if drive not in _NEEDED:
        return
    for key in _NEEDED[drive]:
        if key not in table:
            yield (SPINDLE, key), "required key is missing", f'drive = "{drive}" needs {", ".join(_NEEDED[drive])}'
    for key in table:
        if key not in _COMMON and key not in _ALLOWED[drive] and any(key in keys for keys in _ALLOWED.values()):
            yield (SPINDLE, key), f'drive = "{drive}" has no such key', f"its keys: {', '.join(_ALLOWED[drive])}"
    most, least = _number(table.get("max_rpm")), _number(table.get("min_rpm", 0.0))
    if most is not None and least is not None and least >= most:
        yield (SPINDLE, "min_rpm"), f"{least:g} is not below max_rpm {most:g}", ""
    counts = _number(table.get("counts_per_rev"))
    if counts is not None and most is not None and counts * most / 60 > _ENCODER_COUNTS_S:
        message = f"{most:g} rpm at {counts:g} counts a turn are {counts * most / 60:,.0f} counts/s"
        yield (SPINDLE, "counts_per_rev"), message, f"a PIC-SERVO counts at most {_ENCODER_COUNTS_S:,} a second"
    settle = _number(table.get("settle_time", 0.2))
    if counts is not None and settle is not None and settle < LEAST_SETTLE_S:
        yield (SPINDLE, "settle_time"), f"at least {LEAST_SETTLE_S:g} s are needed to read the speed", ""
    low, high = _number(table.get("pwm_at_min", 0)), _number(table.get("pwm_at_max", 255))
    if low is not None and high is not None and low >= high:
        yield (SPINDLE, "pwm_at_min"), f"{low:g} is not below pwm_at_max {high:g}", ""


def _pins(data: Mapping[str, Any]) -> Iterator[Found]:
    """Every pin is there, is of the right kind, and has one use only."""
    taken: dict[tuple[str, str], str] = {}
    for path, table, kinds in _named_pins(data):
        module, pin = table.get("module"), table.get("pin")
        if not isinstance(module, str) or not isinstance(pin, str):
            continue
        chip = _chip(data, module)
        if chip is None:
            yield (*path, "module"), f"there is no module {module}", f"modules: {', '.join(_modules(data)) or 'none'}"
            continue
        known = kinds.get(chip, ())
        if kinds is VALUE_PINS and chip == "pic-servo" and module not in _table(data, "module"):
            known = ()  # the PWM of an axis or of the spindle is its motor's
        if pin not in known:
            words = f"{module} ({chip}) has no pin {pin} for this"
            yield (*path, "pin"), words, f"it has {', '.join(known)}" if known else "take another module"
        elif (module, pin) in taken:
            yield (*path, "pin"), f"{pin} of {module} is already {taken[module, pin]}", ""
        else:
            taken[module, pin] = ".".join(path)
    buses = {_bus(data, module) for (module, _), use in taken.items() if use.startswith(f"{SPINDLE}.")}
    if len(buses) > 1:
        yield (SPINDLE, "on", "module"), "the spindle's pins hang on several buses", "one bus has to say them in order"
    for (module, pin), use in taken.items():
        if pin in ("limit1", "limit2") and _homes_on(data, module, pin):
            yield ("axis", module, "home", "switch"), f"{pin} of {module} is the output {use}", ""


def _named_pins(data: Mapping[str, Any]) -> Iterator[tuple[tuple[str, ...], Mapping[str, Any], Mapping[str, Any]]]:
    places: list[tuple[tuple[str, ...], Any, Mapping[str, Any]]] = []
    for key, kinds in (("on", SWITCH_PINS), ("reverse", SWITCH_PINS), ("speed", VALUE_PINS)):
        places.append(((SPINDLE, key), _table(data, SPINDLE).get(key), kinds))
    places += [(("coolant", key), _table(data, "coolant").get(key), SWITCH_PINS) for key in ("flood", "mist")]
    places += [(("output", key), table, SWITCH_PINS) for key, table in _table(data, "output").items()]
    places += [(("analog", key), table, VALUE_PINS) for key, table in _table(data, "analog").items()]
    yield from ((path, table, kinds) for path, table, kinds in places if isinstance(table, dict))


def _modules(data: Mapping[str, Any]) -> list[str]:
    found = [name for section in ("axis", "motor", "module") for name in _table(data, section)]
    return found + ([SPINDLE] if any(members(data)) else [])


def _chip(data: Mapping[str, Any], module: str) -> str | None:
    if module == SPINDLE and any(members(data)):
        return "pic-servo"
    for section in ("axis", "motor", "module"):
        table = _table(data, section).get(module)
        if isinstance(table, dict) and isinstance(table.get("chip"), str):
            return str(table["chip"])
    return None


def _bus(data: Mapping[str, Any], module: str) -> object:
    for section in ("axis", "motor", "module"):
        table = _table(data, section).get(module)
        if isinstance(table, dict):
            return table.get("bus")
    return None


def _homes_on(data: Mapping[str, Any], axis: str, pin: str) -> bool:
    home = _table(_table(data, "axis"), axis).get("home")
    return isinstance(home, dict) and home.get("switch") == pin


def _table(data: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = data.get(name, {})
    return table if isinstance(table, dict) else {}


def _number(value: Any) -> float | None:
    if isinstance(value, str):
        try:
            return evaluate(value)
        except ValueError:
            return None
    return float(value) if type(value) in (int, float) else None
