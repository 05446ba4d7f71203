"""Every refusal file is refused where it says; every error code has a refusal file and a page of documentation."""

import re
from pathlib import Path

import pytest

from gcode.catalog import load_catalog
from gcode.interp import interpret
from gcode.refusal import read_refusal

TESTS = Path(__file__).parent.parent
ROOT = TESTS.parent
FILES = sorted((TESTS / "refusals").glob("*.ngc"))
WARNINGS_ARE_SHOWN_ELSEWHERE = "GC2"
WITHOUT_PROGRAM = {"GC301", "GC302"}
"""Tool tables and parameter files have their own tests."""


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_is_refused_with_place_code_and_hint(path):
    refusal = read_refusal(path.read_text(encoding="utf-8"))
    result = interpret(refusal.program, refusal.setup(path.name))
    places = {(d.line, d.column, d.code): d for d in result.errors}
    assert (refusal.line, refusal.column, refusal.code) in places
    diagnostic = places[refusal.line, refusal.column, refusal.code]
    assert refusal.words in f"{diagnostic.message} {diagnostic.hint}"
    assert diagnostic.end_column > diagnostic.column


def codes_in_source():
    return {
        code
        for path in (ROOT / "gcode").glob("*.py")
        for code in re.findall(r'"(GC\d{3})"', path.read_text(encoding="utf-8"))
    }


def test_catalogue_knows_every_code_and_only_those():
    assert set(load_catalog()) == codes_in_source()


def test_every_error_has_a_refusal_file():
    shown = {read_refusal(path.read_text(encoding="utf-8")).code for path in FILES}
    errors = {code for code in load_catalog() if not code.startswith(WARNINGS_ARE_SHOWN_ELSEWHERE)}
    assert errors - shown - WITHOUT_PROGRAM == set()


@pytest.mark.parametrize("code", load_catalog())
def test_has_a_page_that_says_what_the_catalogue_says(code):
    text = (ROOT / "docs" / "errors" / f"{code}.md").read_text(encoding="utf-8")
    entry = load_catalog()[code]
    assert entry.meaning in text
    assert entry.cure in text
