"""What the chips themselves tell of a fault, once every motor stands: which motor, and which input or bit of it.

    fault --> every motor stopped --> positions read back --> inputs of each PIC-STEP --> "motor X: its limit ..."

A chip that protects its motor says so with one bit; what the host notices of it first may be something else, such as an
axis that stands although it should move. One question a PIC-STEP is asked for this; a PIC-SERVO has told all of it with
its position: position error stays set until it is cleared (PIC-SERVO data sheet section 5.3).
"""

from __future__ import annotations

from collections.abc import Iterator

from machines.bringup import Connection, bus_of, drivers
from machines.troubles import Trouble, servo_troubles, stepper_troubles, words_of
from machines.wiring import motor_tables, motors, nmc_buses, servo_tables
from nmc.errors import NmcError
from nmc.picstep import PicStep
from planner.stream_error import StreamError


def explained(connection: Connection, error: NmcError | StreamError) -> str:
    """The words of ``error``, with what the chips tell: the motor that it is about first, then the others.

    Every motor must stand and its position must have been read. A module that does not answer is passed over.
    """
    found: dict[Trouble, list[str]] = {}
    meant = _motor_of(connection, error)
    for motor, trouble in sorted(_told(connection), key=lambda pair: pair[0] != meant):
        found.setdefault(trouble, []).append(motor)
    leading = [words_of(names, trouble) for trouble, names in found.items() if trouble.sure or meant in names]
    beside = [words_of(names, trouble) for trouble, names in found.items() if not (trouble.sure or meant in names)]
    if leading:
        return "; ".join([f"{'; '.join(leading)} ({error})", *beside])
    return "; ".join([named(connection, error), *beside])


def named(connection: Connection, error: BaseException) -> str:
    """The words of ``error``, with the motor that it is about if it names only a module."""
    words = str(error) or type(error).__name__
    meant = _motor_of(connection, error) if isinstance(error, NmcError) else ""
    return f"motor {meant}: {words}" if meant else words


def require_sound(connection: Connection) -> None:
    """Raise RemoteFault if what a motor's chip has told last is a fault: one that rests is not asked in a stream."""
    for driver in drivers(connection).values():
        tracker = driver.bus.guard.modules[driver.address]
        fault = None if tracker.status is None else tracker.judge(tracker.status)
        if fault is not None:
            fault.bus = driver.bus.name
            raise fault


def _told(connection: Connection) -> Iterator[tuple[str, Trouble]]:
    """Every motor with what its chip tells."""
    for name, (_, servo) in servo_tables(connection.config).items():
        status = bus_of(connection, servo.bus).guard.modules[servo.address].status
        for trouble in () if status is None else servo_troubles(status):
            yield name, trouble
    for name, (_, step) in motor_tables(connection.config).items():
        try:
            told = PicStep(bus_of(connection, step.bus), step.address).read_status("inputs")
        except NmcError:
            continue
        heeds = step.step
        troubles = stepper_troubles(told.byte, told.values["inputs"], estop=heeds.estop, limits=heeds.limit_autostop)
        for trouble in troubles:
            yield name, trouble


def _motor_of(connection: Connection, error: NmcError | StreamError) -> str:
    """The motor that an error is about, "" if it names none."""
    if isinstance(error, StreamError):
        return error.axis
    buses = list(nmc_buses(connection.config))
    driven = [motor for motor in motors(connection.config) if motor.address == error.address]
    meant = [motor.name for motor in driven if error.bus in ("", buses[motor.bus])]
    return meant[0] if len(meant) == 1 else ""
