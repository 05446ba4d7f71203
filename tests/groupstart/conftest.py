"""The command line in this process, through its real front door: exit status, stdout and stderr."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from groupstart.cli import main


@dataclass(frozen=True)
class Answer:
    """What a call of ``groupstart`` gave back."""

    status: int
    out: str
    err: str


Cli = Callable[..., Answer]


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Cli:
    """``cli("check", "x.nc")`` runs ``groupstart check x.nc``."""

    def call(*arguments: str) -> Answer:
        with pytest.raises(SystemExit) as leaving:
            main(arguments)
        code = leaving.value.code
        assert isinstance(code, int)
        captured = capsys.readouterr()
        return Answer(code, captured.out, captured.err)

    return call


@pytest.fixture
def root() -> Path:
    """The project's folder."""
    return Path(__file__).resolve().parents[2]
