"""Values of words: numbers, parameters and bracketed expressions as small trees.

A value is a float (known when the line is read) or a ``Node`` that gives its float when asked with the parameters of
the moment. Constant parts are folded while reading, so ``[1/0]`` is refused without running the program.

Precedence and rounding follow LinuxCNC: ``**`` before ``* / MOD`` before ``+ -`` before comparisons before
``AND OR XOR``; equals from left to right; EQ and NE allow 1e-4; angles in degrees.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Protocol, TypeAlias

from gcode.errors import GcodeError
from gcode.records import dataclass

TOLERANCE_EQUAL = 1e-4
Span = tuple[int, int]


class Environment(Protocol):
    """What expressions may ask for. Both raise ``GcodeError``."""

    def numbered(self, index: int) -> float:
        """Value of ``#index``."""

    def named(self, name: str) -> float:
        """Value of ``#<name>``."""

    def is_defined(self, name: str) -> bool:
        """Whether ``#<name>`` exists."""


@dataclass(frozen=True, slots=True)
class Node(ABC):
    """An expression whose value depends on parameters. ``span``: its place in the compact line."""

    span: Span

    @abstractmethod
    def value(self, env: Environment) -> float:
        """The value now."""


Value: TypeAlias = float | Node


@dataclass(frozen=True, slots=True)
class Parameter(Node):
    """``#12``, ``#[...]`` or ``##3``."""

    index: Value

    def value(self, env: Environment) -> float:
        """The numbered parameter. GC014 for a broken index, GC030 for one out of range."""
        try:
            return env.numbered(whole(evaluate(self.index, env), "a parameter number"))
        except GcodeError as error:
            raise error.placed(self.span) from None


@dataclass(frozen=True, slots=True)
class NamedParameter(Node):
    """``#<name>``; names are lower case here."""

    name: str

    def value(self, env: Environment) -> float:
        """The named parameter, GC032 if it is not defined."""
        try:
            return env.named(self.name)
        except GcodeError as error:
            raise error.placed(self.span) from None


@dataclass(frozen=True, slots=True)
class Exists(Node):
    """``EXISTS[#<name>]`` or ``EXISTS[#5]``."""

    name: str | None
    index: Value

    def value(self, env: Environment) -> float:
        """1 or 0."""
        if self.name is not None:
            return float(env.is_defined(self.name))
        return float(1 <= whole(evaluate(self.index, env), "a parameter number") <= MAX_PARAMETER)


@dataclass(frozen=True, slots=True)
class Negative(Node):
    """A minus sign before a parameter or bracket."""

    operand: Value

    def value(self, env: Environment) -> float:
        """The negated value."""
        return -evaluate(self.operand, env)


@dataclass(frozen=True, slots=True)
class Function(Node):
    """``SIN[...]`` and the other functions of one argument."""

    name: str
    operand: Value

    def value(self, env: Environment) -> float:
        """The function's value; GC035 outside its domain."""
        return apply_function(self.name, evaluate(self.operand, env), self.span)


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """Two operands; ``ATAN[y]/[x]`` is operator "atan"."""

    operator: str
    left: Value
    right: Value

    def value(self, env: Environment) -> float:
        """The operation's value; GC034, GC035 and GC036."""
        return apply_operator(self.operator, evaluate(self.left, env), evaluate(self.right, env), self.span)


MAX_PARAMETER = 5601
"""Greatest parameter number of RS274/NGC in LinuxCNC."""


def evaluate(value: Value, env: Environment) -> float:
    """The float of ``value`` now."""
    return value if isinstance(value, float) else value.value(env)


def whole(value: float, what: str, tolerance: float = 1e-4) -> int:
    """``value`` as an integer, or GC014."""
    nearest = math.floor(value + 0.5)
    if abs(value - nearest) > tolerance:
        raise GcodeError("GC014", f"{what} must be a whole number, found {value:g}", "remove the decimals")
    return nearest


def _round_half_away(x: float) -> float:
    return float(math.trunc(x + (0.5 if x >= 0.0 else -0.5)))


FUNCTIONS: dict[str, Callable[[float], float]] = {
    "abs": abs,
    "acos": lambda x: math.acos(x) * 180.0 / math.pi,
    "asin": lambda x: math.asin(x) * 180.0 / math.pi,
    "cos": lambda x: math.cos(x * math.pi / 180.0),
    "exp": math.exp,
    "fix": lambda x: float(math.floor(x)),
    "fup": lambda x: float(math.ceil(x)),
    "ln": math.log,
    "round": _round_half_away,
    "sin": lambda x: math.sin(x * math.pi / 180.0),
    "sqrt": math.sqrt,
    "tan": lambda x: math.tan(x * math.pi / 180.0),
}
FUNCTION_NAMES = (*FUNCTIONS, "atan", "exists")

_DOMAINS = {
    "sqrt": ("the square root of a negative number", "ABS[...] makes it positive; check the sign of the argument"),
    "acos": ("ACOS of a number outside -1 to 1", "check the ratio inside; it must be between -1 and 1"),
    "asin": ("ASIN of a number outside -1 to 1", "check the ratio inside; it must be between -1 and 1"),
    "ln": ("LN of zero or a negative number", "the argument must be above zero"),
}


def apply_function(name: str, x: float, span: Span) -> float:
    """One function of one number. GC035 outside its domain, GC036 on overflow."""
    try:
        result = FUNCTIONS[name](x)
    except ValueError:
        what, hint = _DOMAINS.get(name, (f"{name.upper()} of {x:g}", "check the argument"))
        raise GcodeError("GC035", f"{what} ({x:g})", hint, span) from None
    except OverflowError:
        raise GcodeError("GC036", f"{name.upper()}[{x:g}] is too large", "check the argument", span) from None
    return result


def _modulo(x: float, y: float) -> float:
    rest = math.fmod(x, y)
    return rest + abs(y) if rest < 0.0 else rest


OPERATORS: dict[str, Callable[[float, float], float]] = {
    "+": lambda x, y: x + y,
    "-": lambda x, y: x - y,
    "*": lambda x, y: x * y,
    "/": lambda x, y: x / y,
    "**": math.pow,
    "mod": _modulo,
    "and": lambda x, y: float(x != 0.0 and y != 0.0),
    "or": lambda x, y: float(x != 0.0 or y != 0.0),
    "xor": lambda x, y: float((x != 0.0) != (y != 0.0)),
    "eq": lambda x, y: float(abs(x - y) < TOLERANCE_EQUAL),
    "ne": lambda x, y: float(abs(x - y) >= TOLERANCE_EQUAL),
    "gt": lambda x, y: float(x > y),
    "lt": lambda x, y: float(x < y),
    "ge": lambda x, y: float(x >= y),
    "le": lambda x, y: float(x <= y),
    "atan": lambda y, x: math.atan2(y, x) * 180.0 / math.pi,
}
PRECEDENCE = {
    **dict.fromkeys(("and", "or", "xor"), 2),
    **dict.fromkeys(("eq", "ne", "gt", "lt", "ge", "le"), 3),
    **dict.fromkeys(("+", "-"), 4),
    **dict.fromkeys(("*", "/", "mod"), 5),
    "**": 6,
}


def apply_operator(operator: str, x: float, y: float, span: Span) -> float:
    """One operation on two numbers. GC034 for a division by zero, GC035 and GC036 for what has no number."""
    if math.isnan(x) or math.isnan(y):
        return _vacant(operator, x, y, span)
    if operator == "/" and y == 0.0:
        raise GcodeError("GC034", "division by zero", "guard it with an IF, or check the divisor", span)
    if operator == "mod" and y == 0.0:
        raise GcodeError("GC034", "MOD by zero", "guard it with an IF, or check the divisor", span)
    try:
        result = OPERATORS[operator](x, y)
    except ValueError:
        raise GcodeError(
            "GC035", f"{x:g}**{y:g} is not a real number", "a negative number can only have a whole power", span
        ) from None
    except (OverflowError, ZeroDivisionError):
        result = math.inf
    if not math.isfinite(result):
        raise GcodeError("GC036", f"{x:g}{operator}{y:g} is too large", "check the operands", span)
    return result


def _vacant(operator: str, x: float, y: float, span: Span) -> float:
    """Macro B: a vacant parameter (not a number here) equals only another one, and counts as zero else."""
    if operator in {"eq", "ne"}:
        return float((math.isnan(x) and math.isnan(y)) == (operator == "eq"))
    return apply_operator(operator, 0.0 if math.isnan(x) else x, 0.0 if math.isnan(y) else y, span)


def function_of(name: str, operand: Value, span: Span) -> Value:
    """A function node, folded if its operand is known."""
    return apply_function(name, operand, span) if isinstance(operand, float) else Function(span, name, operand)


def binary_of(operator: str, left: Value, right: Value, span: Span) -> Value:
    """An operation node, folded if both operands are known."""
    if isinstance(left, float) and isinstance(right, float):
        return apply_operator(operator, left, right, span)
    return Binary(span, operator, left, right)
