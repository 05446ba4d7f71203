"""Python's own pauses stay out of a motion on a port."""

import gc
import weakref

import pytest

from machines.pauses import nothing_old_looked_at


class Knot:
    """Something that only a collection can free."""

    def __init__(self) -> None:
        self.me = self


def test_what_is_there_is_left_alone_until_the_end() -> None:
    gc.unfreeze()
    old = [[] for _ in range(50_000)]
    with nothing_old_looked_at():
        assert gc.get_freeze_count() > len(old)
        assert len(gc.get_objects()) < len(old)
    assert gc.get_freeze_count() == 0
    assert len(gc.get_objects()) > len(old)


def test_what_comes_later_is_collected_as_ever() -> None:
    with nothing_old_looked_at():
        knot = weakref.ref(Knot())
        gc.collect()
        assert knot() is None


def test_an_error_ends_it() -> None:
    with pytest.raises(ZeroDivisionError), nothing_old_looked_at():
        _ = 1 / 0
    assert gc.get_freeze_count() == 0


def test_inside_of_another_one_nothing_is_collected_and_the_outer_one_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    collections: list[int] = []
    monkeypatch.setattr(gc, "collect", lambda: collections.append(1))
    gc.unfreeze()
    with nothing_old_looked_at():
        with nothing_old_looked_at():
            pass
        assert gc.get_freeze_count() > 0
    assert collections == [1]
    assert gc.get_freeze_count() == 0
