"""The ini file of LinuxCNC as far as the interpreter reads it: parameter file, subroutine path, values."""

from __future__ import annotations

from configparser import ConfigParser
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Ini:
    """``values``: all sections. ``parameter_file`` and ``subroutine_path`` are made absolute by the ini's folder."""

    values: ConfigParser
    parameter_file: Path | None
    subroutine_path: tuple[str, ...]


def parse_ini(text: str) -> ConfigParser:
    """Sections and values; a name given several times keeps its first value, as LinuxCNC's reader does."""
    parser = ConfigParser(
        strict=False, interpolation=None, allow_no_value=True, delimiters=("=",), comment_prefixes=("#", ";")
    )
    seen: set[tuple[str, str]] = set()
    section = ""
    kept: list[str] = []
    for raw in text.splitlines():
        line = raw.strip()
        if line.startswith("[") and line.endswith("]"):
            section = line.lower()
        key = line.partition("=")[0].strip().lower()
        if "=" in line and not line.startswith(("#", ";")):
            if (section, key) in seen:
                continue
            seen.add((section, key))
        elif line and not line.startswith(("[", "#", ";")):
            continue
        kept.append(line)
    parser.read_string("\n".join(kept))
    return parser


def read_ini(path: Path) -> Ini:
    """Reads an ini file. Raises OSError if it cannot be read and configparser.Error if it is no ini file."""
    values = parse_ini(path.read_text(encoding="utf-8", errors="replace"))
    folder = path.parent
    parameter = values.get("RS274NGC", "PARAMETER_FILE", fallback=None)
    folders = (values.get("RS274NGC", "SUBROUTINE_PATH", fallback=None) or "").split(":")
    prefix = values.get("DISPLAY", "PROGRAM_PREFIX", fallback=None)
    found = tuple(str(folder / name) for name in [*folders, prefix] if name)
    return Ini(values, folder / parameter if parameter else None, found)
