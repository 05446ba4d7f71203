"""Some modules have one door: who else imports them breaks the build.

The wall clock and the serial port are known to the real link alone; chance comes in as a seeded numpy Generator, made
in one place. Run from the root of the project; prints every break and exits 1.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("groupstart", "machines", "planner", "sim", "gcode", "nmc")
DOORS: dict[str, tuple[str, ...]] = {
    "time": ("nmc/serial_link.py",),
    "serial": ("nmc/serial_link.py",),
    "random": (),
    "secrets": (),
}
GENERATOR_MADE_IN = ("sim/build.py",)


def breaks(root: Path) -> Iterator[str]:
    """One line for every import through a wall."""
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            place = path.relative_to(root).as_posix()
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                for module in imported(node):
                    if module in DOORS and place not in DOORS[module]:
                        yield f"{place}:{node.lineno}: imports {module}; its door: {', '.join(DOORS[module]) or 'none'}"
                if reads_clock(node):
                    yield f"{place}:{node.lineno}: reads the wall clock; its door: {DOORS['time'][0]}"
                if makes_generator(node) and place not in GENERATOR_MADE_IN:
                    yield f"{place}:{node.lineno}: makes a random generator; its door: {', '.join(GENERATOR_MADE_IN)}"


def imported(node: ast.AST) -> Iterator[str]:
    """Top-level modules that a statement imports."""
    if isinstance(node, ast.Import):
        yield from (alias.name.split(".")[0] for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
        yield node.module.split(".")[0]


def reads_clock(node: ast.AST) -> bool:
    """``datetime.now()`` and its like; converting a time that came from elsewhere is no clock."""
    return isinstance(node, ast.Attribute) and node.attr in ("now", "utcnow", "today")


def makes_generator(node: ast.AST) -> bool:
    """``default_rng(...)``, by whatever name numpy goes."""
    if not isinstance(node, ast.Call):
        return False
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    return name in ("default_rng", "RandomState")


if __name__ == "__main__":
    found = list(breaks(Path.cwd()))
    print("\n".join(found) or "doors: every clock, port and die is where it belongs")
    sys.exit(1 if found else 0)
