"""The suite file: which jobs run on which machines, with which tolerances; every mistake in it with its key."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from groupstart.regress.case import Case


class SuiteError(Exception):
    """The suite cannot be run; the text names file and key."""


class Table(BaseModel):
    """Base of all tables: frozen, strict, no unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class SuiteTable(Table):
    """``[suite]``. ``baselines``: folder beside the file; ``seed``: instead of those of the machines."""

    name: str = Field(min_length=1)
    baselines: str = "baselines"
    seed: int | None = Field(default=None, ge=0)


class MachineEntry(Table):
    """``[[machine]]``. ``file``: a shipped name, or a path beside the suite file."""

    name: str = Field(pattern=r"^[\w.-]+$")
    file: str = Field(min_length=1)


class JobEntry(Table):
    """``[[job]]``. Paths are beside the suite file; ``machines``: names, all of them if it is not given."""

    name: str = Field(pattern=r"^[\w.-]+$")
    file: str = Field(min_length=1)
    work_offset: list[float | int] = Field(default=[], max_length=9)
    dialect: str = "auto"
    tool_table: str | None = None
    profile: str = "auto"
    solver: str = "auto"
    machines: list[str] | None = None


class SuiteFile(Table):
    """A whole suite. ``tolerance``: by field, how far a number may be from the baseline (0 for those not named)."""

    suite: SuiteTable
    tolerance: dict[str, float | int | bool] = {}
    machine: list[MachineEntry] = Field(min_length=1)
    job: list[JobEntry] = Field(min_length=1)


@dataclass(frozen=True, slots=True)
class Suite:
    """A suite with everything read that its cases need."""

    name: str
    baselines: Path
    tolerance: dict[str, float]
    cases: tuple[Case, ...]


def read_suite(path: Path) -> Suite:
    """Read a suite and the programs and machines it names. Raises SuiteError, OSError."""
    try:
        found = SuiteFile.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except tomllib.TOMLDecodeError as error:
        raise SuiteError(f"{path}: not TOML: {error}") from None
    except UnicodeDecodeError as error:
        raise SuiteError(f"{path}: not a text in UTF-8 (byte {error.start})") from None
    except ValidationError as error:
        words = [f"{path}: {'.'.join(map(str, item['loc']))}: {item['msg']}" for item in error.errors()]
        raise SuiteError("\n".join(words)) from None
    _names_once(path, "machine", [entry.name for entry in found.machine])
    _names_once(path, "job", [entry.name for entry in found.job])
    cases = tuple(_cases(path, found))
    tolerance = {name: float(value) for name, value in found.tolerance.items()}
    return Suite(found.suite.name, path.parent / found.suite.baselines, tolerance, cases)


def _names_once(path: Path, what: str, names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise SuiteError(f"{path}: two entries of {what} are called {twice[0]!r}")


def _cases(path: Path, found: SuiteFile) -> Iterator[Case]:
    from groupstart.inputs import read_program
    from machines.errors import MachineError, MachineMissingError
    from machines.load import read_machine, shipped_machines

    machines = {}
    for entry in found.machine:
        name = entry.file if entry.file in shipped_machines() else str(path.parent / entry.file)
        try:
            machines[entry.name] = read_machine(name)
        except (MachineError, MachineMissingError) as error:
            raise SuiteError(f"{path}: machine {entry.name}: {error}") from None
    for job in found.job:
        text = read_program(str(path.parent / job.file))
        tools = None if job.tool_table is None else read_program(str(path.parent / job.tool_table))
        for name in job.machines if job.machines is not None else machines:
            if name not in machines:
                raise SuiteError(f"{path}: job {job.name}: there is no machine {name!r} in this suite")
            offset = tuple(float(x) for x in job.work_offset) + (0.0,) * (9 - len(job.work_offset))
            yield Case(
                job.name, name, job.file, text, machines[name].text, machines[name].origin,
                offset if job.work_offset else None, job.dialect, tools, job.profile, job.solver, found.suite.seed,
            )  # fmt: skip
