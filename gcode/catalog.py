"""Every diagnostic code: what it means and what cures it, read from ``catalog.toml``.

``python -m gcode.catalog docs/errors tests/refusals`` writes a page for each, with its refusal as the example.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Entry:
    """One code. GC0xx, GC1xx and GC3xx are errors, GC2xx warnings."""

    code: str
    title: str
    meaning: str
    cure: str


def load_catalog() -> dict[str, Entry]:
    """All codes in order."""
    data = tomllib.loads(Path(__file__).with_name("catalog.toml").read_text(encoding="utf-8"))
    return {code: Entry(code, **fields) for code, fields in data.items()}


def page(entry: Entry, example: str = "") -> str:
    """One page of the documentation."""
    kind = "warning" if entry.code.startswith("GC2") else "error"
    lines = [f"# {entry.code}: {entry.title}", "", f"({kind})", "", entry.meaning, "", f"**Cure.** {entry.cure}", ""]
    if example:
        lines += ["## Example", "", "```", *example.rstrip().splitlines(), "```", ""]
    return "\n".join(lines)


def examples(folder: Path) -> dict[str, str]:
    """What the refusal files show, as the diagnostic is printed, by code."""
    from gcode.interp import interpret
    from gcode.refusal import read_refusal

    found: dict[str, str] = {}
    for path in sorted(folder.glob("*.ngc")):
        refusal = read_refusal(path.read_text(encoding="utf-8"))
        result = interpret(refusal.program, refusal.setup("program.ngc"))
        for diagnostic in result.diagnostics:
            if diagnostic.code == refusal.code and diagnostic.line == refusal.line and refusal.code not in found:
                found[refusal.code] = diagnostic.text(refusal.program.split("\n")[refusal.line - 1])
    return found


def write_pages(folder: Path, shown: dict[str, str]) -> None:
    """Writes a page for every code, and an index."""
    folder.mkdir(parents=True, exist_ok=True)
    index = ["# Errors and warnings of the interpreter", ""]
    for entry in load_catalog().values():
        (folder / f"{entry.code}.md").write_text(page(entry, shown.get(entry.code, "")), encoding="utf-8")
        index.append(f"* [{entry.code}]({entry.code}.md) {entry.title}")
    others = sorted(path for path in folder.glob("[A-Z][A-Z][0-9]*.md") if path.stem not in load_catalog())
    if others:
        index += ["", "Of machine and planner:", ""]
    for path in others:
        title = path.read_text(encoding="utf-8").split("\n", 1)[0].partition(": ")[2]
        index.append(f"* [{path.stem}]({path.name}) {title}")
    (folder / "README.md").write_text("\n".join(index) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]), examples(Path(sys.argv[2])))
