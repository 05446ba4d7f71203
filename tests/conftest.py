"""Markers that every room's tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

ITEMS = Path(__file__).parent / "datasheet" / "items.tsv"


def pytest_configure(config: pytest.Config) -> None:
    """Register ``item``: the data-sheet statements that a test holds; docs/conformance.md is made of them."""
    config.addinivalue_line(
        "markers",
        "item(*numbers): checklist numbers of the data-sheet statements that the test shows, as in item('ST-032')",
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Attach the numbers to the test's report and refuse numbers that are in no list."""
    lines = ITEMS.read_text(encoding="utf-8").splitlines()
    known = {line.split("\t")[0] for line in lines if not line.startswith("#")}
    for test in items:
        for marker in test.iter_markers("item"):
            for number in marker.args:
                if number not in known:
                    raise pytest.UsageError(f"{test.nodeid}: {number} is no statement of tests/datasheet/items.tsv")
                test.user_properties.append(("item", number))
