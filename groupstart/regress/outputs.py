"""What a suite's run leaves for machines: JSON, and JUnit XML as CI systems read it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from groupstart.regress.case import Result
from groupstart.regress.compare import Difference


@dataclass(frozen=True, slots=True)
class Outcome:
    """A case and what changed in it; nothing: it passed."""

    result: Result
    differences: tuple[Difference, ...]

    @property
    def ok(self) -> bool:
        """Whether it is as in the baseline."""
        return not self.differences


def as_json(suite: str, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """``suite, ok, cases [{job, machine, ok, differences, digests, plan_time_s}]``."""
    cases = []
    for outcome in outcomes:
        fields = dict(outcome.result.fields)
        cases.append({
            "job": outcome.result.job,
            "machine": outcome.result.machine,
            "ok": outcome.ok,
            "fault": outcome.result.fault,
            "differences": [asdict(difference) for difference in outcome.differences],
            "digests": {name: fields.get(f"{name}.digest", "") for name in ("program", "exchanges", "trace")},
            "plan_time_s": float(fields.get("plan.time_s", 0.0)),
        })  # fmt: skip
    return {"suite": suite, "ok": all(outcome.ok for outcome in outcomes), "cases": cases}


def as_junit(suite: str, outcomes: Sequence[Outcome]) -> str:
    """JUnit XML: a class for each machine, a test for each job, a failure with all differences."""
    bad = sum(not outcome.ok for outcome in outcomes)
    root = ET.Element("testsuites", tests=str(len(outcomes)), failures=str(bad))
    tests = ET.SubElement(root, "testsuite", name=suite, tests=str(len(outcomes)), failures=str(bad), errors="0")
    for outcome in outcomes:
        result = outcome.result
        case = ET.SubElement(tests, "testcase", classname=f"{suite}.{result.machine}", name=result.job)
        if not outcome.ok:
            lines = [difference.text() for difference in outcome.differences]
            failure = ET.SubElement(case, "failure", message=_plain(lines[0]))
            failure.text = _plain("\n".join(lines))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _plain(text: str) -> str:
    """Without the control characters that XML cannot hold."""
    return "".join(c if c in "\n\t" or ord(c) >= 32 else "?" for c in text)
