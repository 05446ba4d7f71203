"""Reading values from a compact line: numbers, signs, parameters, functions and brackets (recursive descent)."""

from __future__ import annotations

import re

from gcode.errors import GcodeError, nearest
from gcode.expressions import (
    FUNCTION_NAMES,
    PRECEDENCE,
    Exists,
    NamedParameter,
    Negative,
    Parameter,
    Value,
    binary_of,
    function_of,
)

_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_DIGITS = frozenset("0123456789.")
_LETTERS = re.compile(r"[a-z_]+")
_OPERATOR = re.compile(r"\*\*|[-+*/]|and|or|xor|mod|eq|ne|gt|ge|lt|le")
MAX_DEPTH = 60
"""Brackets inside brackets; a real program has a handful."""


def read_value(line: str, at: int, depth: int = 0) -> tuple[Value, int]:
    """The value that begins at compact index ``at``, and the index after it. GC004 to GC007."""
    char = line[at : at + 1]
    match = _NUMBER.match(line, at)
    if match is not None:
        return _number(line, match)
    if char == "[":
        return read_expression(line, at, depth + 1)
    if char == "#":
        return read_parameter(line, at, depth)
    if char in {"+", "-"}:
        operand, end = read_value(line, at + 1, _deeper(depth, at))
        if char == "+":
            return operand, end
        return (-operand if isinstance(operand, float) else Negative((at, end), operand)), end
    if "a" <= char <= "z":
        return _function(line, at, depth)
    raise _no_value(line, at)


def _number(line: str, match: re.Match[str]) -> tuple[float, int]:
    start, end = match.span()
    if line[end : end + 1] in _DIGITS and end < len(line):
        while end < len(line) and line[end] in _DIGITS:
            end += 1
        raise GcodeError(
            "GC004", f"'{line[start:end]}' is not a number: it has two decimal points", "keep one point", (start, end)
        )
    if end < len(line) and line[end] == "," and line[end + 1 : end + 2].isdigit():
        raise GcodeError(
            "GC001", "a comma in a number", f"write a decimal point: {line[start:end]}.{line[end + 1]}", (end, end + 1)
        )
    return float(match.group()), end


def _no_value(line: str, at: int) -> GcodeError:
    """The error for a place where a number should stand."""
    char = line[at : at + 1]
    if char == "\u2212":
        return GcodeError("GC001", "U+2212, a typographic minus", "type the plain minus sign '-'", (at, at + 1))
    word = line[at - 1 : at].upper()
    owner = f" after {word}" if word.isalpha() else ""
    found = "the end of the line" if at >= len(line) else f"'{char}'"
    hint = (
        f"give {word} a number or remove it"
        if word.isalpha()
        else "a number, #parameter or [expression] must stand here"
    )
    start = at - 1 if at > 0 and word.isalpha() else at
    return GcodeError("GC005", f"a number is missing{owner}: found {found}", hint, (start, at + 1))


def _function(line: str, at: int, depth: int) -> tuple[Value, int]:
    match = _LETTERS.match(line, at)
    name = match.group() if match else ""
    after = line[at + len(name) : at + len(name) + 1]
    if after != "[" or name not in FUNCTION_NAMES:
        if line[at] == "o" and line[at + 1 : at + 2] in _DIGITS and at + 1 < len(line):
            raise GcodeError("GC004", "the letter O in a number", "write the digit zero: 0", (at, at + 1))
        if after == "[":
            close = nearest(name, FUNCTION_NAMES)
            hint = f"did you mean {close.upper()}?" if close else f"the functions are {_listed()}"
            raise GcodeError("GC007", f"unknown function {name.upper()}", hint, (at, at + len(name)))
        raise _no_value(line, at)
    if name == "exists":
        return _exists(line, at, depth)
    operand, end = read_expression(line, at + len(name), depth + 1)
    if name != "atan":
        return function_of(name, operand, (at, end)), end
    if line[end : end + 2] != "/[":
        raise GcodeError("GC007", "ATAN needs two arguments", "write ATAN[y]/[x]", (at, end))
    second, end = read_expression(line, end + 1, depth + 1)
    return binary_of("atan", operand, second, (at, end)), end


def _listed() -> str:
    return " ".join(sorted(name.upper() for name in FUNCTION_NAMES))


def _exists(line: str, at: int, depth: int) -> tuple[Value, int]:
    start = at + len("exists[")
    if line[start : start + 1] != "#":
        raise GcodeError("GC007", "EXISTS needs a parameter", "write EXISTS[#<name>]", (at, start))
    if line[start + 1 : start + 2] == "<":
        name, end = read_name(line, start + 1)
        index: Value = 0.0
    else:
        name = None
        index, end = read_value(line, start + 1, _deeper(depth, at))
    if line[end : end + 1] != "]":
        raise GcodeError("GC006", "the bracket of EXISTS is not closed", "add ']'", (at, end))
    return Exists((at, end + 1), name, index), end + 1


def read_name(line: str, at: int) -> tuple[str, int]:
    """``<name>`` at ``at``. GC006 if it is not closed, GC005 if it is empty."""
    closed = line.find(">", at)
    if closed < 0:
        raise GcodeError("GC006", "the name is not closed", "add '>'", (at, len(line)))
    if closed == at + 1:
        raise GcodeError("GC005", "the name is empty", "write a name between < and >", (at, closed + 1))
    return line[at + 1 : closed], closed + 1


def read_parameter(line: str, at: int, depth: int = 0) -> tuple[Value, int]:
    """``#...`` at ``at``."""
    if line[at + 1 : at + 2] == "<":
        name, end = read_name(line, at + 1)
        return NamedParameter((at, end), name), end
    index, end = read_value(line, at + 1, _deeper(depth, at))
    return Parameter((at, end), index), end


def read_expression(line: str, at: int, depth: int = 0) -> tuple[Value, int]:
    """``[...]`` at ``at``. GC006 if it is not closed, GC007 for an unknown operator."""
    if line[at : at + 1] != "[":
        raise GcodeError("GC006", "a '[' must stand here", "put the expression in [ ]", (at, at + 1))
    _deeper(depth, at)
    return _operations(line, at, at + 1, depth)


def read_open_expression(line: str, at: int) -> tuple[Value, int]:
    """An expression without brackets about it, as Macro B has it behind ``=``: it ends where no operator follows."""
    return _operations(line, None, at, 0)


def _operations(line: str, opened: int | None, end: int, depth: int) -> tuple[Value, int]:
    """Operands and operators from index ``end``, up to the bracket that closes ``opened``."""
    operands: list[Value] = []
    operators: list[str] = []
    starts: list[int] = []
    while True:
        starts.append(end)
        operand, end = read_value(line, end, depth)
        operands.append(operand)
        operator, end = _operator(line, opened, end)
        rank = PRECEDENCE.get(operator, 0)
        while operators and PRECEDENCE[operators[-1]] >= rank:
            right = operands.pop()
            left = operands.pop()
            starts.pop()
            operands.append(binary_of(operators.pop(), left, right, (starts[-1], end - len(operator))))
        if operator in {"]", ""}:
            return operands[0], end
        operators.append(operator)


def _operator(line: str, opened: int | None, at: int) -> tuple[str, int]:
    """The operator at ``at``; at the end "]", or "" of an open expression."""
    if opened is None:
        found = _OPERATOR.match(line, at)
        return ("", at) if found is None else (found.group(), found.end())
    if line[at : at + 1] == "]":
        return "]", at + 1
    if at >= len(line) or line[at] == "\x01":
        raise GcodeError("GC006", "the bracket is not closed", "add ']'", (opened, at))
    match = _OPERATOR.match(line, at)
    if match is not None:
        return match.group(), match.end()
    word = _LETTERS.match(line, at)
    name = word.group() if word else line[at]
    close = nearest(name, tuple(name for name in PRECEDENCE if name.isalpha()), limit=1) if word else None
    hint = f"did you mean {close.upper()}?" if close else "operators: + - * / ** MOD AND OR XOR EQ NE GT GE LT LE"
    raise GcodeError("GC007", f"unknown operator '{name.upper()}'", hint, (at, at + len(name)))


def _deeper(depth: int, at: int) -> int:
    if depth > MAX_DEPTH:
        raise GcodeError(
            "GC037", f"more than {MAX_DEPTH} brackets inside each other", "split the expression", (at, at + 1)
        )
    return depth + 1
