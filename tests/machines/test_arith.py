import math

import pytest

from machines.arith import evaluate, number, whole


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("200 * 16 / 5", 640.0),
        ("-3", -3.0),
        ("2 ** 10", 1024.0),
        ("(1 + 2) * 3 - 4", 5.0),
        ("360 / (2 * pi)", 360 / math.tau),
        (" 1e3 ", 1000.0),
    ],
)
def test_value(text: str, value: float) -> None:
    assert evaluate(text) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "200 *",
        "1 +* 2",
        "two",
        "__import__('os')",
        "abs(-1)",
        "1 if 1 else 2",
        "[1]",
        "'a'",
        "True",
        "x",
        "1j",
        "1 // 2",
    ],
)
def test_what_is_not_arithmetic_is_refused_in_words(text: str) -> None:
    with pytest.raises(ValueError, match="arithmetic"):
        evaluate(text)


@pytest.mark.parametrize("text", ["1 / 0", "0 ** -1", "10 ** 400", "9 ** 9 ** 9 ** 9", "1e999", "(-8) ** 0.5"])
def test_what_has_no_finite_value_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        evaluate(text)


def test_a_hostile_expression_neither_hangs_nor_recurses() -> None:
    for text in ("(" * 5000 + "1" + ")" * 5000, "-" * 199 + "1" * 10, "9" * 300):
        with pytest.raises(ValueError):
            evaluate(text)


def test_number_leaves_other_types_to_the_schema() -> None:
    assert number(True) is True
    assert number([1]) == [1]
    assert number("2 * 3") == 6.0


def test_whole_numbers_must_come_out_whole() -> None:
    assert whole("6 / 2") == 3
    assert whole(4.0) == 4
    with pytest.raises(ValueError, match=r"2\.5 is not a whole number"):
        whole("5 / 2")
