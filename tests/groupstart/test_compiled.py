"""Compiled modules are taken only while they were made from these sources for this Python, and then all of them."""

from __future__ import annotations

import ast
import importlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from groupstart import compiled, compiling
from groupstart.compiled import CompiledFinder, source_digest
from nmc import native

ROOT = compiled.ROOT


@pytest.fixture
def house(tmp_path: Path) -> Path:
    """Rooms of one module each, and a manifest whose library is somebody else's extension module."""
    for room in compiled.ROOMS:
        (tmp_path / room).mkdir()
        (tmp_path / room / "one.py").write_text("A = 1\n")
    folder = tmp_path / "made"
    folder.mkdir()
    (folder / "lib.so").write_bytes(b"not an extension module")
    write_manifest(tmp_path)
    return tmp_path


def write_manifest(house: Path, **changes: object) -> None:
    manifest: dict[str, object] = {
        "suffix": EXTENSION_SUFFIXES[0],
        "sources": source_digest(house),
        "modules": {compiled.LIBRARY: "lib.so", "nmc.one": "nmc/one.so"},
    }
    (house / "made" / compiled.MANIFEST).write_text(json.dumps(manifest | changes))


@pytest.fixture
def finder(house: Path, monkeypatch: pytest.MonkeyPatch) -> CompiledFinder:
    """Of the house, where the library loads."""
    monkeypatch.delenv(compiled.SWITCH, raising=False)
    monkeypatch.setattr(compiled.importlib, "import_module", lambda name: None)
    return CompiledFinder(house / "made", house)


def test_compiled_from_these_sources(finder: CompiledFinder, house: Path) -> None:
    spec = finder.find_spec("nmc.one", None)
    assert spec is not None
    assert spec.origin == str(house / "made" / "nmc" / "one.so")
    assert finder.active
    assert finder.find_spec("nmc.two", None) is None
    assert finder.find_spec("json", None) is None


@pytest.mark.parametrize("room", compiled.ROOMS)
def test_one_letter_of_any_module_of_the_rooms(finder: CompiledFinder, house: Path, room: str) -> None:
    (house / room / "one.py").write_text("A = 2\n")
    assert finder.find_spec("nmc.one", None) is None
    assert finder.state == "compiled from other sources"


def test_a_new_module_counts_as_a_change(finder: CompiledFinder, house: Path) -> None:
    (house / "sim" / "two.py").write_text("")
    assert finder.find_spec("nmc.one", None) is None


def test_another_python(finder: CompiledFinder, house: Path) -> None:
    write_manifest(house, suffix=".cpython-27-x86_64-linux-gnu.so")
    assert finder.find_spec("nmc.one", None) is None
    assert "another Python" in finder.state


def test_a_source_that_is_in_use_already(finder: CompiledFinder, house: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "nmc.one", compiled)  # type: ignore[misc]  # any module will do
    assert finder.find_spec("nmc.one", None) is None
    assert finder.state == "sources were in use already: nmc.one"


def test_switched_off(finder: CompiledFinder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(compiled.SWITCH, "0")
    assert finder.find_spec("nmc.one", None) is None
    assert not finder.active


def test_turned_off_by_a_verb_that_must_not_wait(finder: CompiledFinder) -> None:
    finder.turn_off()
    assert finder.find_spec("nmc.one", None) is None


@pytest.mark.parametrize("text", ["", "{}", "[1"])
def test_a_manifest_that_is_none(finder: CompiledFinder, house: Path, text: str) -> None:
    (house / "made" / compiled.MANIFEST).write_text(text)
    assert finder.find_spec("nmc.one", None) is None
    assert finder.state == "nothing is compiled"


def test_a_library_that_cannot_be_loaded(house: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(compiled.SWITCH, raising=False)
    finder = CompiledFinder(house / "made", house)
    monkeypatch.setattr(sys, "meta_path", [finder, *sys.meta_path])
    (house / "made" / "lib.so").rename(house / "made" / f"lib{EXTENSION_SUFFIXES[0]}")
    modules = {compiled.LIBRARY: f"lib{EXTENSION_SUFFIXES[0]}", "nmc.one": "nmc/one.so"}
    write_manifest(house, modules=modules)
    assert finder.find_spec("nmc.one", None) is None
    assert finder.state.startswith("cannot be loaded")


def test_the_rooms_are_not_imported_by_the_front_door() -> None:
    """The finder must be there first; a room that groupstart itself imports would keep it out."""
    code = "import sys, groupstart, groupstart.cli; print([m for m in sys.modules if m.split('.')[0] in %r])"
    told = subprocess.run(
        [sys.executable, "-c", code % (compiled.ROOMS,)],
        cwd=ROOT, env=dict(os.environ), capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert told.stdout.strip() == "[]"


def test_constants_become_final_and_lines_keep_their_numbers() -> None:
    source = (
        "from __future__ import annotations\n\n"
        "A, _B = 1, 0x02\nC = A + 1  # so much\n(D, E) = (\n    3,\n    4,\n)\nmode = 5\n"
        "I = int\n\n\ndef f() -> I:\n    return A\n"
    )
    made = compiling.with_finals(source)
    bound: dict[str, object] = {}
    exec(compile(made, "made", "exec"), bound)
    assert [bound[name] for name in ("A", "_B", "C", "D", "E", "mode")] == [1, 2, 2, 3, 4, 5]
    finals = [
        n.target.id for n in ast.parse(made).body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)
    ]
    assert finals == ["A", "_B", "C", "D", "E"]
    assert made.splitlines().index("def f() -> I:") == source.splitlines().index("def f() -> I:")


def derived(root: Path) -> Iterator[tuple[str, str, str, str]]:
    """(module, class, module of a base, base) for every class of the house whose base comes from another module."""
    for path in sorted(
        p for room in (*compiled.ROOMS, "groupstart", "benchmarks") for p in (root / room).rglob("*.py")
    ):
        tree = ast.parse(path.read_text("utf-8"))
        origin: dict[str, str] = {}
        for node in ast.walk(tree):
            for alias in node.names if isinstance(node, ast.ImportFrom) and node.module else ():
                assert isinstance(node, ast.ImportFrom)
                whole = f"{node.module}.{alias.name}"
                is_module = (root / whole.replace(".", "/")).with_suffix(".py").exists()
                origin[alias.asname or alias.name] = whole if is_module else node.module or ""
        module = path.relative_to(root).with_suffix("").as_posix().replace("/", ".")
        for node in ast.walk(tree):
            for base in node.bases if isinstance(node, ast.ClassDef) else ():
                for each in ast.walk(base):
                    if isinstance(node, ast.ClassDef) and isinstance(each, ast.Name) and each.id in origin:
                        name = base.attr if isinstance(base, ast.Attribute) else each.id
                        yield module, node.name, origin[each.id], name


def is_protocol(root: Path, module: str, name: str) -> bool:
    text = (root / module.replace(".", "/")).with_suffix(".py").read_text("utf-8")
    return re.search(rf"^class {name}\(.*Protocol\):", text, re.MULTILINE) is not None


def test_whatever_derives_from_a_compiled_class_is_compiled() -> None:
    """A class in Python cannot inherit from a compiled one; protocols are only agreements."""
    names = {source.removesuffix(".py").replace("/", ".") for source in compiling.sources_of(ROOT)}
    assert "sim.picstep" in names
    pairs = list(derived(ROOT))
    assert ("sim.picstep", "PicStep", "sim.module", "NmcModule") in pairs
    stray = [pair for pair in pairs if pair[2] in names and pair[0] not in names]
    assert [pair for pair in stray if not is_protocol(ROOT, pair[2], pair[3])] == []


def test_what_is_to_be_compiled_is_there() -> None:
    for pattern in compiling.PATTERNS:
        assert list(ROOT.glob(pattern)), pattern


RECORDS = '''from __future__ import annotations
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Plain:
    """Words."""

    a: int
    """More words."""
    b: bytes = b""

    def twice(self) -> int:
        return 2 * self.a


@dataclass(slots=True)
class Counter:
    n: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class Same:
    n: int


@dataclass(slots=True)
class Made:
    n: list[int] = field(default_factory=list)


class Other:
    n: int = 3


last = 1
'''


def test_records_are_written_out_and_stay_what_they_were(monkeypatch: pytest.MonkeyPatch) -> None:
    made = compiling.with_plain_records(RECORDS)
    assert [line.split("(")[0] for line in made.splitlines() if "__init__" in line] == ["    def __init__"] * 3
    assert made.splitlines().index("last = 1") == RECORDS.splitlines().index("last = 1")
    for name, text in (("before", RECORDS), ("after", made)):
        module = ModuleType(name)
        monkeypatch.setitem(sys.modules, name, module)
        house: dict[str, Any] = vars(module)
        exec(compile(text, name, "exec"), house)
        plain = house["Plain"]
        assert plain(1) == plain(a=1, b=b"") != plain(2)
        assert hash(plain(1)) == hash(plain(1))
        assert repr(replace(plain(1), b=b"x")) == "Plain(a=1, b=b'x')"
        assert plain(4).twice() == 8
        assert house["Counter"]() == house["Counter"](0)
        assert house["Counter"].__hash__ is None
        assert house["Same"](1) != house["Same"](1)
        assert house["Made"]().n == []


def test_every_kernel_of_the_rooms_is_offered_with_all_its_parameters() -> None:
    modules = compiling.kernel_modules(ROOT)
    assert {"nmc.belief_kernel", "planner.kernel", "sim.servokernel"} <= set(modules)
    assert not set(modules) & {source.removesuffix(".py").replace("/", ".") for source in compiling.sources_of(ROOT)}
    for module in modules:
        importlib.import_module(module)
    offered = {name: (signature, function) for name, signature, function in native.OFFERED}
    assert "planner_walk_sample_q" in offered
    for name, (signature, function) in offered.items():
        assert len(native.parameters_of(signature)) == function.__code__.co_argcount, name
