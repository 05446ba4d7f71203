from machines.toml_lines import key_lines, line_of

TEXT = '''# a comment = 1
[machine]
name = "x" # [not.a.table]
[axis.X]
travel = [
  1, # one ]
  2,
]
chip = "pic-step"
"quoted key" = 1
[axis.X.home]
position = 2
[bus.main]
note = """
[axis.Q]
fake = 1
"""
baud = 9600
sim.seed = 3
[[list]]
a = 1
'''


def test_every_key_has_its_line() -> None:
    lines = key_lines(TEXT)
    assert lines["machine",] == 2
    assert lines["machine", "name"] == 3
    assert lines["axis", "X"] == 4
    assert lines["axis", "X", "travel"] == 5
    assert lines["axis", "X", "chip"] == 9
    assert lines["axis", "X", "quoted key"] == 10
    assert lines["axis", "X", "home", "position"] == 12
    assert lines["bus", "main", "baud"] == 18
    assert lines["bus", "main", "sim", "seed"] == 19
    assert lines["list", "a"] == 21


def test_what_stands_inside_strings_and_comments_is_no_key() -> None:
    lines = key_lines(TEXT)
    assert ("axis", "Q") not in lines
    assert ("not", "a", "table") not in lines
    assert ("bus", "main", "fake") not in lines


def test_a_missing_key_is_placed_at_the_table_around_it() -> None:
    lines = key_lines(TEXT)
    assert line_of(lines, ("axis", "X", "address")) == 4
    assert line_of(lines, ("axis", "X", "home", "switch", "deeper")) == 11
    assert line_of(lines, ("nowhere",)) is None
