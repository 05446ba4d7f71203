"""From a finished run to its verdict: the twin's trace against the plan, the chips' counters against the end."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from machines.lags import lag_use
from machines.outcome import Outcome
from machines.schema import MachineConfig
from machines.shafts import ShaftUse, end_counts, shaft_limits_um, shafts_off_um
from machines.verdict import BusUse, HostUse, Peak, Spread, Verdict, reasons_against
from machines.wiring import SERVO_STANDS_WITHIN, command_leads_ns, every_motor, scale_of
from planner.plan import Plan
from planner.planfile import sample_times
from planner.quantize import nearest_step
from planner.types import Trajectory
from sim.compare import Contour, Reference, compare_pins
from sim.compare import Spread as SimSpread
from sim.pulses import Pins, ServoTrack, StepRuns, pins
from sim.trace import Trace

F8 = npt.NDArray[np.float64]
NS_PER_S = 1_000_000_000
EARLY_NS = 30_000_000
"""A first step may come a little before t = 0; so long before it nothing has moved since the counters were read."""


def judge(
    config: MachineConfig,
    plan: Plan,
    outcome: Outcome,
    trace: Trace | None,
    violations: Mapping[str, int],
    programmed: F8 | None = None,
) -> Verdict:
    """The verdict of a run. ``trace``: of the twin, None on real ports; ``programmed``: polyline f8[M, A] or None."""
    trajectory = plan.trajectory
    contour, shaft = None, None
    off_um: dict[str, float] = {}
    if trace is not None:
        reference = reference_of(trajectory, programmed)
        contour, shaft = _contours(config, reference, outcome, trace)
        off_um = shafts_off_um(trace, config, reference)
    end_error = _end_error(config, trajectory, outcome) if contour is None else contour.end_error_steps
    steps = None if contour is None else _spread(contour.contour_steps)
    sim_time_s = None if contour is None else contour.sim_time_s
    shafts = _shaft_use(config, trajectory, outcome, off_um)
    reasons = reasons_against(
        config.verify,
        plan_time_s=trajectory.duration_s,
        sim_time_s=sim_time_s,
        contour_steps=steps,
        end_error_steps=end_error,
        violations=violations,
        unheeded=outcome.statistics.unheeded,
        shafts=shafts,
    )
    return Verdict(
        ok=not reasons,
        machine=config.machine.name,
        axes=tuple(trajectory.axes),
        plan_time_s=trajectory.duration_s,
        sim_time_s=sim_time_s,
        contour_um=None if contour is None else _spread(contour.contour_um),
        contour_steps=steps,
        motor_contour_um=None if shaft is None else _spread(shaft.contour_um),
        program_um=None if contour is None or programmed is None else contour.program_um,
        lag_ms=None if contour is None else (contour.lag_ms_max, contour.lag_ms_rms),
        end_error_steps=end_error,
        worst_line=None if contour is None else contour.worst_line,
        late_slices=outcome.statistics.late_slices,
        violations=dict(violations),
        bus=_bus_use(outcome),
        peak={axis: Peak(found.velocity, found.acceleration, found.jerk) for axis, found in plan.report.axes.items()},
        limits={
            axis: Peak(table.max_velocity, table.max_acceleration, table.max_jerk)
            for axis, table in config.axis.items()
        },
        reasons=reasons,
        holds=outcome.holds,
        host=_host_use(outcome),
        shafts=shafts,
        lags=None if contour is None else lag_use(contour),
        shaft_lags=None if shaft is None else lag_use(shaft),
        shaft_program_um=None if shaft is None or programmed is None else shaft.program_um,
    )


def reference_of(trajectory: Trajectory, programmed: F8 | None = None) -> Reference:
    """The plan as ``sim.compare`` wants it: samples at most 1 ms apart and at every junction."""
    t_s = sample_times(trajectory)
    return Reference(tuple(trajectory.axes), t_s, trajectory.q(t_s), trajectory.line(t_s), programmed)


def step_runs(trace: Trace) -> StepRuns:
    """The pulses of a trace."""
    return StepRuns(
        trace.run_axis,
        trace.run_first_ns,
        trace.run_period_ns,
        trace.run_count,
        trace.run_dir,
        trace.start_steps,
    )


def trace_pins(
    trace: Trace,
    begins_at: Mapping[str, int],
    servo_counts: npt.NDArray[np.int32] | F8,
    lead_ns: Mapping[str, int] | None = None,
) -> Pins:
    """Where the motors stood, in the counters that held when the run began.

    Homing sets a stepper's counter to zero on the way, which its pulses do not show: the counter that was read back
    before the run says where the pulses stand. ``servo_counts``: [S], command or shaft of the servo samples. Of whole
    counts (i4) the truth lies half a count above on average while they change; f8 is the truth. ``lead_ns``: by motor,
    how much before its time a command is given (``lag_ms`` of the machine file): it is taken at the instant it is
    meant for.
    """
    lead_ns = lead_ns or {}
    tracks = []
    for motor in np.flatnonzero(np.bincount(trace.servo_axis)):
        mine = trace.servo_axis == motor
        counts = servo_counts[mine]
        if counts.dtype.kind == "i":
            counts = counts + 0.5 * (np.diff(counts, prepend=counts[0]) != 0)
        meant_ns = trace.servo_ns[mine] + lead_ns.get(trace.axes[int(motor)], 0)
        tracks.append(ServoTrack(int(motor), meant_ns, counts))
    found = pins(step_runs(trace), tracks)
    at = int(np.searchsorted(found.time_ns, trace.plan_start_ns - EARLY_NS))
    stood = found.position[at - 1] if at else trace.start_steps.astype(np.float64)
    shift = np.zeros(len(trace.axes))
    for number, name in enumerate(trace.axes):
        if number not in trace.servo_axis and name in begins_at:
            shift[number] = begins_at[name] - stood[number]
    position = found.position
    position += shift
    for motor, time_ns, steps in zip(trace.slip_axis, trace.slip_ns, trace.slip_steps, strict=True):
        position[found.time_ns >= time_ns, motor] += steps  # the motor slipped, its counter does not know
    return Pins(found.time_ns, position, found.straight)


def _contours(
    config: MachineConfig, reference: Reference, outcome: Outcome, trace: Trace
) -> tuple[Contour, Contour | None]:
    """What was commanded against the plan, and of a machine with servos also where the shafts were."""
    by_name = {motor.name: motor for motor in every_motor(config)}
    names = trace.axes
    followed = tuple(by_name[name].axis for name in names)
    scale = np.array([scale_of(by_name[name]) for name in names])

    def against(servo_counts: npt.NDArray[np.int32] | F8, lead_ns: Mapping[str, int] | None = None) -> Contour:
        out = trace_pins(trace, outcome.begins_at, servo_counts, lead_ns)
        return compare_pins(reference, out, names, followed, scale, outcome.plan_start_ns)

    shaft = against(trace.servo_position) if len(trace.servo_axis) else None
    return against(trace.commanded, command_leads_ns(config)), shaft


def _wanted(config: MachineConfig, trajectory: Trajectory) -> dict[str, int]:
    """Where the plan ends, in steps or counts of every motor."""
    end = trajectory.q(np.array([trajectory.duration_s]))[0]
    return {
        motor.name: nearest_step(float(end[trajectory.axes.index(motor.axis)]), scale_of(motor))
        for motor in every_motor(config)
    }


def _end_error(config: MachineConfig, trajectory: Trajectory, outcome: Outcome) -> dict[str, int]:
    """As the chips tell: of steppers their counters, of servos their commands, for these are exact and shafts are not.

    A servo that was last told to move on has no exact place: its shaft must then do.
    """
    ends = outcome.positions | outcome.commanded
    return {name: ends[name] - wanted for name, wanted in _wanted(config, trajectory).items()}


def _shaft_use(
    config: MachineConfig, trajectory: Trajectory, outcome: Outcome, off_um: dict[str, float]
) -> ShaftUse | None:
    if not outcome.shafts:
        return None
    return ShaftUse(
        end_counts(outcome.shafts, _wanted(config, trajectory)),
        SERVO_STANDS_WITHIN,
        off_um,
        shaft_limits_um(config),
    )


def _bus_use(outcome: Outcome) -> BusUse:
    statistics = outcome.statistics
    span_ns = max(outcome.end_ns - outcome.plan_start_ns, 1)
    return BusUse(
        packets=statistics.packets,
        bytes=statistics.bytes,
        utilisation=min(statistics.busy_ns / span_ns, 1.0),
        slice_ms=statistics.slice_ms,
    )


def _host_use(outcome: Outcome) -> HostUse:
    statistics = outcome.statistics
    return HostUse(
        delay_p99_ms=statistics.host_delay_p99_ms,
        delay_max_ms=statistics.host_delay_max_ms,
        late_exchanges=statistics.late_exchanges,
        least_speed_percent=round(100 * statistics.least_speed, 1),
        unheeded=statistics.unheeded,
        strain_steps=None if statistics.strain_steps is None else round(statistics.strain_steps, 2),
    )


def _spread(spread: SimSpread) -> Spread:
    return Spread(spread.max, spread.p999, spread.rms)
