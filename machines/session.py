"""What a machine is doing: one state machine from power-up to the verdict. ``verify`` and ``run`` share all of it.

                                              held
                                             |    ^
                                        resume    hold
                                             v    |
    idle --home--> homing --> idle --run--> running --> idle
                      \\                     |  \\--stop--> stopped
                       \\--------------------+----fault--> faulted

Whatever goes wrong while something moves, the first thing done is to stop every motor and to read where it stands;
only then is the caller told. A stop is asked for by a function that is polled between two exchanges, never by an
exception in the middle of one; so are hold, resume and override (``machines.control``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum
from functools import partial
from typing import Any

import numpy as np

from machines import bringup
from machines.aftermath import told_of
from machines.bringup import Connection
from machines.choice import Choice, choose
from machines.control import Control
from machines.crystals import calibrated
from machines.cy545 import stand_ins
from machines.cy545_homing import home_indexer
from machines.diagnosis import explained, named, require_sound
from machines.homing import Homed, home_servo, home_stepper
from machines.hostdelay import host_delay_ns
from machines.indexing import IndexingSource, Yard, has_index_moves
from machines.outcome import Outcome
from machines.profiles import choose_profile
from machines.schema import Cy545Axis, MachineConfig, ServoMotorTable, StepMotorTable
from machines.settling import settle
from machines.several import bus_streams, timings_of
from machines.strain import Strain
from machines.streaming import Onlookers, RunSource, stream
from machines.wiring import bus_timing, every_motor, indexers, motors, scale_of, servo_tables, stands_within
from nmc.errors import NmcError
from nmc.picservo import PicServo
from nmc.picstep import PicStep
from nmc.program import Evidence
from planner.motors import ServoMotor
from planner.quantize import nearest_step
from planner.stream import Progress, StreamSource, lead_in_ns, make_source
from planner.stream_buses import BusStreams
from planner.stream_error import StreamError
from planner.types import Trajectory
from sim.build import Simulation

SETTLE_NS = 200_000_000

Note = Callable[..., None]
"""``note(event, time_ns, **fields)``: something happened."""


class State(Enum):
    """What the machine is doing."""

    IDLE = "idle"
    HOMING = "homing"
    RUNNING = "running"
    HELD = "held"
    STOPPED = "stopped"
    FAULTED = "faulted"


class SessionError(Exception):
    """The machine cannot do what was asked, or failed at it. ``positions``: counters read back, if they could be."""

    def __init__(self, message: str, positions: dict[str, int] | None = None) -> None:
        super().__init__(message)
        self.positions = positions


def _nothing(*_: Any, **__: Any) -> None:
    return None


def _never() -> bool:
    return False


class Session:
    """One machine on its links. Use it as a context: leaving it stops what still moves and closes the ports."""

    def __init__(
        self, config: MachineConfig, *, port: str | None = None, seed: int | None = None, note: Note | None = None
    ) -> None:
        self.config = config
        self.state = State.IDLE
        self.note: Note = note or _nothing
        self.watch: Callable[[Evidence], None] = _nothing
        """Told of every exchange of a run; set it before ``run``."""
        self._port, self._seed = port, seed
        self._connection: Connection | None = None

    @property
    def connection(self) -> Connection:
        """The open links. Raises SessionError before ``connect``."""
        if self._connection is None:
            raise SessionError("the machine is not connected")
        return self._connection

    @property
    def simulation(self) -> Simulation | None:
        """The twin, if the machine runs on it and is connected."""
        return self._connection.simulation if self._connection else None

    def records(self) -> dict[str, list[str]]:
        """Bytes of real ports as text, by bus."""
        return self._connection.records() if self._connection else {}

    @property
    def now_ns(self) -> int:
        """Time of the machine's link; 0 before it is connected."""
        return self._connection.links[0].now_ns() if self._connection else 0

    def __enter__(self) -> Session:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def connect(self) -> None:
        """Open the links and start every bus. Raises SessionError."""
        try:
            self._connection = bringup.connect(self.config, self._port, self._seed)
            self.expect(max(timing.jitter_max_ns for timing in timings_of(self._connection).values()))
            kept = bringup.bring_up(self._connection)
            if self._connection.rig is not None:
                self._connection.rig.tell = self.note
        except (NmcError, ValueError) as error:
            self._change(State.FAULTED)
            raise SessionError(f"the machine does not start: {error}") from error
        for bus, modules in self._connection.modules.items():
            found = [f"{module.address}: {module.chip} version {module.version}" for module in modules]
            self.note("connected", self.now_ns, bus=bus, modules=found, kept_positions=kept)
        for words in stand_ins(self.config):
            self.note("stand_in", self.now_ns, message=words)

    def where(self) -> dict[str, float]:
        """Machine position of every axis by its first motor, read back from the chips; mm or degrees."""
        counters = self._positions()
        found: dict[str, float] = {}
        for motor in every_motor(self.config):
            found.setdefault(motor.axis, counters[motor.name] / scale_of(motor))
        return found

    def choose(self, wanted: str) -> Choice:
        """The profile to stream with; on a port the host's delays may be measured for that.

        Raises SessionError for one that this machine does not offer.
        """
        servos = {motor.bus: motor.address for motor in motors(self.config) if isinstance(motor, ServoMotor)}
        try:
            simulated = self.simulation is not None
            found = choose(self.config, wanted, simulated, lambda: host_delay_ns(self.connection, servos))
        except (NmcError, ValueError) as error:
            self._change(State.FAULTED)
            raise SessionError(str(error)) from error
        for words in found.notes:
            self.note("profile_chosen", self.now_ns, profile=found.profile, message=words)
        return found

    def run(
        self,
        trajectory: Trajectory,
        *,
        profile: str = "auto",
        progress: Callable[[Progress], None] | None = None,
        stop_requested: Callable[[], bool] = _never,
        control: Control | None = None,
        fit_bus: bool = False,
    ) -> Outcome:
        """Stream a trajectory to its end or to a requested stop. Raises SessionError after stopping everything.

        ``control``: hold, resume, override. They need a trajectory that can be timed anew (``planner.retime``); so
        does slowing down for a host that takes longer than was assumed of it, and, with ``fit_bus``, for a bus that
        cannot follow.
        """
        if self.state is not State.IDLE:
            raise SessionError(f"the machine is {self.state.value}, not idle")
        self._change(State.RUNNING)
        source: RunSource | BusStreams | None = None
        strain = Strain(self.config.verify.contour_steps, fit_bus)
        onlookers = Onlookers(progress or _nothing, self.watch, stop_requested, control or Control())
        try:
            begins_at = self._positions()
            require_sound(self.connection)
            self._require_start(trajectory, begins_at)
            bringup.park(self.connection)
            with bringup.quiet(self.connection):  # before the source, which fixes when the motion begins
                source = self._source(trajectory, profile)
                with bringup.armed(self.connection):
                    streamed = stream(source, self.connection, self, onlookers, strain)
                    if streamed.last is None:
                        self._settle(streamed.commanded)
                        self.note("run_ends", self.now_ns)
                    else:
                        self.note("stop_requested", self.now_ns, line=streamed.last.exchange.line)
                        self.stop()
            end_ns = self.now_ns
            positions = self._positions()
            if streamed.last is None:
                require_sound(self.connection)
        except (NmcError, StreamError, ValueError) as error:
            line = source.progress().line if source else 0
            raise self._failed(error, f"line {line}: " if line else "") from error
        except BaseException as error:
            self._failed(error)
            raise
        statistics = streamed.statistics
        statistics.slice_ms = self._slice_ms(statistics.loads, end_ns - source.plan_start_ns)
        self._change(State.IDLE if streamed.last is None else State.STOPPED)
        return Outcome(
            finished=streamed.last is None,
            plan_start_ns=source.plan_start_ns,
            end_ns=end_ns,
            line=source.progress().line,
            positions=positions,
            begins_at=begins_at,
            statistics=statistics,
            holds=streamed.holds,
            retimed=streamed.retimed,
            commanded=streamed.commanded,
            shafts={name: positions[name] for name in servo_tables(self.config)},
            switched=tuple(self.connection.rig.said) if self.connection.rig is not None else (),
        )

    def _slice_ms(self, loads: int, span_ns: int) -> float:
        """Mean time between two loads of one motor, whatever profile they belong to."""
        return max(span_ns, 0) * len(motors(self.config)) / loads / 1e6 if loads else 0.0

    def hold(self, request: str, ask: Callable[[str], bool]) -> None:
        """Wait at rest until ``ask(request)`` answers. Raises SessionError if it says no."""
        self._change(State.HELD)
        self.note("waiting", self.now_ns, request=request)
        if not ask(request):
            self._change(State.STOPPED)
            raise SessionError(f"{request}: not confirmed, the program ends here", self._positions())
        self._change(State.IDLE)

    def _require_start(self, trajectory: Trajectory, counters: dict[str, int]) -> None:
        """A stream begins on the very step where the machine stands, or not at all."""
        start = trajectory.q(np.zeros(1))[0]
        for motor in every_motor(self.config):
            wanted = nearest_step(float(start[trajectory.axes.index(motor.axis)]), scale_of(motor))
            off = counters[motor.name] - wanted
            if abs(off) > stands_within(motor):
                raise ValueError(f"motor {motor.name} stands {off:+d} steps from where the motion begins")

    def home(self, axes: Sequence[str]) -> list[Homed]:
        """Home axes one after another, in the order given. Raises SessionError after stopping everything."""
        if self.state is not State.IDLE:
            raise SessionError(f"the machine is {self.state.value}, not idle")
        self._change(State.HOMING)
        done: list[Homed] = []
        try:
            for axis in axes:
                self.note("homing", self.now_ns, axis=axis)
                with bringup.armed(self.connection):
                    homed = self._home_axis(axis)
                self.note("homed", self.now_ns, axis=axis, spread_steps=homed.spread_steps)
                done.append(homed)
        except (NmcError, ValueError) as error:
            raise self._failed(error, f"homing {axis}: ") from error
        except BaseException as error:
            self._failed(error)
            raise
        self._change(State.IDLE)
        return done

    def _home_axis(self, axis: str) -> Homed:
        chip = bringup.drivers(self.connection).get(axis)
        table = self.config.axis[axis]
        if any(extra.axis == axis for extra in self.config.motor.values()):
            raise ValueError("an axis with several motors cannot be homed yet")
        if isinstance(chip, PicStep) and isinstance(table, StepMotorTable):
            return home_stepper(self.config, axis, table, chip)
        if isinstance(chip, PicServo) and isinstance(table, ServoMotorTable):
            return home_servo(self.config, axis, table, chip)
        if isinstance(table, Cy545Axis):
            indexer = next(each for each in indexers(self.config) if each.axis == axis)
            return home_indexer(axis, table, indexer, self.connection.indexers[axis])
        raise ValueError("its chip cannot be homed yet")

    def stop(self) -> dict[str, int]:
        """Stop every motor at once; returns the counters read back. Raises SessionError if one cannot be stopped."""
        rounds, positions = self._stopped()
        self.note("all_stopped", self.now_ns, rounds=rounds, positions=positions)
        return positions

    def _stopped(self) -> tuple[int, dict[str, int]]:
        """Rounds of stops that it took, and where the motors then stand."""
        try:
            rounds = bringup.stop_everything(self.connection)
        except NmcError as error:
            self.state = State.FAULTED
            raise SessionError(told_of(self.connection, error)) from error
        return rounds, self._positions()

    def close(self) -> None:
        """Close the ports."""
        if self._connection is not None:
            self._connection.close()

    def _source(self, trajectory: Trajectory, profile: str) -> RunSource | BusStreams:
        driven = calibrated(self.config, self.connection.place)
        if len({motor.bus for motor in driven}) > 1:
            return bus_streams(self.connection, trajectory, profile, self.note)
        simulated = self.connection.simulation is not None
        timing = bus_timing(self.config, driven[0].bus, simulated)
        chosen = choose_profile(self.config, profile, simulated)
        self.note("profile", self.now_ns, profile=chosen)
        lead_ns = lead_in_ns(driven, timing)

        def make(stretch: Trajectory, start_ns: int) -> StreamSource:
            return make_source(
                stretch, driven, timing=timing, start_ns=start_ns, profile=chosen, alive=self.connection.alive
            )

        if not has_index_moves(trajectory):
            return make(trajectory, self.now_ns + lead_ns)
        connection = self.connection
        park = partial(bringup.park, connection)
        yard = Yard(connection.indexers, make, park, lead_ns, driven[0].address, driven[0].bus)
        return IndexingSource(trajectory, yard, self.now_ns + lead_ns)

    def stand(self, stands: bool) -> None:
        """A hold has brought the machine to rest, or a resume makes it run again."""
        self._change(State.HELD if stands else State.RUNNING)

    def expect(self, host_delay_ns: int) -> None:
        """The host may take so long before a packet leaves: after a command that nobody answers it is waited out."""
        for bus in self.connection.buses:
            bus.host_latency_ns = max(bus.host_latency_ns, host_delay_ns)

    def places(self) -> dict[str, float]:
        """As ``where``."""
        return self.where()

    def _settle(self, commanded: dict[str, int]) -> None:
        """A servo comes to rest a little after its command: give it time before it is asked where it stands.

        The twin tells of its shafts by itself (``machines.settling``), for which no byte has to be said.
        """
        if servo_tables(self.config):
            link = self.connection.links[0]
            link.sleep_until(link.now_ns() + SETTLE_NS)
            if self.connection.simulation is None:
                settle(self.connection, commanded)

    def _failed(self, error: BaseException, where: str = "") -> SessionError:
        """Bring everything to rest after a failure; what the caller is to be told of it, and of a stop that failed.

        A journal that cannot be written, on a full disk perhaps, holds up no stop. What the chips tell of the failure
        is asked for when all stands.
        """
        words = where + (named(self._connection, error) if self._connection else str(error))
        self.state = State.FAULTED
        self._note_if_possible("state", state=State.FAULTED.value)
        self._note_if_possible("fault", message=words)
        try:
            rounds, positions = self._stopped()
        except (NmcError, SessionError) as second:
            self._note_if_possible("fault", message=str(second))
            return SessionError(f"{words}; {second}")
        self._note_if_possible("all_stopped", rounds=rounds, positions=positions)
        if isinstance(error, NmcError | StreamError):
            words = where + explained(self.connection, error)
            self._note_if_possible("told", message=words)
        return SessionError(words, positions)

    def _note_if_possible(self, event: str, **fields: Any) -> None:
        with suppress(Exception):
            self.note(event, self.now_ns, **fields)

    def _positions(self) -> dict[str, int]:
        return bringup.read_positions(self.connection)

    def _change(self, state: State) -> None:
        self.state = state
        self.note("state", self.now_ns, state=state.value)
