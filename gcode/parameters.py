"""Numbered and named parameters: what expressions read and assignments write.

Numbered parameters 1 to 5601 are machine-wide, except that 1 to 30 belong to the call level of a subprogram. Named
parameters are local to the subprogram unless their name begins with an underscore. Some of both are windows on the
state (position, modes, tool) and cannot be written.

Source: LinuxCNC's documentation of parameters; numbers as in its system parameter list.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from gcode.errors import GcodeError, nearest
from gcode.expressions import MAX_PARAMETER
from gcode.state import State

READ_ONLY = frozenset((*range(5021, 5030), *range(5400, 5414), *range(5420, 5429)))
LOCAL_COUNT, MACRO_LOCALS = 30, 33
"""Numbered parameters that belong to a call: of an O-word subprogram, of a macro."""


class Parameters:
    """All parameters of a run. ``foreign`` reads ``#<_ini[...]>``; ``returned`` is the value of the last call.

    ``vacant``: a parameter that was never set is vacant, as in Macro B, not zero.
    """

    def __init__(self, state: State, values: Mapping[int, float]) -> None:
        self.state = state
        self.values: dict[int, float] = dict(values)
        self.values.setdefault(5599, 1.0)
        self.vacant = False
        self.globals: dict[str, float] = {}
        self.frames: list[dict[str, float]] = [{}]
        self.windows: dict[str, Callable[[], float]] = {}
        self.foreign: Callable[[str], float] | None = None
        self.returned: float | None = None

    def numbered(self, index: int) -> float:
        """``#index``; 0 if it was never set. GC030 out of range."""
        if not 1 <= index <= MAX_PARAMETER:
            if index == 0 and self.vacant:
                return math.nan
            raise GcodeError("GC030", f"parameter #{index} does not exist", f"numbers go from 1 to {MAX_PARAMETER}")
        if 5420 <= index <= 5428:
            return self._position(index)
        if 5021 <= index <= 5029:
            state = self.state
            return state.absolute()[index - 5021]
        return self.values.get(index, math.nan if self.vacant and index < 1000 else 0.0)

    def _position(self, index: int) -> float:
        if self.state.compensation != 400:
            raise GcodeError(
                "GC094",
                "the current position cannot be read under cutter compensation",
                "the tool runs beside the programmed point: read it after G40",
            )
        return self.state.position[index - 5420]

    def named(self, name: str) -> float:
        """``#<name>``. GC032 if it is not defined."""
        store = self.globals if name.startswith("_") else self.frames[-1]
        value = store.get(name)
        if value is not None:
            return value
        window = self.windows.get(name)
        if window is not None:
            return window()
        if self.foreign is not None and name.startswith(("_ini[", "_hal[")):
            return self.foreign(name)
        known = tuple(store) if not name.startswith("_") else (*self.globals, *self.windows)
        close = nearest(name, known)
        hint = f"did you mean #<{close}>?" if close else f"set it first: #<{name}> = ..."
        raise GcodeError("GC032", f"parameter #<{name}> is not defined", hint)

    def is_defined(self, name: str) -> bool:
        """Whether ``#<name>`` can be read."""
        if self.foreign is not None and name.startswith(("_ini[", "_hal[")):
            try:
                self.foreign(name)
            except GcodeError:
                return False
            return True
        return name in (self.globals if name.startswith("_") else self.frames[-1]) or name in self.windows

    def set_numbered(self, index: int, value: float) -> None:
        """``#index = value``. GC030 out of range, GC031 for a window."""
        self.check_writable(index)
        self.values[index] = value

    def check_writable(self, index: int) -> None:
        """Raises GC030 or GC031 if ``#index`` cannot be assigned."""
        if not 1 <= index <= MAX_PARAMETER:
            raise GcodeError("GC030", f"parameter #{index} does not exist", f"numbers go from 1 to {MAX_PARAMETER}")
        if index in READ_ONLY:
            raise GcodeError(
                "GC031", f"parameter #{index} cannot be set", "it shows the machine's state; use another number"
            )

    def set_named(self, name: str, value: float) -> None:
        """``#<name> = value``. GC031 for a window."""
        if name in self.windows or name.startswith(("_ini[", "_hal[")):
            raise GcodeError(
                "GC031", f"parameter #<{name}> cannot be set", "it shows the machine's state; use another name"
            )
        if name.startswith("_"):
            self.globals[name] = value
        else:
            self.frames[-1][name] = value
