"""Lets a library that would import matplotlib only to offer plots of its own be imported without it.

toppra imports pyplot with its parametrizers, which is more than half of its import time and never used here.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any


class _Later(ModuleType):
    """Stands for a module that is imported when somebody asks it for something."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(importlib.import_module(self.__name__), name)


@contextmanager
def without_plots() -> Iterator[None]:
    """What is imported inside sees a matplotlib.pyplot that is loaded when it is first used; nothing else does."""
    if "matplotlib" in sys.modules:
        yield
        return
    package, pyplot = _Later("matplotlib"), _Later("matplotlib.pyplot")
    package.__path__ = []
    package.pyplot = pyplot  # type: ignore[attr-defined]  # as an import would
    stand_ins = {module.__name__: module for module in (package, pyplot)}
    sys.modules.update(stand_ins)
    try:
        yield
    finally:
        for name, module in stand_ins.items():
            if sys.modules.get(name) is module:
                del sys.modules[name]
