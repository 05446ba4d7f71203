"""Kernels: functions over numbers and arrays that run as machine code.

``native`` stands in front of each. From the sources numba compiles it when it is first called, and keeps the code for
the next run. Where the house is compiled (``groupstart.compiling``), the machine code of all kernels lies in one
library that was made beforehand from the same functions, by the same compiler: then numba, whose import takes longer
than a short program, is not needed at all.

    @native("f8(f8[:, ::1], i8)")      what the library offers: result, then parameters, in numba's words
    @native()                          called by other kernels only
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from types import ModuleType
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")
LIBRARY = "groupstart__kernels"
"""The extension module with the machine code."""
OFFERED: list[tuple[str, str, Callable[..., Any]]] = []
"""Of the modules that are imported: name in the library, signature, function as it was written."""
COMMON: dict[str, Any] = {"cache": True, "error_model": "numpy"}
"""numba's options for all: a division by zero is infinite, which costs no branch."""
_copying: list[str] = []
"""Modules that are being imported a second time, for numba."""


def native(
    signature: str = "", *, exact: bool = False, inline: bool = False
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator that makes a kernel.

    signature: of what the library offers; its arrays must be C-contiguous. exact: arguments always fit it and are not
    looked at (numbers are converted); otherwise other arrays go to numba. inline: of helpers, put into their callers.
    Without numba helpers stay as they are: nobody calls them.
    """

    def made(function: Callable[P, R]) -> Callable[P, R]:
        name, offered = name_of(function), bool(signature) and not inline
        if offered:
            OFFERED.append((name, signature, function))
        library = None if function.__module__ in _copying else _library()
        if library is None:
            return _by_numba(function, signature if exact or inline else "", inline)
        if not offered:
            return function
        machine: Callable[P, R] = getattr(library, name)
        return machine if exact else _checked(machine, function, parameters_of(signature))

    return made


def at_hand() -> bool:
    """Kernels come from the library: calling one costs neither an import nor time to compile."""
    return _library() is not None


def name_of(function: Callable[..., Any]) -> str:
    """Of a kernel in the library."""
    return f"{function.__module__}.{function.__name__}".replace(".", "_")


def parameters_of(signature: str) -> list[tuple[str, int]]:
    """(numpy's name of the type, dimensions) of each parameter; 0 dimensions: a number."""
    inside = signature[: signature.rindex(")")].rpartition("(")[2]
    found = re.findall(r"(\w+)(?:\[([^]]*)\])?", inside)
    return [(kind, shape.count(",") + 1 if shape else 0) for kind, shape in found]


@cache
def _library() -> ModuleType | None:
    try:
        return import_module(LIBRARY)
    except ImportError:
        return None


def _by_numba(function: Callable[P, R], signature: str, inline: bool) -> Callable[P, R]:
    from numba import njit

    options: dict[str, Any] = {"inline": "always"} if inline else {}
    kernel: Callable[P, R] = njit(*([signature] if signature else []), **COMMON, **options)(function)
    return kernel


def _checked(machine: Callable[P, R], function: Callable[P, R], parameters: list[tuple[str, int]]) -> Callable[P, R]:
    """The library's code believes what it is given: arrays of another kind go to numba."""
    arrays = [(at, np.dtype(kind), size) for at, (kind, size) in enumerate(parameters) if size]

    def kernel(*args: P.args, **kwargs: P.kwargs) -> R:
        for at, kind, size in arrays:
            array: Any = args[at]
            if array.dtype != kind or array.ndim != size or not array.flags.c_contiguous:
                return _of_copy(function)(*args, **kwargs)
        return machine(*args, **kwargs)

    return kernel


def _of_copy(function: Callable[P, R]) -> Callable[P, R]:
    kernel: Callable[P, R] = getattr(_copy(function.__module__), function.__name__)
    return kernel


@cache
def _copy(name: str) -> ModuleType:
    """The module once more, with kernels by numba."""
    file = sys.modules[name].__file__
    assert file is not None
    spec = spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    _copying.append(name)
    try:
        spec.loader.exec_module(module)
    finally:
        _copying.remove(name)
    return module
