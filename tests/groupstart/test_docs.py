"""The documents say what is there: file names, verbs, keys, commands."""

import re
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from groupstart.cli import VERBS
from machines import schema

ROOT = Path(__file__).resolve().parents[2]


def test_every_file_that_the_architecture_names_is_there() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text()
    named = set(re.findall(r"`((?:gcode|planner|nmc|sim|machines|groupstart|docs|\.ci)/[\w./-]*)`", text))
    assert len(named) > 60
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


PAGES = ["README.md", "ARCHITECTURE.md", "docs/cli.md", "docs/machine-files.md", "docs/commissioning.md"]


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere(page: str) -> None:
    text = (ROOT / page).read_text()
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", text):
        if not target.startswith("http"):
            assert ((ROOT / page).parent / target).exists(), target


def test_the_readme_gives_the_two_commands_as_one_fenced_line_each() -> None:
    blocks = re.findall(r"```sh\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    single = [block.strip() for block in blocks if block.count("\n") == 1]
    assert len([line for line in single if line.endswith("groupstart run")]) == 1
    assert len([line for line in single if line.endswith("pytest")]) == 1


def test_every_verb_is_told() -> None:
    text = (ROOT / "docs" / "cli.md").read_text()
    assert [verb for verb in VERBS if f"**`{verb}" not in text] == []


def tables(model: type[BaseModel]) -> set[type[BaseModel]]:
    found = {model}
    for field in model.model_fields.values():
        waiting: list[Any] = [field.annotation]
        while waiting:
            item = waiting.pop()
            if isinstance(item, type) and issubclass(item, BaseModel):
                found |= tables(item)
            else:
                waiting += get_args(item)
    return found


def test_every_key_of_a_machine_file_is_told() -> None:
    text = (ROOT / "docs" / "machine-files.md").read_text()
    told = set(re.findall(r"`(\w+)`", text)) | set(re.findall(r"`(\w+) = ", text))
    told |= set(re.findall(r"\[(?:sim\.)?axis\.X\.(\w+)\]", text)) | {"axis"}
    keys = {
        key for table in tables(schema.MachineConfig) if table is not schema.MachineConfig for key in table.model_fields
    }
    assert keys > {"steps_per_unit", "kp", "home_at"}
    assert sorted(keys - told) == []
