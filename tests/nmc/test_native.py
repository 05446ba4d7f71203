"""Kernels by the library and by numba are the same functions; what the library's code cannot take goes to numba."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from nmc import native

SOURCE = '''"""Kernels of a test."""

import numpy as np

from nmc.native import native


@native()
def twice(value: float) -> float:
    return 2.0 * value


@native("f8(f8[::1], i8)")
def total(values: np.ndarray, times: int) -> float:
    found = 0.0
    for value in values:
        found += twice(value) * times
    return found


@native("f8(f8)", exact=True)
def half(value: float) -> float:
    return value / 2.0
'''


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Where a module of kernels lies; nothing of it stays."""
    (tmp_path / "kernels_of_a_test.py").write_text(SOURCE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(native, "OFFERED", [])
    native._copy.cache_clear()
    yield tmp_path
    sys.modules.pop("kernels_of_a_test", None)
    native._copy.cache_clear()


def by_library(monkeypatch: pytest.MonkeyPatch) -> tuple[ModuleType, list[str]]:
    """The module where a library is there, and what was called of it."""
    called: list[str] = []

    def total(values: np.ndarray, times: int) -> float:
        called.append("total")
        return float(2.0 * values.sum() * times)

    library = ModuleType(native.LIBRARY)
    vars(library).update(kernels_of_a_test_total=total, kernels_of_a_test_half=lambda value: value / 2.0)
    monkeypatch.setattr(native, "_library", lambda: library)
    return importlib.import_module("kernels_of_a_test"), called


def test_without_a_library_numba_compiles(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native, "_library", lambda: None)
    module = importlib.import_module("kernels_of_a_test")
    assert module.total(np.array([1.0, 2.0]), 3) == 18.0
    assert module.half(3) == 1.5
    assert module.total.signatures
    assert [each[:2] for each in native.OFFERED] == [
        ("kernels_of_a_test_total", "f8(f8[::1], i8)"),
        ("kernels_of_a_test_half", "f8(f8)"),
    ]


def test_the_library_does_what_it_can_take(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, called = by_library(monkeypatch)
    assert module.total(np.array([1.0, 2.0]), 3) == 18.0
    assert called == ["total"]


@pytest.mark.parametrize(
    "values",
    [np.arange(6.0)[::2], np.arange(3, dtype=np.float32), np.arange(3), np.asfortranarray(np.arange(3.0))[::-1]],
)
def test_other_arrays_go_to_numba(folder: Path, monkeypatch: pytest.MonkeyPatch, values: np.ndarray) -> None:
    module, called = by_library(monkeypatch)
    assert module.total(values, 3) == 6.0 * values.sum()
    assert called == []


@pytest.mark.parametrize(
    ("signature", "parameters"),
    [
        ("void(f8[:, ::1], i8, b1)", [("f8", 2), ("i8", 0), ("b1", 0)]),
        ("Tuple((f8[::1], i4[::1]))(u1[::1], f8)", [("u1", 1), ("f8", 0)]),
        ("UniTuple(f8[::1], 2)(i8[:, :, ::1])", [("i8", 3)]),
    ],
)
def test_parameters_of_a_signature(signature: str, parameters: list[tuple[str, int]]) -> None:
    assert native.parameters_of(signature) == parameters
