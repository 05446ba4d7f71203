"""Markers and hypothesis profiles that every room's tests share.

A test says its number of examples as a share of the profile's, ``2 * settings.default.max_examples``.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

os.environ["GROUPSTART_COMPILED"] = "0"  # tests look at the sources; .ci/compiled.py compares what was compiled
STATEMENTS = Path(__file__).parents[1] / "docs" / "conformance-items.tsv"

settings.register_profile("default", max_examples=100, derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=2000, deadline=None, print_blob=True)
settings.load_profile("default")


def pytest_configure(config: pytest.Config) -> None:
    """Register ``item``: the data-sheet statements that a test holds; docs/conformance.md is made of them."""
    config.addinivalue_line(
        "markers",
        "item(*numbers): checklist numbers of the data-sheet statements that the test shows, as in item('ST-032')",
    )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Refuse a number that is in no list: a slip there would leave a statement without its test."""
    lines = STATEMENTS.read_text(encoding="utf-8").splitlines()
    known = {line.split("\t")[0] for line in lines if not line.startswith("#")}
    listed = {number.split("-")[0] for number in known}
    for test in items:
        for marker in test.iter_markers("item"):
            for number in marker.args:
                if number not in known and number.split("-")[0] in listed:
                    raise pytest.UsageError(f"{test.nodeid}: {number} is no statement of {STATEMENTS.name}")
