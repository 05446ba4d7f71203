"""The Python API: plan a program, run it on the machine's twin, and look at what came out."""

from groupstart import check, plan, verify

PROGRAM = """
G21 G90 G64 P0.01
G0 X10 Y10
G1 X40 F1800 (a rounded square)
G3 X50 Y20 I0 J10
G1 Y40
G3 X40 Y50 I-10 J0
G1 X10
G3 X0 Y40 I0 J-10
G1 Y20
G3 X10 Y10 I10 J0
G0 X0 Y0
M2
"""

for diagnostic in check(PROGRAM, "mill3-step"):
    print(diagnostic.text())

planned = plan(PROGRAM, "mill3-step")
print(f"planned: {planned.plan.trajectory.duration_s:.2f} s")

result = verify(PROGRAM, "mill3-step", seed=3)
assert result.verdict is not None, result.fault
assert result.trace is not None
print(f"simulated: {result.verdict.sim_time_s:.2f} s, {result.trace.run_count.sum()} steps")
print(f"contour error: {result.verdict.contour_um.max:.1f} um, end error {result.verdict.end_error_steps}")
assert result.verdict.ok
