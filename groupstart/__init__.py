"""The front doors: command line, reports and the Python API.

    from groupstart import check, plan, verify

The names are imported when they are first used, so that the command line stays quick.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from groupstart.compiled import install

if TYPE_CHECKING:
    from groupstart.api import Planned, ProgramRefusedError, check, plan, verify

__all__ = ["Planned", "ProgramRefusedError", "check", "plan", "verify"]

install()


def __getattr__(name: str) -> Any:
    """A name of the API, from ``groupstart.api``."""
    if name in __all__:
        from groupstart import api

        return getattr(api, name)
    raise AttributeError(f"groupstart has no {name!r}")
