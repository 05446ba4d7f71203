"""Records are what the standard library's dataclasses are."""

import copy
import dataclasses
import pickle
from dataclasses import FrozenInstanceError, field

import pytest

from gcode import records
from gcode.canon import Feed, Rapid

END = (1.0,) * 9


def make(decorate):
    @decorate(frozen=True, slots=True)
    class Base:
        """A base."""

        line: int

    @decorate(frozen=True, slots=True)
    class Record(Base):
        """With defaults of both kinds."""

        end: tuple[float, ...]
        name: str = "a"
        items: list[int] = field(default_factory=list)

    @decorate(slots=True)
    class Loose:
        """Mutable, with a field of its own."""

        size: int
        twice: int = field(init=False)

        def __post_init__(self):
            self.twice = 2 * self.size

    @decorate(frozen=True, slots=True, eq=False)
    class Same:
        """Equal to itself only."""

        size: int

    return Base, Record, Loose, Same


@pytest.fixture(params=[records.dataclass, dataclasses.dataclass], ids=["ours", "standard"])
def made(request):
    return make(request.param)


def test_fields_and_defaults(made):
    base, record, _, _ = made
    one = record(3, END)
    assert (one.line, one.end, one.name, one.items) == (3, END, "a", [])
    assert record(3, END).items is not one.items
    assert record(line=3, end=END, name="b", items=[1]).items == [1]
    assert [item.name for item in dataclasses.fields(record)] == ["line", "end", "name", "items"]
    assert record.__match_args__ == ("line", "end", "name", "items")
    assert isinstance(one, base)
    assert not hasattr(one, "__dict__")
    with pytest.raises(TypeError, match="end"):
        record(3)
    with pytest.raises(TypeError, match="colour"):
        record(3, END, colour=1)


def test_equality_hash_and_text(made):
    base, record, loose, same = made
    assert record(3, END) == record(3, END)
    assert record(3, END) != record(4, END)
    assert base(3) == base(3)
    assert base(3) != record(3, END)
    assert hash(base(3)) == hash(base(3))
    assert repr(record(3, (1.0,), "b")).endswith("Record(line=3, end=(1.0,), name='b', items=[])")
    assert same(1) != same(1)
    assert len({same(1), same(1)}) == 2
    with pytest.raises(TypeError, match="unhashable"):
        hash(loose(1))


def test_frozen_and_loose(made):
    _, record, loose, _ = made
    one = record(3, END)
    with pytest.raises(FrozenInstanceError):
        one.line = 4
    with pytest.raises(FrozenInstanceError):
        del one.line
    two = loose(2)
    two.size = 5
    assert (two.size, two.twice) == (5, 4)


def test_replace_asdict_copies(made):
    _, record, _, _ = made
    one = record(3, END, "b", [1])
    assert dataclasses.replace(one, line=4) == record(4, END, "b", [1])
    assert dataclasses.asdict(one) == {"line": 3, "end": END, "name": "b", "items": [1]}
    deep = copy.deepcopy(one)
    assert deep == one
    assert deep.items is not one.items


def test_commands_are_pickled_and_matched():
    feed = Feed(3, END, 2.0)
    assert pickle.loads(pickle.dumps(feed)) == feed
    assert feed != Rapid(3, END)
    match feed:
        case Feed(line, end, speed):
            assert (line, end, speed) == (3, END, 2.0)
