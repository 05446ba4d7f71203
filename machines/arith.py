"""Numbers of a machine file: plain, or arithmetic in a string such as ``"200 * 16 / 5"``.

A pulley ratio written as its teeth stays readable and exact. The string is parsed with ``ast`` and only numbers,
``+ - * / **``, parentheses and ``pi`` are let through: nothing in a machine file can run code.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable

_BINARY: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
}
_UNARY: dict[type[ast.unaryop], Callable[[float], float]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_MAX_LENGTH = 200


def evaluate(text: str) -> float:
    """Value of an arithmetic expression.

    Raises ValueError, in words meant for the author of the machine file, on anything but numbers and operators, on a
    division by zero and on a result that is not finite.
    """
    if len(text) > _MAX_LENGTH:
        raise ValueError(f"an expression of {len(text)} characters is too long (at most {_MAX_LENGTH})")
    try:
        tree = ast.parse(text.strip(), mode="eval")
        value = _value(tree.body)
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(f"{text!r} is not a number or an arithmetic expression") from None
    except ZeroDivisionError:
        raise ValueError(f"{text!r} divides by zero") from None
    except OverflowError:
        raise ValueError(f"{text!r} is too large") from None
    if not math.isfinite(value):
        raise ValueError(f"{text!r} is not a finite number")
    return value


def _value(node: ast.expr) -> float:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)  # type: ignore[arg-type]  # the line above let only int and float through
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        return _BINARY[type(node.op)](_value(node.left), _value(node.right))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
        return _UNARY[type(node.op)](_value(node.operand))
    if isinstance(node, ast.Name) and node.id == "pi":
        return math.pi
    raise ValueError("only numbers, + - * / **, parentheses and pi may stand in an arithmetic string")


def number(value: object) -> object:
    """Turn an arithmetic string into a float and leave everything else for the type check that follows."""
    return evaluate(value) if isinstance(value, str) else value


def whole(value: object) -> object:
    """As :func:`number` for integers: a string or float must come out whole."""
    value = number(value)
    if isinstance(value, float):
        if value != round(value):
            raise ValueError(f"{value:g} is not a whole number")
        return int(value)
    return value


def nonzero(value: float) -> float:
    """Refuse zero: a scale may be negative, never nothing."""
    if value == 0:
        raise ValueError("must not be zero")
    return value
