"""A program file: its lines, read once each, and the structure of its O-words.

The structure is found before anything runs: which ``endif`` belongs to which ``if``, where subprograms begin and end.
So an unbalanced O-word is an error wherever it stands, even in a subprogram that nobody calls.
"""

from __future__ import annotations

import re
from dataclasses import field

from gcode.block import Line, Statement
from gcode.dialects import Dialect
from gcode.errors import GcodeError
from gcode.reading import read_line
from gcode.records import dataclass
from gcode.source import split_lines

_FLOW = re.compile(r"^[ \t/]*(?:n[ \t\d.]*)?(?:o|m[ \t]*0*9[89](?!\d))", re.IGNORECASE | re.MULTILINE)
_MACRO_FLOW = re.compile(
    r"^[ \t/]*(?:n[ \t\d.]*)?(?:if[ \t]*\[|while[ \t]*\[|goto|(?:do|end)[ \t]*\d)|\bg[ \t]*0*6[56]|\bm[ \t]*97",
    re.IGNORECASE | re.MULTILINE,
)
_END = re.compile(r"^[ \t]*(?:n[ \t\d.]*)?m[ \t]*0*(?:2|30)(?!\d)", re.IGNORECASE)

CLOSED_BY = {"mwhile": "END", "mdo": "END"}
OPENERS = {"if": "endif", "while": "endwhile", "do": "while", "repeat": "endrepeat", "sub": "endsub"}
CLOSERS = {"endif": ("if",), "endwhile": ("while",), "endrepeat": ("repeat",), "endsub": ("sub",)}
LOOPS = frozenset({"while", "do", "repeat"})


@dataclass(slots=True)
class Construct:
    """One block structure: indices (from 0) of its first and last line and of the branches between them."""

    kind: str
    label: str
    start: int
    end: int = -1
    branches: list[int] = field(default_factory=list)


@dataclass(slots=True)
class Fault:
    """A reading or structure error of one line, found before execution."""

    index: int
    error: GcodeError


class Program:
    """The lines of one file. ``structured``: it has O-words or M98 or M99, so that lines may run more than once."""

    def __init__(self, text: str, name: str, dialect: Dialect) -> None:
        self.name = name
        self.dialect = dialect
        self.lines = split_lines(text)
        plain = text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text
        self.structured = _FLOW.search(plain) is not None
        if dialect.macro_b and _MACRO_FLOW.search(plain) is not None:
            self.structured = True
        self.notes: dict[int, tuple[GcodeError, ...]] = {}
        self.sequences: dict[str, int] = {}
        self.faults: list[Fault] = []
        self.broken: set[int] = set()
        self.subs: dict[str, Construct] = {}
        self.labels: dict[str, int] = {}
        self.at: dict[int, Construct] = {}
        self._read: dict[int, Line | None] = {}
        self.first, self.stop = _percent_range(self.lines, dialect)
        if self.structured:
            self._build()

    def line(self, index: int) -> Line | None:
        """The line at ``index`` as read; None if it is blank. Raises ``GcodeError``, for a faulty line each time."""
        if self.structured and index in self._read:
            return self._read[index]
        read = read_line(self.lines[index], index + 1, self.dialect)
        if read.warnings:
            self.notes[index] = read.warnings
        if self.structured:
            self._read[index] = read.line
            if read.line is not None and read.line.sequence is not None:
                self.sequences.setdefault(read.line.sequence.lstrip("0") or "0", index)
        return read.line

    def _build(self) -> None:
        """Reads all lines up to the closing percent sign and matches the O-words."""
        open_: list[Construct] = []
        ended = False
        for index in range(self.first, self.stop):
            text = self.lines[index]
            try:
                line = self.line(index)
            except GcodeError as error:
                inside = any(construct.kind == "sub" for construct in open_)
                if not ended or inside:
                    self.faults.append(Fault(index, error))
                continue
            if line is not None and line.statement is not None:
                try:
                    self._match(open_, index, line.statement)
                except GcodeError as error:
                    self.faults.append(Fault(index, error))
                    self.broken.add(index)
            if not open_ and _END.match(text):
                ended = True
        for construct in open_:
            closer = OPENERS.get(construct.kind) or CLOSED_BY[construct.kind]
            unclosed = GcodeError(
                "GC082",
                f"O{construct.label} {construct.kind.upper()} has no {closer.upper()}",
                f"add 'o{construct.label} {closer}' where it ends",
                (0, 1 << 20),
            )
            construct.end = self.stop
            self.faults.append(Fault(construct.start, unclosed))
        self.faults.sort(key=lambda fault: fault.index)

    def _match(self, open_: list[Construct], index: int, statement: Statement) -> None:
        keyword, label = statement.keyword, statement.label
        if keyword in {"mwhile", "mdo"}:
            construct = Construct(keyword, label, index)
            open_.append(construct)
            self.at[index] = construct
        elif keyword == "mend":
            self._end_macro_loop(open_, index, statement)
        elif keyword in {"goto", "ifgoto", "ifthen"}:
            pass
        elif keyword == "":
            self.labels.setdefault(label, index)
        elif keyword == "while" and open_ and open_[-1].kind == "do" and open_[-1].label == label:
            self._close(open_, index)
        elif keyword in OPENERS:
            self._open(open_, index, keyword, label, statement)
        elif keyword in CLOSERS:
            _check_closes(open_, keyword, label, statement)
            self._close(open_, index)
        elif keyword in {"elseif", "else"}:
            _check_closes(open_, keyword, label, statement)
            open_[-1].branches.append(index)
            self.at[index] = open_[-1]
        elif keyword in {"break", "continue"}:
            loops = [c for c in open_ if c.kind in LOOPS and c.label == label]
            if not loops:
                raise GcodeError(
                    "GC081", f"{keyword.upper()} outside a loop O{label}", "name the loop it belongs to", statement.span
                )
            self.at[index] = loops[-1]
        elif keyword == "return" and not any(c.kind == "sub" for c in open_):
            raise GcodeError(
                "GC081", "RETURN outside a subprogram", "it belongs between SUB and ENDSUB", statement.span
            )

    def _end_macro_loop(self, open_: list[Construct], index: int, statement: Statement) -> None:
        if not open_ or open_[-1].kind not in {"mwhile", "mdo"} or open_[-1].label != statement.label:
            raise GcodeError(
                "GC081",
                f"END{statement.label} without DO{statement.label}",
                "loops must lie inside each other",
                statement.span,
            )
        self._close(open_, index)

    def _open(self, open_: list[Construct], index: int, kind: str, label: str, statement: Statement) -> None:
        construct = Construct(kind, label, index)
        if kind == "sub":
            if any(c.kind == "sub" for c in open_):
                raise GcodeError(
                    "GC083",
                    f"O{label} SUB inside another subprogram",
                    "close the other with ENDSUB first",
                    statement.span,
                )
            if label in self.subs:
                first = self.subs[label].start + 1
                raise GcodeError(
                    "GC083",
                    f"O{label} SUB is defined twice: first on line {first}",
                    "rename one of them",
                    statement.span,
                )
            self.subs[label] = construct
        open_.append(construct)
        self.at[index] = construct

    def _close(self, open_: list[Construct], index: int) -> None:
        construct = open_.pop()
        construct.end = index
        self.at[index] = construct


def _check_closes(open_: list[Construct], keyword: str, label: str, statement: Statement) -> None:
    kinds = CLOSERS.get(keyword, ("if",))
    if open_ and open_[-1].kind in kinds and open_[-1].label == label:
        return
    wanted = kinds[0].upper()
    if not open_:
        raise GcodeError(
            "GC081",
            f"O{label} {keyword.upper()} without O{label} {wanted}",
            f"add 'o{label} {kinds[0]}' before it",
            statement.span,
        )
    inner = open_[-1]
    raise GcodeError(
        "GC081",
        f"O{label} {keyword.upper()} does not match O{inner.label} {inner.kind.upper()} of line {inner.start + 1}",
        f"the open block wants O{inner.label} {(OPENERS.get(inner.kind) or CLOSED_BY[inner.kind]).upper()}",
        statement.span,
    )


def _percent_range(lines: list[str], dialect: Dialect) -> tuple[int, int]:
    """First line of the program and the one after its last: inside the percent signs, if the file begins with one."""
    for index, line in enumerate(lines):
        stripped = line.strip()
        if stripped == "%":
            if dialect.lenient:
                return index + 1, _last_percent(lines, index)
            for stop in range(index + 1, len(lines)):
                if lines[stop].strip() == "%":
                    return index + 1, stop
            return index + 1, len(lines)
        if stripped:
            return 0, len(lines)
    return 0, len(lines)


def _last_percent(lines: list[str], first: int) -> int:
    """Lenient dialects have percent signs in the middle: the last one counts, if nothing but blank lines follows it."""
    for stop in range(len(lines) - 1, first, -1):
        stripped = lines[stop].strip()
        if stripped == "%":
            return stop
        if stripped:
            break
    return len(lines)


def has_percent(program: Program) -> bool:
    """Whether the program began with a percent sign."""
    return program.first > 0
