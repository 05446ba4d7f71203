"""What compiled expressions call."""

from __future__ import annotations

import math
from typing import Any


def _round(x: float) -> float:
    return float(math.trunc(x + (0.5 if x >= 0.0 else -0.5)))


def _mod(x: float, y: float) -> float:
    if y == 0.0:
        raise ZeroDivisionError
    rest = math.fmod(x, y)
    return rest + abs(y) if rest < 0.0 else rest


def _times(count: float) -> int:
    return int(count + 0.5) if count > 0.0 else 0


def _positive(value: float) -> float:
    if value <= 0.0:
        raise ValueError
    return value


HELPERS: dict[str, Any] = {
    **{
        name: getattr(math, name)
        for name in ("sin", "cos", "tan", "asin", "acos", "atan2", "sqrt", "exp", "log", "floor", "ceil", "pi")
    },
    **{"pow_": math.pow, "mod_": _mod, "round_": _round, "times_": _times, "positive_": _positive},
}
