"""Baselines as text: a file for each case, and one for each job's canonical commands. Made to be read and diffed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from groupstart.regress.case import Result


@dataclass(frozen=True, slots=True)
class Baseline:
    """What a case gave when its baseline was taken."""

    fields: dict[str, str]
    canon: tuple[str, ...]
    rows: tuple[str, ...]


def case_path(folder: Path, job: str, machine: str) -> Path:
    """Where the baseline of a case stands."""
    return folder / machine / f"{job}.txt"


def canon_path(folder: Path, job: str) -> Path:
    """Where the canonical commands of a job stand, the same for every machine."""
    return folder / "canon" / f"{job}.txt"


def write_baseline(folder: Path, result: Result) -> bool:
    """Write the baseline of a result; whether anything is new in it."""
    texts = {
        case_path(folder, result.job, result.machine): baseline_text(result),
        canon_path(folder, result.job): "\n".join(result.canon) + "\n",
    }
    changed = False
    for path, text in texts.items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
            changed = True
    return changed


def baseline_text(result: Result) -> str:
    """A baseline as text: fields, then the motion."""
    if result.fault:
        return f"# {result.job} on {result.machine}\nfault = {result.fault}\n"
    head = [f"# {result.job} on {result.machine}", *(f"{key} = {value}" for key, value in result.fields)]
    return "\n".join([*head, "", *result.rows]) + "\n"


def read_baseline(folder: Path, job: str, machine: str) -> Baseline | None:
    """The baseline of a case, None if there is none."""
    path, canon = case_path(folder, job, machine), canon_path(folder, job)
    if not path.is_file():
        return None
    head, _, table = path.read_text(encoding="utf-8").partition("\n\n")
    fields = {}
    for line in head.splitlines():
        key, equals, value = line.partition(" = ")
        if equals and not line.startswith("#"):
            fields[key] = value
    commands = tuple(canon.read_text(encoding="utf-8").splitlines()) if canon.is_file() else ()
    return Baseline(fields, commands, tuple(table.splitlines()))
