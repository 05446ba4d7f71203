"""CY545 axes of a machine: their rate tables, and what planner and driver are told of them."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

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
