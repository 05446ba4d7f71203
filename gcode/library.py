"""Subprograms in other files: ``name.ngc`` in the folders that the setup names."""

from __future__ import annotations

from dataclasses import field
from pathlib import Path

from gcode.dialects import Dialect
from gcode.program import Program
from gcode.records import dataclass

SUFFIXES = (".ngc", ".nc")
MAX_BYTES = 50_000_000


@dataclass(slots=True)
class Library:
    """Loads each file once. Only files directly in ``folders`` are found: a name cannot climb out of them."""

    folders: tuple[str, ...]
    dialect: Dialect
    _loaded: dict[str, Program | None] = field(default_factory=dict)

    def load(self, name: str) -> Program | None:
        """The program of subprogram ``name``, or None if no folder has it."""
        if name not in self._loaded:
            self._loaded[name] = self._find(name)
        return self._loaded[name]

    def _find(self, name: str) -> Program | None:
        if not name or "/" in name or "\\" in name or name.startswith("."):
            return None
        for folder in self.folders:
            for path in _candidates(Path(folder), name):
                if path.is_file() and path.stat().st_size <= MAX_BYTES:
                    return Program(path.read_text(encoding="utf-8", errors="replace"), path.name, self.dialect)
        return None


def _candidates(folder: Path, name: str) -> list[Path]:
    """The file as named, then one whose name differs in case only (names are lower case in RS274/NGC)."""
    exact = [folder / f"{name}{suffix}" for suffix in SUFFIXES]
    if any(path.is_file() for path in exact) or not folder.is_dir():
        return exact
    wanted = {path.name.lower() for path in exact}
    return exact + sorted(path for path in folder.iterdir() if path.name.lower() in wanted)
