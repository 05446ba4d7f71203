"""Tool table and parameter file in LinuxCNC's formats: readers that say what is wrong and where, and writers.

A tool table line is words in any order, ``T1 P1 Z0.5 D3.0 I0 J0 Q0 ; remark``; lengths are in machine units. A
parameter file line is a number and a value.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from gcode.errors import Diagnostic
from gcode.expressions import MAX_PARAMETER
from gcode.setup import Tool
from gcode.state import AXIS_INDEX, position_of

_WORD = re.compile(r"([A-Za-z])\s*([+-]?(?:\d+\.?\d*|\.\d+)?)")
_LETTERS = frozenset("tpdijq") | AXIS_INDEX.keys()


def read_tool_table(text: str, file: str = "<tool table>") -> tuple[dict[int, Tool], list[Diagnostic]]:
    """The tools by number, and a diagnostic (GC301) for every word or line that is no tool."""
    tools: dict[int, Tool] = {}
    found: list[Diagnostic] = []
    for number, line in enumerate(text.splitlines(), 1):
        body, _, remark = line.partition(";")
        if not body.strip() or body.lstrip().startswith(("#", "POC", "Pocket")):
            continue
        tool = _tool(body, remark.strip(), number, file, found)
        if tool is None:
            continue
        if tool.number in tools:
            found.append(
                _wrong(file, number, 1, len(body), f"tool {tool.number} is defined twice", "remove one of them")
            )
        tools[tool.number] = tool
    return tools, found


def _tool(body: str, remark: str, number: int, file: str, found: list[Diagnostic]) -> Tool | None:
    words: dict[str, float] = {}
    before = len(found)
    at = 0
    while at < len(body):
        if body[at].isspace():
            at += 1
            continue
        match = _WORD.match(body, at)
        letter = match.group(1).lower() if match else ""
        if match is None or not match.group(2) or letter not in _LETTERS:
            end = match.end() if match else at + 1
            found.append(
                _wrong(
                    file,
                    number,
                    at + 1,
                    end + 1,
                    f"'{body[at:end]}' is no word of a tool",
                    "words: T P X Y Z A B C U V W D I J Q",
                )
            )
            at = end
            continue
        if letter in words:
            found.append(_wrong(file, number, at + 1, match.end() + 1, f"two {letter.upper()} words", "keep one"))
        words[letter] = float(match.group(2))
        at = match.end()
    if "t" not in words:
        if len(found) == before:
            found.append(_wrong(file, number, 1, len(body) + 1, "a tool without T", "T is its number"))
        return None
    offset = [words.get(letter, 0.0) for letter in AXIS_INDEX]
    return Tool(
        int(words["t"]),
        int(words.get("p", 0.0)),
        position_of(offset),
        words.get("d", 0.0),
        words.get("i", 0.0),
        words.get("j", 0.0),
        int(words.get("q", 0.0)),
        remark,
    )


def _wrong(file: str, line: int, column: int, end: int, message: str, hint: str) -> Diagnostic:
    return Diagnostic(file, line, column, end, "GC301", "error", message, hint)


def read_parameters(text: str, file: str = "<parameters>") -> tuple[dict[int, float], list[Diagnostic]]:
    """Numbered parameters, and a diagnostic (GC302) for every line that is no number and value."""
    values: dict[int, float] = {}
    found: list[Diagnostic] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if not words or words[0].startswith((";", "#")):
            continue
        try:
            index, value = int(words[0]), float(words[1])
        except (ValueError, IndexError):
            found.append(
                Diagnostic(
                    file, number, 1, len(line) + 1, "GC302", "error", "not a parameter", "a line is: 5161 0.000000"
                )
            )
            continue
        if not 1 <= index <= MAX_PARAMETER:
            found.append(
                Diagnostic(
                    file,
                    number,
                    1,
                    len(words[0]) + 1,
                    "GC302",
                    "error",
                    f"there is no parameter {index}",
                    f"numbers go from 1 to {MAX_PARAMETER}",
                )
            )
            continue
        values[index] = value
    return values, found


def write_parameters(values: Mapping[int, float]) -> str:
    """A parameter file: offsets, stored positions, and every other parameter that is not zero and not volatile."""
    kept = {index for base in range(5220, 5400, 20) for index in range(base + 1, base + 11)}
    kept |= {*range(5161, 5170), *range(5181, 5190), *range(5210, 5221)}
    volatile = {*range(1, 31), *range(5021, 5030), *range(5061, 5071), 5399, *range(5400, 5429), 5599, 5600, 5601}
    chosen = sorted((kept | set(values)) - volatile)
    return "".join(f"{index}\t{values.get(index, 0.0):.6f}\n" for index in chosen if index in kept or values[index])


def write_tool_table(tools: Mapping[int, Tool]) -> str:
    """A tool table; words that are zero are left out, except T, P and Z."""
    lines = []
    for tool in sorted(tools.values(), key=lambda tool: tool.number):
        words = [f"T{tool.number}", f"P{tool.pocket}"]
        for letter, axis in AXIS_INDEX.items():
            if tool.offset[axis] or letter == "z":
                words.append(f"{letter.upper()}{tool.offset[axis]:+.6f}")
        for letter, value in (("D", tool.diameter), ("I", tool.front_angle), ("J", tool.back_angle)):
            if value:
                words.append(f"{letter}{value:+.6f}")
        if tool.orientation:
            words.append(f"Q{tool.orientation}")
        lines.append(" ".join(words) + (f" ;{tool.comment}" if tool.comment else ""))
    return "".join(line + "\n" for line in lines)
