"""Makes docs/conformance.md: runs every test that is marked with data-sheet statements and writes what came of it.

    python tests/datasheet/conformance.py          run the tests and write the page
    python tests/datasheet/conformance.py --check  the same, but only say whether the page is still true (exit 1: not)

A statement is held if at least one test shows it and all tests that show it pass; it is not applicable if
``not_applicable.tsv`` gives a reason; otherwise it is not held.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PAGE = ROOT / "docs" / "conformance.md"
SHEETS = {
    "N": "NMC bus, both chips",
    "ST": "PIC-STEP",
    "SV": "PIC-SERVO and PIC-ENC",
    "CY": "CY545, chapter 5 of its manual",
    "CE": "CY545, other chapters seen in excerpts",
    "X": "Contradictions and silences, with the choice taken",
}
HELD, NOT_HELD, NOT_APPLICABLE = "held", "**not held**", "not applicable"


@dataclass(frozen=True, slots=True)
class Statement:
    """One line of the list."""

    number: str
    tag: str
    section: str
    words: str


@dataclass(eq=False)
class Outcomes:
    """pytest plugin: outcome by statement and test. A test that fails in any parameter has failed."""

    tests: dict[str, dict[str, bool]] = field(default_factory=lambda: defaultdict(dict))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Collect; set-up and tear-down count as well."""
        name = report.nodeid.split("[")[0].split("/", 1)[-1]
        for key, number in report.user_properties:
            if key == "item":
                self.tests[number][name] = self.tests[number].get(name, True) and not report.failed


def read_tsv(path: Path) -> list[list[str]]:
    """Rows of a tab-separated file without comments."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return [line.split("\t") for line in lines if line and not line.startswith("#")]


def run_tests() -> Outcomes:
    """Run every marked test of the project that needs nothing from outside."""
    outcomes = Outcomes()
    sys.path.insert(0, str(ROOT))
    arguments = [str(ROOT / "tests"), "-m", "item and not clients and not oracle", "-q", "--no-header"]
    pytest.main([*arguments, "-p", "no:cacheprovider", "--rootdir", str(ROOT)], plugins=[outcomes])
    return outcomes


def state_of(statement: Statement, tests: dict[str, bool], reasons: dict[str, str]) -> tuple[str, str]:
    """(state, proof) of a statement."""
    if tests and all(tests.values()):
        return HELD, short(sorted(tests))
    failed = sorted(name for name, passed in tests.items() if not passed)
    if failed:
        return NOT_HELD, "fails: " + short(failed)
    if statement.number in reasons:
        return NOT_APPLICABLE, reasons[statement.number]
    return NOT_HELD, "no test"


def short(names: list[str]) -> str:
    """The first two tests by file and name, and how many more."""
    shown = ["`" + name.removeprefix("datasheet/") + "`" for name in names[:2]]
    return ", ".join(shown) + (f" and {len(names) - 2} more" if len(names) > 2 else "")


def page(outcomes: Outcomes) -> str:
    """The whole page."""
    statements = [Statement(*row) for row in read_tsv(HERE / "items.tsv")]
    reasons = {row[0]: row[1] for row in read_tsv(HERE / "not_applicable.tsv")}
    groups: dict[str, list[tuple[Statement, str, str]]] = defaultdict(list)
    for statement in statements:
        state, proof = state_of(statement, outcomes.tests.get(statement.number, {}), reasons)
        groups[statement.number.split("-")[0]].append((statement, state, proof))
    lines = [
        "# Conformance to the data sheets",
        "",
        "Made by `python tests/datasheet/conformance.py` from the tests; do not edit. A statement is *held* if",
        "at least one test shows it and all tests that show it pass. By: S simulator, D driver, B both, P planner,",
        "H electrical fact; ST, SV, CY: sections of the PIC-STEP, PIC-SERVO and CY545 sheets.",
        "",
        "| | statements | held | not applicable | not held |",
        "|---|---|---|---|---|",
    ]
    for group, rows in groups.items():
        states = [state for _, state, _ in rows]
        numbers = " | ".join(str(states.count(kind)) for kind in (HELD, NOT_APPLICABLE, NOT_HELD))
        lines.append(f"| {SHEETS[group]} | {len(rows)} | {numbers} |")
    for group, rows in groups.items():
        lines += [
            "",
            f"## {SHEETS[group]}",
            "",
            "| | by | section | statement | | shown in |",
            "|---|---|---|---|---|---|",
        ]
        for statement, state, proof in rows:
            words = statement.words.replace("|", "\\|")
            lines.append(
                f"| {statement.number} | {statement.tag} | {statement.section} | {words} | {state} | {proof} |"
            )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Write or check the page."""
    text = page(run_tests())
    if "--check" in sys.argv[1:]:
        current = PAGE.read_text(encoding="utf-8") if PAGE.exists() else ""
        if current != text:
            print(
                f"{PAGE.relative_to(ROOT)} is out of date: run python tests/datasheet/conformance.py", file=sys.stderr
            )
            return 1
        return 0
    PAGE.write_text(text, encoding="utf-8")
    summary = text.split("\n## ", 1)[0].split("|---|---|---|---|---|\n")[1]
    print(summary)
    return 0


if __name__ == "__main__":
    sys.exit(main())
