"""Values written into a machine file: everything else stays as somebody has written it."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from machines.load import read_machine, shipped_machines
from machines.tomledit import Value, set_values

TEXT = """# my mill
[axis.X]  # the long one
chip = "pic-step"   # NMC
count_latch = "unknown"   # not measured
name = "a # b" # c

# of the driver
[axis.X.step]
speed_mode = "auto"

# the short one
[axis.Y]
chip = "pic-step"
"""


def test_a_value_that_is_there_is_replaced_and_its_comment_kept() -> None:
    changed = set_values(TEXT, ("axis", "X"), {"count_latch": "rollover"})
    assert changed == TEXT.replace('"unknown"   # not', '"rollover"   # not')
    assert set_values(TEXT, ("axis", "X"), {"name": "x"}) == TEXT.replace('"a # b" # c', '"x" # c')


def test_a_new_key_stands_behind_the_others_of_its_table() -> None:
    changed = set_values(TEXT, ("axis", "X"), {"first_step": "period"})
    assert changed == TEXT.replace("# c\n", '# c\nfirst_step = "period"\n')


def test_a_new_table_stands_behind_those_of_its_parent() -> None:
    changed = set_values(TEXT, ("axis", "X", "probed"), {"version": 1, "delay": 0.25, "done": True})
    table = "[axis.X.probed]\nversion = 1\ndelay = 0.25\ndone = true\n"
    assert changed == TEXT.replace('"auto"\n', f'"auto"\n\n{table}')
    assert set_values("", ("sim",), {"seed": 3}) == "[sim]\nseed = 3\n"
    assert set_values("[a]\nb = 1", ("sim",), {"seed": 3}) == "[a]\nb = 1\n\n[sim]\nseed = 3"


def test_line_ends_stay_as_they_are() -> None:
    dos = TEXT.replace("\n", "\r\n")
    changed = set_values(dos, ("axis", "X"), {"count_latch": "immediate"})
    assert changed == dos.replace('"unknown"', '"immediate"')


@pytest.mark.parametrize(
    "text",
    ["[axis]\nX = { chip = 'pic-step' }\n", "axis.X.chip = 'pic-step'\n", 'axis = 3\n[b]\nc = """\n[axis.X]\n"""\n'],
)
def test_what_cannot_be_changed_safely_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"by hand|is no table"):
        set_values(text, ("axis", "X"), {"count_latch": "rollover"})


@given(
    machine=st.sampled_from(shipped_machines()),
    table=st.sampled_from([("axis", "X"), ("axis", "X", "probed"), ("axis", "Z", "servo"), ("sim",), ("verify",)]),
    values=st.dictionaries(
        st.from_regex(r"[a-z][a-z_]{0,8}", fullmatch=True),
        st.one_of(st.text(max_size=8), st.integers(-9, 9), st.floats(allow_nan=False, allow_infinity=False)),
        min_size=1,
        max_size=3,
    ),
)
def test_the_file_then_says_what_was_wanted_and_nothing_else(
    machine: str, table: tuple[str, ...], values: dict[str, Value]
) -> None:
    text = read_machine(machine).text
    wanted = tomllib.loads(text)
    inner = wanted
    for part in table:
        inner = inner.setdefault(part, {})
    try:
        changed = set_values(text, table, values)
    except ValueError:
        assert any(isinstance(inner.get(key), (dict, list)) for key in values)
        return
    inner.update(values)
    assert tomllib.loads(changed) == wanted
    kept = iter(changed.splitlines())
    untouched = [line for line in text.splitlines() if line.split(" =")[0] not in values]
    assert all(line in kept for line in untouched)  # in their order
