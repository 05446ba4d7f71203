"""Rate tables of CY545s: the shipped stand-in, or the user's transcription of the manual's chapter 17."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from nmc.chips.cy545 import RateTable, parse_rate_table

STAND_IN = "stand-in"
STAND_IN_FILE = "cy545_rates_standin.csv"


def read_rates(name: str) -> RateTable:
    """The rate table of a machine file's ``rate_table``: the shipped stand-in, or a CSV file.

    Raises ValueError in words for a file that cannot be read or is no rate table.
    """
    if name == STAND_IN:
        text = (resources.files("machines") / "data" / STAND_IN_FILE).read_text(encoding="utf-8")
        return parse_rate_table(text, STAND_IN_FILE)
    try:
        return parse_rate_table(Path(name).read_text(encoding="utf-8"), name)
    except UnicodeDecodeError:
        raise ValueError(f"{name}: not a text file in UTF-8") from None
    except OSError as error:
        raise ValueError(f"{name}: {error.strerror or error}") from None


def with_table_paths(data: dict[str, Any], origin: str) -> dict[str, Any]:
    """A machine file's values with ``rate_table`` files taken from the folder of the machine file."""
    axes = data.get("axis")
    if not isinstance(axes, dict):
        return data
    return data | {"axis": {name: _placed(table, Path(origin).parent) for name, table in axes.items()}}


def _placed(table: Any, folder: Path) -> Any:
    name = table.get("rate_table", STAND_IN) if isinstance(table, Mapping) else STAND_IN
    if name == STAND_IN or not isinstance(name, str) or not name:
        return table
    return dict(table) | {"rate_table": str(folder / name)}
