"""The interpreter's machine: state, parameters, tools and emitter, which every step of a line works on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Literal

from gcode.block import Block
from gcode.dialects import DIALECTS
from gcode.emit import Emitter
from gcode.errors import GcodeError
from gcode.memory import CycleMemory
from gcode.parameters import Parameters
from gcode.records import dataclass
from gcode.setup import Setup, Tool
from gcode.state import NO_TOOL, State, position_of
from gcode.synch import Answer, Synch

Warn = Callable[[GcodeError], None]
MACHINE_UNIT_MM = {"mm": 1.0, "inch": 25.4}


@dataclass(slots=True)
class Context:
    """What M70 and M73 saved at one call level; ``restore``: on return."""

    modes: object = None
    restore: bool = False


def _nothing(_text: str) -> None:
    """Before a run there is nothing to execute text with."""


def _no_lines(_name: str) -> Iterator[Block]:
    """Before a run there are no subprograms."""
    return iter(())


class Machine:
    """One run. ``finished`` is set by M2 and M30; ``synch`` by a step that has to wait for the machine.

    ``contexts``: one for each call level; ``compensation``: while cutter compensation is on;
    ``arc_forbidden``: the move after G40 must be straight; ``local``: transformation of other dialects;
    ``run_text`` executes a line of text as part of the program;
    ``profile`` gives the blocks of a subprogram without executing their motion.
    """

    def __init__(self, setup: Setup, dialect: str = "") -> None:
        self.setup = setup
        self.dialect = DIALECTS[dialect or setup.dialect]
        self.state = State(machine_unit_mm=MACHINE_UNIT_MM[setup.machine_units])
        self.parameters = Parameters(self.state, setup.parameters)
        self.tools: dict[int, Tool] | None = None if setup.tools is None else dict(setup.tools)
        self.free_tools: dict[int, Tool] = {}
        self.finished = False
        self.warnings: list[GcodeError] = []
        self.cycle = CycleMemory()
        self.compensation: Any = None
        self.arc_forbidden = False
        self.local: Any = None
        self.nurbs_points: list[tuple[float, float, float]] = []
        self.nurbs_order = 3
        self.contexts: list[Context] = [Context()]
        self.synch: Synch | None = None
        self.run_text: Callable[[str], None] = _nothing
        self.profile: Callable[[str], Iterator[Block]] = _no_lines
        self._begin()
        self.emit = Emitter(self.state)

    def _begin(self) -> None:
        """Offsets of the parameters, the work offset over them, and the start position in their frame."""
        state, values, setup = self.state, self.parameters.values, self.setup
        system = int(values.get(5220, 1.0) + 1e-4)
        state.system = system if 1 <= system <= 9 else 1
        values[5220] = float(state.system)
        if setup.work_offset is not None:
            for axis, offset_mm in enumerate(setup.work_offset):
                values[5221 + axis] = offset_mm / state.machine_unit_mm if axis not in (3, 4, 5) else offset_mm
        self.load_system(state.system)
        if values.get(5210, 0.0):
            state.shift = [state.from_machine_units(values.get(5211 + axis, 0.0), axis) for axis in range(9)]
        start = [value / state.unit_mm if axis not in (3, 4, 5) else value for axis, value in enumerate(setup.start)]
        state.position = state.relative(start)

    def load_system(self, system: int) -> None:
        """Origin and rotation of coordinate system ``system`` (1 is G54) into the state."""
        state, values = self.state, self.parameters.values
        base = 5201 + 20 * system
        state.origin = [state.from_machine_units(values.get(base + axis, 0.0), axis) for axis in range(9)]
        state.rotation_deg = values.get(base + 9, 0.0)

    def tool(self, number: int, at: str) -> Tool:
        """The tool ``number``. GC060 if the table lacks it; without a table every number is a tool without length."""
        if self.tools is None:
            return self.free_tools.setdefault(number, Tool(number)) if number else NO_TOOL
        tool = self.tools.get(number)
        if tool is None:
            if number == 0:
                return NO_TOOL
            known = " ".join(f"T{n}" for n in sorted(self.tools)[:12]) or "no tools"
            raise GcodeError("GC060", f"tool {number} is not in the tool table", f"the table has {known}", at)
        return tool

    def active_compensation(self) -> Any:
        """The compensation that moves must obey (on, and with a radius), or None."""
        compensation = self.compensation
        return compensation if compensation is not None and compensation.radius > 0.0 else None

    def warn(self, code: str, message: str, hint: str, at: str | None = None) -> None:
        """Notes something legal and suspicious about the line being executed."""
        self.warnings.append(GcodeError(code, message, hint, at))

    def wait(self, kind: Literal["probe", "input", "tool", "user", "position"], **request: Any) -> None:
        """After this line, stop until the machine has answered."""
        self.synch = Synch(
            self.emit.line, kind, self.emit.frame.to_machine(position_of(self.state.position)), **request
        )

    def answered(self, synch: Synch, answer: Answer) -> None:
        """Takes the machine's answer into position and parameters."""
        state, values, emit = self.state, self.parameters.values, self.emit
        if answer.position is None and synch.kind == "tool" and self.arc_forbidden:
            state.position = list(emit.frame.to_program(emit.last))
        elif answer.position is not None:
            state.position = list(emit.frame.to_program(answer.position))
            emit.last = answer.position
        if synch.kind == "probe":
            touched = emit.frame.to_program(answer.probe or answer.position or synch.target)
            for axis, value in enumerate(touched):
                values[5061 + axis] = value
            values[5070] = float(answer.tripped)
        elif synch.kind == "input":
            values[5399] = answer.value
