"""Markers that every room's tests share."""

from __future__ import annotations

import pytest


def pytest_configure(config: pytest.Config) -> None:
    """Register ``item``: the data-sheet statements that a test holds; docs/conformance.md is made of them."""
    config.addinivalue_line(
        "markers",
        "item(*numbers): checklist numbers of the data-sheet statements that the test shows, as in item('ST-032')",
    )
