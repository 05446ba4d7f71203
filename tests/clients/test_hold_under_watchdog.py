"""Hold and overrides on a port under a watchdog of 50 ms: timing anew is no silence."""

from __future__ import annotations

from pathlib import Path

import pytest

from groupstart.api import plan
from machines.control import Script
from machines.runner import RunOptions, perform
from nmc.watchdog_process import SupervisedLink

pytestmark = pytest.mark.clients

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = "G21 G90 G64 P0.05 F1200\nG1 X30 Y8 Z-5\nG1 X2 Y30 Z-1\nG1 X40 Y12 Z-9\nG1 X0 Y0 Z0\nM2\n"
WORDS = [(0.5, "feed 80"), (0.9, "feed 60"), (1.3, "feed 120"), (1.7, "hold"), (2.4, "resume"), (2.9, "feed 100")]


@pytest.mark.parametrize("profile", ["adaptive", "group"])
def test_hold_and_overrides_do_not_trip_a_watchdog_of_50_ms(
    device: str, profile: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job, machine = tmp_path / "job.nc", tmp_path / "machine.toml"
    job.write_text(PROGRAM)
    text = (ROOT / "machines" / "data" / "mill3-step.toml").read_text()
    machine.write_text(text.replace("[bus.main]", "[bus.main]\nwatchdog_ms = 50"))
    gaps_ms: list[float] = []
    last_ns = 0
    beat = SupervisedLink.beat

    def heard(link: SupervisedLink) -> None:
        nonlocal last_ns
        now_ns = link.now_ns()
        if link._armed and last_ns:
            gaps_ms.append((now_ns - last_ns) / 1e6)
        last_ns = now_ns if link._armed else 0
        beat(link)

    monkeypatch.setattr(SupervisedLink, "beat", heard)
    read = plan(job, str(machine))
    result = perform(
        read.job, read.plan, read.machine, RunOptions(port=device, profile=profile, control=Script(list(WORDS)))
    )
    assert not result.fault
    assert result.verdict is not None
    assert result.verdict.ok, result.verdict.reasons
    assert len(result.verdict.holds) == 1
    print(f"longest gaps between heartbeats: {[round(gap, 1) for gap in sorted(gaps_ms)[-4:]]} ms")
