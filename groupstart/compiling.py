"""Compiles the modules that run for every exchange, with mypyc, and the kernels over arrays, with numba: four times the
speed of an offline run.

    python -m groupstart.compiling             compile for this Python; takes two minutes
    python -m groupstart.compiling --status    say whether compiled modules are in use, and if not, why
    python -m groupstart.compiling --remove    remove them

What is made lies in ``groupstart/_compiled`` beside its manifest and is used by ``groupstart.compiled`` while the
sources stay as they are. A wheel is built with it wherever there is a C compiler (``hatch_build.py``).
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path

from groupstart.compiled import FINDER, FOLDER, KERNELS, LIBRARY, MANIFEST, ROOMS, ROOT, source_digest

REQUIRED = ("mypy>=1.18", "setuptools>=65", "numba>=0.60")
"""What compiling needs, as requirements."""
PATTERNS = (
    "nmc/belief.py", "nmc/budget.py", "nmc/bus.py", "nmc/executor.py", "nmc/guard.py", "nmc/modes.py",
    "nmc/program.py", "nmc/recording_link.py", "nmc/servo_modes.py", "nmc/talk.py", "nmc/together.py", "nmc/twin.py",
    "nmc/wire.py", "nmc/chips/common.py", "nmc/chips/picservo.py", "nmc/chips/picstep.py", "nmc/chips/table4.py",
    "nmc/codec.py", "planner/motors.py", "planner/quantize.py", "planner/steptrain.py", "planner/stream*.py",
    "sim/bus.py", "sim/clock.py", "sim/commandline.py", "sim/cy545_line.py", "sim/draws.py", "sim/link.py",
    "sim/module.py", "sim/picio.py", "sim/picservo.py", "sim/picstep.py", "sim/registers.py", "sim/statusline.py",
    "sim/stepguard.py", "sim/stepinputs.py", "sim/stepload.py", "sim/stepmodes.py", "sim/steptimer.py",
    "sim/trace.py", "sim/uart.py", "sim/violations.py", "sim/world.py",
    "machines/governor.py", "machines/patience.py", "machines/ratecontrol.py", "machines/several.py",
    "machines/strain.py", "machines/streaming.py",
)  # fmt: skip
"""What runs for every exchange, and every class derived from one of those: a compiled class has no heirs in Python."""
UNTOUCHED = ("runtime_checkable", "(NmcError)", "(Exception)", "@native(")
"""Modules with these words stay as they are: protocols that are asked for at run time, exceptions, which others derive
from, and what numba compiles."""
NO_VALUES = (ast.Attribute, ast.Call, ast.Name, ast.Subscript)
"""What may be a type: such names are left alone."""
CONFIG = """[mypy]
ignore_missing_imports = True
[mypy-click.*,matplotlib.*,numba.*,pydantic.*,rich.*,ruckig.*,scipy.*,serial.*,toppra.*]
follow_imports = skip
"""


class CompileError(Exception):
    """No compiled modules could be made; the words say why."""


def c_compiler() -> str | None:
    """The compiler that built this Python, if it is here with Python's headers."""
    words = (sysconfig.get_config_var("CC") or "cc").split()
    headers = Path(sysconfig.get_path("include"), "Python.h").exists()
    return shutil.which(words[0]) if headers else None


def sources_of(root: Path) -> list[str]:
    """The modules to compile, as paths from ``root``."""
    found = {path.relative_to(root).as_posix() for pattern in PATTERNS for path in root.glob(pattern)}
    return [name for name in sorted(found) if not any(word in (root / name).read_text("utf-8") for word in UNTOUCHED)]


def kernel_modules(root: Path) -> list[str]:
    """The modules of the rooms with kernels in them."""
    paths = sorted(path for room in ROOMS for path in (root / room).rglob("*.py"))
    return [_module_of(path.relative_to(root).as_posix()) for path in paths if "\n@native(" in path.read_text("utf-8")]


def with_finals(source: str) -> str:
    """The source with its constants declared ``Final``, so that their values stand in the code that uses them.

    Constants are names in capitals that a module binds once, at its top. Lines keep their numbers.
    """
    lines = source.splitlines()
    for node in ast.parse(source).body:
        if not isinstance(node, ast.Assign) or len(node.targets) != 1:
            continue
        target, value, number = node.targets[0], node.value, node.lineno - 1
        if _is_constant(target) and not isinstance(value, NO_VALUES):
            name = ast.unparse(target)
            lines[number] = lines[number].replace(f"{name} =", f"{name}: Final =", 1)
        elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple) and all(map(_is_constant, target.elts)):
            pairs = zip(map(ast.unparse, target.elts), map(ast.unparse, value.elts), strict=True)
            lines[number] = "; ".join(f"{name}: Final = {each}" for name, each in pairs)
            lines[number + 1 : node.end_lineno] = [""] * ((node.end_lineno or node.lineno) - node.lineno)
    first = "from __future__ import annotations"
    return "\n".join(f"{line}; from typing import Final" if line == first else line for line in lines) + "\n"


def with_plain_records(source: str) -> str:
    """The source with an ``__init__`` written out for each of its dataclasses that needs nothing else.

    The one that ``dataclasses`` makes stays Python, and that of a frozen one goes through ``object.__setattr__`` for
    every field. That nobody changes a frozen record has been checked in the source; compiled, nothing prevents it. The
    new line takes the place of the blank one after the class, so lines keep their numbers.
    """
    lines = source.splitlines()
    for node in ast.parse(source).body:
        made = _record(node) if isinstance(node, ast.ClassDef) else None
        if made is None or lines[node.end_lineno or 0 : (node.end_lineno or 0) + 1] != [""]:
            continue
        decorator, init = made
        lines[node.lineno - 2] = f"@{decorator}"
        lines[node.end_lineno or 0] = f"    {init}"
    return "\n".join(lines) + "\n"


def _record(node: ast.ClassDef) -> tuple[str, str] | None:
    """Decorator and ``__init__`` of a plain dataclass; None if the class is something else."""
    if node.bases or len(node.decorator_list) != 1 or node.decorator_list[0].lineno != node.lineno - 1:
        return None
    decorator = node.decorator_list[0]
    if not isinstance(decorator, ast.Call) or ast.unparse(decorator.func) != "dataclass":
        return None
    asked = {each.arg: ast.unparse(each.value) for each in decorator.keywords}
    fields = [each for each in node.body if isinstance(each, ast.AnnAssign)]
    methods = {each.name for each in node.body if isinstance(each, ast.FunctionDef)}
    values = [None if each.value is None else ast.unparse(each.value) for each in fields]
    if methods & {"__init__", "__post_init__"} or any(value and value.startswith("field(") for value in values):
        return None
    compared = asked.get("eq") != "False"
    options = ["init=False"] + (["eq=False"] if not compared else [])
    options += ["unsafe_hash=True"] if compared and asked.get("frozen") == "True" else []
    given = [f"{ast.unparse(each.target)}: {ast.unparse(each.annotation)}" for each in fields]
    given = [text if value is None else f"{text} = {value}" for text, value in zip(given, values, strict=True)]
    body = "; ".join(f"self.{ast.unparse(each.target)} = {ast.unparse(each.target)}" for each in fields)
    return f"dataclass({', '.join(options)})", f"def __init__(self, {', '.join(given)}) -> None: {body}"


def _is_constant(name: ast.expr) -> bool:
    return isinstance(name, ast.Name) and name.id.isupper()


def compile_into(folder: Path, root: Path = ROOT) -> list[str]:
    """Compile the modules of ``root`` into ``folder``, which is made anew; returns the files, from ``folder`` on.

    Raises CompileError; ``folder`` is then as it was.
    """
    if c_compiler() is None:
        raise CompileError("there is no C compiler, or Python's headers are missing")
    digest, names = source_digest(root), sources_of(root)
    with tempfile.TemporaryDirectory(prefix="groupstart-compile-") as name:
        work = Path(name)
        for room in (*ROOMS, "gcode"):
            shutil.copytree(root / room, work / room, ignore=shutil.ignore_patterns("__pycache__", "data"))
        for source in names:
            (work / source).write_text(with_plain_records(with_finals((work / source).read_text("utf-8"))), "utf-8")
        (work / "mypy.ini").write_text(CONFIG, "utf-8")
        script = str(root / "groupstart" / "mypyc_build.py")
        group = LIBRARY.removesuffix("__mypyc")
        done = subprocess.run(
            [sys.executable, "-P", script, group, *names], cwd=work, capture_output=True, text=True, check=False
        )
        suffix = EXTENSION_SUFFIXES[0]
        made = {module: module.replace(".", "/") + suffix for module in (LIBRARY, *map(_module_of, names))}
        missing = [file for file in made.values() if not (work / file).exists()]
        if done.returncode or missing:
            raise CompileError(f"{done.stdout}{done.stderr}".strip() or f"not made: {missing[0]}")
        told, kernels = _make_kernels(root, work), KERNELS + suffix
        if (work / kernels).exists():
            made[KERNELS] = kernels
        else:
            print(f"kernels are left to numba, which will compile them when they are first called: {told}")
        _keep(work, folder, made, {"suffix": suffix, "sources": digest, "modules": made})
    return [*made.values(), MANIFEST]


def _make_kernels(root: Path, folder: Path) -> str:
    """Make the library of kernels, if numba can (it says that its way to do so will change); returns what was said."""
    script = str(root / "groupstart" / "kernel_build.py")
    command = [sys.executable, "-P", script, str(root), str(folder), *kernel_modules(root)]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache")}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    return f"{done.stdout}{done.stderr}".strip()


def _module_of(source: str) -> str:
    return source.removesuffix(".py").replace("/", ".")


def _keep(work: Path, folder: Path, made: dict[str, str], manifest: dict[str, object]) -> None:
    """The manifest comes last: without it nothing is used."""
    shutil.rmtree(folder, ignore_errors=True)
    for file in made.values():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(work / file, folder / file)
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1), "utf-8")


def main() -> int:
    """The command line; exit status 1 if nothing could be compiled."""
    parser = argparse.ArgumentParser(prog="python -m groupstart.compiling", description=__doc__.splitlines()[0])
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument("--status", action="store_true", help="say whether compiled modules are in use")
    choice.add_argument("--remove", action="store_true", help="remove compiled modules")
    chosen = parser.parse_args()
    if chosen.status:
        FINDER.find_spec(ROOMS[0], None)
        print(FINDER.state)
    elif chosen.remove:
        shutil.rmtree(FOLDER, ignore_errors=True)
    else:
        try:
            files = compile_into(FOLDER)
        except CompileError as error:
            print(f"{error}\nNothing is compiled; it needs a C compiler and: pip install 'groupstart[compile]'")
            return 1
        print(f"{sum(file != MANIFEST and not file.startswith((LIBRARY, KERNELS)) for file in files)} modules compiled")
    return 0


if __name__ == "__main__":
    sys.exit(main())
