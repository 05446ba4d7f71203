"""What pages are made of: thinning, blocks, quantities over the path, limits, digests, servo arithmetic."""

import base64
import gzip
import itertools
import json
import re

import numpy as np
import pytest

from gcode.setup import Setup
from groupstart.report.blocks import Block, json_block, text_block
from groupstart.report.busview import BusWatch
from groupstart.report.clocks import clocks
from groupstart.report.digest import exchanges_digest, trace_digest
from groupstart.report.limits import broken_limits, parse_limits
from groupstart.report.measured import measured_pins, shifts, steps_of
from groupstart.report.pathcolumns import FEED, RAPID, causes_of, path_columns
from groupstart.report.pathpage import OverPath
from groupstart.report.preview import columns_in_windows, columns_of_plan
from groupstart.report.servo import pwm_of, servo_views
from groupstart.report.skew import starts
from groupstart.report.thin_kernel import thin
from groupstart.report.zmap import height_maps
from machines.job import Job, plan_job, read_job
from machines.load import MachineFile, read_machine
from machines.runner import RunOptions, RunResult, perform
from planner.plan import Plan
from sim.build import Simulation

PROGRAM = "G21 G90 G64 P0.01\nG0 X0 Y0 Z1\nG1 X6 F1200\nG2 X10 Y4 I0 J4\nG1 Y8\nG0 Z0\nM2\n"


def planned(text: str, machine: str = "mill3-step") -> tuple[Job, Plan, MachineFile]:
    file = read_machine(machine)
    job = read_job(text, Setup(file="part.nc"), file.config)
    assert not job.errors
    return job, plan_job(job, file.config), file


def unpacked(html: str, name: str) -> dict[str, np.ndarray]:
    """A block as the page's script decodes it, written again in Python."""
    manifest = json.loads(re.search(rf'id="{name}-manifest">(.*?)</script>', html).group(1))
    packed = re.search(rf'octet-stream" id="{name}">(.*?)</script>', html).group(1)
    data = np.frombuffer(gzip.decompress(base64.b64decode(packed)), np.uint8)
    found, at = {}, 0
    for entry in manifest:
        n = entry["length"]
        planes = data[at : at + 4 * n].reshape(4, n).astype(np.int64)
        folded = planes[0] + (planes[1] << 8) + (planes[2] << 16) + (planes[3] << 24)
        found[entry["name"]] = np.cumsum(np.where(folded % 2, -(folded + 1) // 2, folded // 2)) * entry["unit"]
        at += 4 * n
    assert at == len(data)
    return found


def test_thinning_keeps_every_sample_within_the_tolerances() -> None:
    rng = np.random.default_rng(3)
    t = np.cumsum(rng.uniform(0.001, 0.01, 4000))
    q = np.column_stack([np.cos(t), np.sin(t), 0.1 * t])
    speed = 1 + 0.5 * np.sin(3 * t)
    key = np.repeat(np.arange(8), 500)[: len(t) - 1]
    kept = thin(t, q, speed, key, 1e-3, 0.02)
    assert kept[0] == 0
    assert kept[-1] == len(t) - 1
    assert len(kept) < len(t) / 4
    for first, last in itertools.pairwise(kept):
        assert len(np.unique(key[first:last])) == 1
        chord = q[last] - q[first]
        off = q[first:last] - q[first]
        along = np.clip(off @ chord / (chord @ chord), 0, 1)
        assert np.linalg.norm(off - along[:, None] * chord, axis=1).max() <= 1e-3 + 1e-12
        share = (t[first:last] - t[first]) / (t[last] - t[first])
        assert np.abs(speed[first:last] - speed[first] - share * (speed[last] - speed[first])).max() <= 0.02 + 1e-12


def test_columns_tell_kind_feed_tool_line_and_cause() -> None:
    _, plan, _ = planned("G21 G90 G64 P0.01\nT3 M6\nG0 X20\nG1 X50 F600\nG4 P0.5\nM2\n")
    columns = columns_of_plan(plan)
    s, causes = columns.stretches, causes_of("XYZ")
    assert columns.causes == causes
    middle = 0.5 * (s.t_s[:-1] + s.t_s[1:])
    cruise = (s.kind == FEED) & (np.abs(s.v[:-1, 0] - 10) < 1e-6) & (np.abs(s.v[1:, 0] - 10) < 1e-6)
    assert cruise.any()
    assert {causes[c] for c in s.cause[cruise]} == {"programmed feed"}
    assert s.feed_mm_s[cruise] == pytest.approx(10)
    assert set(s.line[s.kind == RAPID]) == {3}
    assert set(s.line[s.kind == FEED]) == {4}
    assert set(s.tool[s.kind == FEED]) == {3}
    fast = (s.kind == RAPID) & (np.abs(s.v[:-1, 0] - 60) < 1e-6) & (np.abs(s.v[1:, 0] - 60) < 1e-6)
    assert {causes[c] for c in s.cause[fast]} <= {"X velocity", "programmed feed"}
    rest = middle > plan.trajectory.duration_s - 0.4
    assert {causes[c] for c in s.cause[rest]} == {"at rest"}
    assert s.q[-1] == pytest.approx([50, 0, 0], abs=1e-9)


def test_windows_give_the_columns_of_the_whole_plan() -> None:
    rows = "".join(f"G1 X{20 + 10 * np.cos(k / 40):.4f} Y{20 + 10 * np.sin(k / 40):.4f}\n" for k in range(900))
    job, plan, machine = planned("G21 G90 G64 P0.01 F1200\nG0 X30 Y20\n" + rows + "M2\n")
    whole, parts = columns_of_plan(plan), columns_in_windows(job, machine)
    assert parts.duration_s == pytest.approx(whole.duration_s, rel=1e-6)
    assert parts.low == pytest.approx(whole.low, abs=1e-6)
    at = np.linspace(0, whole.duration_s, 500)
    for k in range(3):
        one = np.interp(at, whole.stretches.t_s, whole.stretches.q[:, k])
        other = np.interp(at, parts.stretches.t_s, parts.stretches.q[:, k])
        assert one == pytest.approx(other, abs=0.02)


def test_a_small_limit_of_samples_is_held_with_a_tolerance_that_is_told() -> None:
    _, plan, _ = planned(PROGRAM)
    few = path_columns([(0.0, plan.trajectory)], plan.limits, 40, plan.trajectory.duration_s)
    assert len(few.stretches) <= 40
    assert few.tolerance_mm > 1e-3
    assert few.stretches.q[-1] == pytest.approx(plan.trajectory.q(np.array([plan.trajectory.duration_s]))[0])


@pytest.mark.parametrize("values", [[], [0.0], [3.0, -1e6, 1e6, 0.25], np.sin(np.arange(500) / 9)])
def test_blocks_come_back_as_they_went_in(values: list[float]) -> None:
    block = Block("b")
    block.add("x", np.array(values), 1e-4)
    block.add("again", np.array(values), 1e-4)
    found = unpacked(block.html(), "b")
    unit = max(1e-4, float(np.abs(values).max(initial=0.0)) / 2**29)
    for name in ("x", "again"):
        assert found[name] == pytest.approx(np.array(values), abs=unit)


def test_no_text_of_a_program_can_end_an_element() -> None:
    nasty = "</script><script>alert(1)</script>"
    assert "</script><script>" not in json_block("j", {"job": nasty})
    assert "alert" not in text_block("t", nasty)


def test_the_largest_value_of_a_stretch_is_laid_over_it() -> None:
    _, plan, _ = planned(PROGRAM)
    s = columns_of_plan(plan).stretches
    t = np.linspace(0, s.t_s[-1], 5000)
    values = np.abs(np.sin(40 * t))
    over = OverPath(("e",), t, values[:, None], (1e-3,)).over(s)["e"]
    for k in range(0, len(over), 17):
        inside = values[(t >= s.t_s[k]) & (t <= s.t_s[k + 1])]
        assert over[k] == pytest.approx(inside.max() if len(inside) else 0.0)


def run(text: str, machine: str = "mill3-step", **options: object) -> tuple[RunResult, MachineFile]:
    job, plan, file = planned(text, machine)
    return perform(job, plan, file, RunOptions(port="sim", **options)), file  # type: ignore[arg-type]


def test_digests_are_equal_for_equal_runs_and_differ_for_another_seed() -> None:
    (one, _), (same, _), (other, _) = run(PROGRAM, seed=5), run(PROGRAM, seed=5), run(PROGRAM, seed=6)
    assert one.trace is not None
    assert same.trace is not None
    assert other.trace is not None
    assert exchanges_digest(one.trace) == exchanges_digest(same.trace)
    assert trace_digest(one.trace) == trace_digest(same.trace)
    assert exchanges_digest(one.trace) != exchanges_digest(other.trace)
    assert trace_digest(one.trace) != trace_digest(other.trace)


def test_a_slip_is_found_with_axis_size_and_line() -> None:
    text = "G21 G90 G64 P0.01 F1200\nG1 X20\nG1 Y20\nG1 X0\nG1 Y0\nG1 X20\nG1 Y20\nG1 X0\nG1 Y0\nM2\n"
    slipped = []

    def disturb(simulation: Simulation, evidence: object) -> None:
        if getattr(evidence, "exchange").line >= 6 and not slipped:  # noqa: B009
            slipped.append(True)
            simulation.steppers()["Y"].lose_steps(4)

    result, file = run(text, disturb=disturb)
    assert result.verdict is not None
    assert not result.verdict.ok
    assert result.verdict.end_error_steps == {"X": 0, "Y": 4, "Z": 0}
    measured = measured_pins(file.config, result, result.plan.trajectory)
    assert measured is not None
    assert measured.error_um.max() > 15
    (shift,) = shifts(measured, result.plan.trajectory, steps_of(file.config))
    assert (shift.axis, shift.line) == ("Y", 6)
    assert shift.um == pytest.approx(20, abs=5)
    assert shift.steps == pytest.approx(4, abs=1)


def test_no_shift_where_nothing_was_lost() -> None:
    result, file = run(PROGRAM)
    measured = measured_pins(file.config, result, result.plan.trajectory)
    assert measured is not None
    assert shifts(measured, result.plan.trajectory, steps_of(file.config)) == []


def test_pwm_from_the_trace_is_that_of_the_simulated_chip() -> None:
    seen: list[float] = []

    def disturb(simulation: Simulation, _evidence: object) -> None:
        chip = simulation.servos()["X"]
        chip.synchronise()
        seen.append(abs(int(chip.n[37])))  # PWM, see sim/servokernel.py

    result, file = run("G21 G90 F600\nG1 X3\nM2\n", "mill3-servo", disturb=disturb)
    assert result.trace is not None
    view = servo_views(file.config, result.trace)[0]
    assert view.pwm is not None
    ours = np.rint(np.abs(view.pwm) * 255)
    assert max(seen) > 20
    # every level that the chip was seen at while it moved stands in the series as well
    missing = set(seen) - set(ours.tolist()) - {0}
    assert len(missing) <= 1
    assert ours.max() == pytest.approx(max(seen), abs=20)


def test_pwm_is_the_formula_of_the_data_sheet() -> None:
    gains = read_machine("mill3-servo").config.axis["X"].servo  # type: ignore[union-attr]
    assert (gains.kp, gains.kd, gains.ki) == (220, 2640, 150)
    error = np.array([0, 4, 4, -2], dtype=np.int64)
    # section 4.3: KP e + KD (e - e') + KI (sum >> 8), over 256; the sums 0, 4, 8, 6 are below 256 here
    output = [0, 220 * 4 + 2640 * 4, 220 * 4, 220 * -2 + 2640 * -6]
    assert pwm_of(error, gains) * 255 == pytest.approx([np.sign(o) * (abs(o) >> 8) for o in output])


def test_crystals_are_read_from_the_trace() -> None:
    drawn: dict[str, float] = {}

    def disturb(simulation: Simulation, _evidence: object) -> None:
        drawn.update({name: module.clock.ppb / 1000 for name, module in simulation.modules.items()})

    result, file = run("G21 G90 G64 P0.01 F1200\nG1 X20 Y10\nG1 Z3\nM2\n", "mill3-mixed", disturb=disturb)
    assert result.trace is not None
    found = {c.name: c.crystal_ppm for c in clocks(file.config, result.trace, 1.0)}
    assert set(found) == {"X", "Y", "Z"}
    assert any(abs(ppm) > 5 for ppm in drawn.values())
    for name, ppm in found.items():
        assert ppm == pytest.approx(drawn[name], abs=2)


def test_motors_that_begin_together_are_held_against_the_plan() -> None:
    result, file = run("G21 G90 G61.1 F600\nG1 X5 Y5\nG4 P0.5\nG1 X0\nG4 P0.5\nG1 X5 Y0\nM2\n")
    assert result.trace is not None
    found = starts(file.config, result.trace, result.plan.trajectory)
    assert [start.motors for start in found] == [("X", "Y"), ("X", "Y")]
    for start in found:
        assert 0 <= start.skew_ms < 5


def test_the_bus_is_never_busier_than_all_of_the_time() -> None:
    watch = BusWatch()
    result, _ = run(PROGRAM, watch=watch.watch)
    assert result.outcome is not None
    view = watch.view(result.outcome.plan_start_ns)
    assert len(view) == result.outcome.statistics.packets
    assert np.all(np.diff(view.begin_s) >= 0)
    assert np.all(view.end_s > view.begin_s)
    t, share = view.utilisation(result.plan.trajectory.duration_s, 50)
    assert len(t) == 50
    assert share.min() >= 0
    assert share.max() <= 1
    inside = (view.begin_s >= 0) & (view.end_s <= result.plan.trajectory.duration_s)
    busy = float((view.end_s - view.begin_s)[inside].sum())
    assert share.mean() * result.plan.trajectory.duration_s == pytest.approx(busy, rel=0.02)


def test_a_height_map_is_as_deep_as_the_tool_went_and_as_wide_as_it_is() -> None:
    result, file = run("G21 G90 G64 P0.01 F600\nG0 X5 Y5 Z1\nG1 Z-1\nG1 X15\nG0 Z1\nM2\n")
    measured = measured_pins(file.config, result, result.plan.trajectory)
    assert measured is not None
    s = columns_of_plan(result.plan).stretches
    maps = height_maps(measured, s.q, s.q[1:-1], 4.0)
    assert maps is not None
    assert maps.top_mm == 0
    assert maps.planned.min() == pytest.approx(-1, abs=0.01)
    assert maps.simulated.min() == pytest.approx(-1, abs=0.011)
    area = float((maps.planned < -0.5).sum()) * maps.cell_mm**2
    assert area == pytest.approx(10 * 4 + np.pi * 4, rel=0.02)
    assert maps.excess_mm3 + maps.left_mm3 < 1


def test_limits_are_read_and_told() -> None:
    assert parse_limits("contour_um=20, late_slices=0") == {"contour_um": 20.0, "late_slices": 0.0}
    for wrong in ("contour", "size=3", "contour_um=wide"):
        with pytest.raises(ValueError, match=wrong.split("=", maxsplit=1)[0]):
            parse_limits(wrong)
    result, _ = run(PROGRAM)
    assert result.verdict is not None
    assert broken_limits(result.verdict, {"contour_um": 1000.0, "late_slices": 0.0}) == ()
    (reason,) = broken_limits(result.verdict, {"contour_um": 0.1})
    assert "contour_um" in reason
    assert "0.1" in reason
