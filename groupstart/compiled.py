"""An import finder that takes compiled modules instead of their sources, as long as they were made from exactly these.

``groupstart.compiling`` makes them and says in a manifest from which sources, for which interpreter. Here the two are
compared before the first of them is imported: one changed letter in the sources, another Python, a file that cannot be
loaded, and all modules come from their sources as if nothing had ever been compiled. It is all of them or none: a
compiled module must not meet the source of another.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import EXTENSION_SUFFIXES, ModuleSpec
from pathlib import Path
from types import ModuleType

ROOMS = ("machines", "nmc", "planner", "sim")
"""The packages some of whose modules are compiled."""
ROOT = Path(__file__).resolve().parent.parent
FOLDER = Path(__file__).resolve().with_name("_compiled")
MANIFEST = "manifest.json"
LIBRARY = "groupstart__mypyc"
"""The extension module that holds the code; those named like their sources only point to it."""
KERNELS = "groupstart__kernels"
"""The extension module with the machine code of ``nmc.native``; where numba could not make it, it is not there."""
SWITCH = "GROUPSTART_COMPILED"
"""Environment variable: 0 leaves compiled modules alone."""


def source_digest(root: Path = ROOT) -> str:
    """SHA-256 over names and contents of all modules of the rooms: compiled code holds constants of others, too."""
    import hashlib

    total = hashlib.sha256()
    for room in ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            total.update(f"{path.relative_to(root).as_posix()}\0".encode())
            total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


class CompiledFinder(MetaPathFinder):
    """Finds the compiled modules of ``folder``; looks at it when a module of the rooms is first asked for.

    folder: with a manifest, or not there at all. root: where the rooms' sources are. ``state``: what became of it, in
    words, empty before it has been looked at.
    """

    def __init__(self, folder: Path = FOLDER, root: Path = ROOT) -> None:
        self._folder = folder
        self._root = root
        self._files: dict[str, str] | None = None
        self.state = ""

    @property
    def active(self) -> bool:
        """Modules come from here."""
        return bool(self._files)

    def turn_off(self) -> None:
        """From now on nothing comes from here; too late for what has been imported already."""
        self._files, self.state = {}, "turned off"

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Where the compiled module is; None: look elsewhere."""
        if self._files is None:
            if fullname.partition(".")[0] not in ROOMS:
                return None
            self._look()
        file = self._files.get(fullname) if self._files else None
        return None if file is None else importlib.util.spec_from_file_location(fullname, file)

    def _look(self) -> None:
        import json

        self._files = {}
        if os.environ.get(SWITCH) == "0":
            self.state = f"turned off by {SWITCH}=0"
            return
        try:
            manifest = json.loads((self._folder / MANIFEST).read_text(encoding="utf-8"))
            files = {name: str(self._folder / file) for name, file in manifest["modules"].items()}
        except (OSError, ValueError, KeyError):
            self.state = "nothing is compiled"
            return
        imported = [name for name in files if name in sys.modules]
        if imported:
            self.state = f"sources were in use already: {imported[0]}"
        elif manifest["suffix"] != EXTENSION_SUFFIXES[0]:
            self.state = f"compiled for another Python ({manifest['suffix']})"
        elif manifest["sources"] != source_digest(self._root):
            self.state = "compiled from other sources"
        else:
            self._take(files)

    def _take(self, files: dict[str, str]) -> None:
        """Load the library first: where that fails, no module is touched."""
        self._files = files
        try:
            importlib.import_module(LIBRARY)
        except ImportError as error:
            self._files, self.state = {}, f"cannot be loaded: {error}"
        else:
            self.state = f"{len(files.keys() - {LIBRARY, KERNELS})} modules are compiled"


FINDER = CompiledFinder()


def install() -> None:
    """Let imports of this interpreter go by ``FINDER``; a second call does nothing."""
    if FINDER not in sys.meta_path:
        sys.meta_path.insert(0, FINDER)
