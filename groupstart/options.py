"""Options that several verbs share, and their parameter types."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])

DEFAULT_MACHINE = "mill3-step"
SOLVERS = ("auto", "toppra", "kernel")
PROFILES = ("auto", "group", "adaptive", "exact", "stop-here", "smooth")


class Offset(click.ParamType[tuple[float, ...]]):
    """``X,Y,Z``: up to nine numbers in mm (degrees on A, B, C), missing ones are 0."""

    name = "X,Y,Z"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, ...]:
        """Nine floats in the order XYZABCUVW."""
        if isinstance(value, tuple):
            return value
        parts = str(value).split(",")
        try:
            numbers = [float(part) if part.strip() else 0.0 for part in parts]
        except ValueError:
            self.fail(f"{value!r}: give numbers with commas between them, such as 10,20,-5", param, ctx)
        if len(numbers) > 9:
            self.fail(f"{value!r}: at most nine numbers (X Y Z A B C U V W)", param, ctx)
        if not all(math.isfinite(item) for item in numbers):
            self.fail(f"{value!r}: every number must be finite", param, ctx)
        return tuple(numbers + [0.0] * (9 - len(numbers)))


def file_argument(function: F) -> F:
    """The program to work on."""
    return click.argument("file", type=click.Path())(function)


def machine_option(function: F) -> F:
    """``-m``: a shipped machine or a path."""
    return click.option(
        "-m",
        "--machine",
        default=DEFAULT_MACHINE,
        show_default=True,
        metavar="NAME|PATH",
        help="Machine: a shipped name or a machine file.",
    )(function)


def solver_option(function: F) -> F:
    """``--solver``: who times the path."""
    return click.option(
        "--solver", type=click.Choice(SOLVERS), default="auto", show_default=True, help="Timing solver."
    )(function)


def stream_options(function: F) -> F:
    """Options of the verbs that put a plan on the bus."""
    function = click.option(
        "--fit-bus/--no-fit-bus",
        default=None,
        help="Lower accelerations (stop-here: speeds), and slow down, where a bus cannot follow the plan, or not. "
        "With neither: yes, except for profile stop-here.",
    )(function)
    function = click.option(
        "--profile", type=click.Choice(PROFILES), default="auto", show_default=True, help="How the chips are fed."
    )(function)
    return click.option("--seed", type=click.IntRange(min=0), help="Seed of the simulated machine's chance.")(function)


def servo_every_option(function: F) -> F:
    """``--trace-servo-every``: how many servo samples a saved trace keeps."""
    return click.option(
        "--trace-servo-every",
        "servo_every",
        type=click.IntRange(min=1),
        default=1,
        show_default=True,
        metavar="N",
        help="Keep every N-th servo sample in the saved trace.",
    )(function)
