"""Steps of codes that most programs do without: each loads its module when the first such code is executed.

A program of a hundred lines is read in less time than these modules take to load.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcode.block import Block
    from gcode.machine import Machine


def go_to_reference(machine: Machine, block: Block) -> None:
    """G28 and G30."""
    from gcode import reference

    reference.go_to_reference(machine, block)


def store_reference(machine: Machine, block: Block) -> None:
    """G28.1 and G30.1."""
    from gcode import reference

    reference.store_reference(machine, block)


def set_data(machine: Machine, block: Block) -> None:
    """G10."""
    from gcode import g10

    g10.set_data(machine, block)


def saved_state(machine: Machine, block: Block) -> None:
    """M70 to M73."""
    from gcode import saved

    saved.saved_state(machine, block)


def user_command(machine: Machine, block: Block) -> None:
    """M100 to M199."""
    from gcode import usercommands

    usercommands.user_command(machine, block)


def switch_on_compensation(machine: Machine, block: Block) -> None:
    """G41 to G42.1."""
    from gcode import compensation

    compensation.switch_on(machine, block)


def flush(machine: Machine) -> None:
    """What cutter compensation holds back. Raises ``GcodeError``."""
    if machine.compensation is not None:
        from gcode import compensation

        compensation.flush(machine)


def spline(machine: Machine, block: Block, motion: int) -> None:
    """G5 and G5.1."""
    from gcode import splines

    splines.spline(machine, block, motion)


def nurbs_point(machine: Machine, block: Block, _motion: int) -> None:
    """G5.2."""
    from gcode import splines

    splines.nurbs_point(machine, block)


def nurbs_end(machine: Machine, block: Block) -> None:
    """G5.3."""
    from gcode import splines

    splines.nurbs_end(machine, block)


def synchronised(machine: Machine, block: Block, motion: int) -> None:
    """G33 and G33.1."""
    from gcode import threading

    threading.synchronised(machine, block, motion)


def threading_cycle(machine: Machine, block: Block, _motion: int) -> None:
    """G76."""
    from gcode import threading

    threading.threading_cycle(machine, block)


def probe(machine: Machine, block: Block, motion: int) -> None:
    """G38.2 to G38.5."""
    from gcode import probing

    probing.probe(machine, block, motion)


def canned_cycle(machine: Machine, block: Block, motion: int) -> None:
    """G73, G74 and G81 to G89."""
    from gcode import cycles

    cycles.canned_cycle(machine, block, motion)


def lathe_cycle(machine: Machine, block: Block, motion: int) -> None:
    """G70 to G72.2."""
    from gcode import lathecycles

    lathecycles.lathe_cycle(machine, block, motion)
