"""Machine files: find, read, check. All mistakes of a file come at once, each with its key path and line."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel, ValidationError

from machines.checks import cross_checks
from machines.cy545rates import with_table_paths
from machines.errors import ConfigError, MachineError, MachineMissingError
from machines.schema import MachineConfig
from machines.toml_lines import key_lines, line_of

_TAGS = {"pic-step", "pic-servo", "cy545"}
UNKNOWN = "unknown key"
MISSING = "required key is missing"
MEANT = "did you mean "


@dataclass(frozen=True, slots=True)
class MachineFile:
    """A machine file that passed: where it came from, its text (runs keep a copy) and what it says."""

    origin: str
    text: str
    config: MachineConfig


def shipped_machines() -> tuple[str, ...]:
    """Names of the machines inside the package."""
    folder = resources.files("machines") / "data"
    return tuple(sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_machine(name_or_path: str) -> MachineConfig:
    """Machine of a shipped name or of a path. Raises as :func:`read_machine`."""
    return read_machine(name_or_path).config


def read_machine(name_or_path: str) -> MachineFile:
    """Machine file of a shipped name or of a path (anything with a separator or ending in .toml).

    Raises MachineMissingError if there is none that can be read, MachineError with every mistake of the file.
    """
    origin, text = _find(name_or_path)
    return MachineFile(origin, text, parse_machine(text, origin))


def _find(name_or_path: str) -> tuple[str, str]:
    shipped = shipped_machines()
    if name_or_path in shipped:
        file = resources.files("machines") / "data" / f"{name_or_path}.toml"
        return f"{name_or_path}.toml", file.read_text(encoding="utf-8")
    path = Path(name_or_path)
    try:
        return str(path), path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise MachineMissingError(f"{path}: not a text file in UTF-8 (byte {error.start})") from None
    except OSError as error:
        if path.name == name_or_path and path.suffix != ".toml" and not path.exists():
            near = difflib.get_close_matches(name_or_path, shipped, n=1)
            hint = (
                f"did you mean {near[0]}?"
                if near
                else f"shipped: {', '.join(shipped)}; or give the path of a .toml file"
            )
            raise MachineMissingError(f"there is no machine {name_or_path!r}; {hint}") from None
        raise MachineMissingError(f"{path}: {error.strerror or error}") from None
    except ValueError as error:  # a null character in the path
        raise MachineMissingError(f"{name_or_path!r}: {error}") from None


def parse_machine(text: str, origin: str) -> MachineConfig:
    """Machine of a TOML text; ``origin`` names it in errors. Raises MachineError."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise MachineError([_syntax_error(error, origin)]) from None
    except RecursionError:
        raise MachineError([ConfigError(origin, None, "", "nested too deeply")]) from None
    data = with_table_paths(data, origin)
    lines = key_lines(text)
    found: list[ConfigError] = []
    config: MachineConfig | None = None
    try:
        config = MachineConfig.model_validate(data)
    except ValidationError as error:
        found = _without_doubles([_schema_error(item, origin, lines) for item in error.errors(include_url=False)])
    for path, message, hint in cross_checks(data):
        found.append(ConfigError(origin, line_of(lines, path), ".".join(path), message, hint))
    if found or config is None:
        raise MachineError(sorted(found, key=lambda item: (item.line or 0, item.key)))
    return config


def _syntax_error(error: tomllib.TOMLDecodeError, origin: str) -> ConfigError:
    words = str(error)
    place = re.search(r" \(at line (\d+), column (\d+)\)", words)
    if place is None:
        return ConfigError(origin, None, "", f"not TOML: {words}")
    return ConfigError(
        origin, int(place.group(1)), "", f"not TOML: {words[: place.start()]} in column {place.group(2)}"
    )


def _schema_error(item: Mapping[str, Any], origin: str, lines: Mapping[tuple[str, ...], int]) -> ConfigError:
    """One error of pydantic in the words of the file."""
    path = tuple(str(part) for part in item["loc"] if part not in _TAGS)
    kind, hint = item["type"], ""
    message = str(item["msg"]).removeprefix("Value error, ")
    if kind == "extra_forbidden":
        message = UNKNOWN
        known = tuple(_keys_beside(path, item["loc"]))
        near = difflib.get_close_matches(path[-1], known, n=1)
        hint = f"{MEANT}{near[0]}?" if near else f"keys here: {', '.join(known)}"
    elif kind == "missing":
        message = MISSING
    elif kind.startswith("union_tag"):
        path = (*path, "chip")
        chip = (item.get("ctx") or {}).get("tag", "missing")
        message = MISSING if chip == "missing" else f"there is no chip {chip!r}"
        hint = "chips: pic-step, pic-servo" + (", cy545" if path[0] == "axis" else "")
    elif message.startswith("Input should be"):
        message = message.replace("Input should be", "should be") + f", not {_shown(item.get('input'))}"
    return ConfigError(origin, line_of(lines, path), ".".join(path), message, hint)


def _without_doubles(found: list[ConfigError]) -> list[ConfigError]:
    """A misspelled required key is one mistake: what it was meant to be is not reported as missing beside it."""
    meant = set()
    for error in found:
        if error.message == UNKNOWN and error.hint.startswith(MEANT):
            table = error.key.rpartition(".")[0]
            meant.add(f"{table}.{error.hint[len(MEANT) : -1]}".lstrip("."))
    return [error for error in found if error.message != MISSING or error.key not in meant]


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _keys_beside(path: tuple[str, ...], loc: tuple[Any, ...]) -> Iterator[str]:
    """Keys that the table around ``path`` may have."""
    model: Any = MachineConfig
    for part in loc[:-1]:
        model = _step_into(model, part)
        if model is None:
            return
    yield from getattr(model, "model_fields", {})


def _step_into(model: Any, part: Any) -> Any:
    """The model behind key ``part``: a field, the value of a dict, or the member of a union with that tag."""
    if isinstance(model, type) and issubclass(model, BaseModel):
        field = model.model_fields.get(str(part))
        return None if field is None else field.annotation
    args = get_args(model)
    if getattr(model, "__origin__", None) is dict:
        return args[1]
    for member in args:
        base = get_args(member)[0] if get_args(member) else member
        chip = getattr(base, "model_fields", {}).get("chip")
        if chip is not None and part in get_args(chip.annotation):
            return base
    models = [member for member in args if isinstance(member, type) and issubclass(member, BaseModel)]
    return _step_into(models[0], part) if models else None
