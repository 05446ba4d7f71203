"""``dataclass`` for records that every start defines: what the standard library makes, in a tenth of the time.

The standard library writes and compiles up to seven functions for each class, which takes half a millisecond for a
frozen one: the fifty records of the interpreter would take as long as a short program does. Here only ``__init__`` is
compiled; the other methods are closures over a getter of all fields. Fields, ``replace``, ``asdict``, ``match`` and
pickling work as ever. A subclass must be made by this decorator too.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any

__all__ = ["dataclass"]

Values = Callable[[Any], tuple[Any, ...]]

if TYPE_CHECKING:
    from dataclasses import dataclass
else:

    def dataclass(
        cls: type | None = None, /, *, frozen: bool = False, slots: bool = False, eq: bool = True
    ) -> type | Callable[[type], type]:
        """As ``dataclasses.dataclass``, with the options that are used here."""

        def wrap(plain: type) -> type:
            made = dataclasses.dataclass(init=False, repr=False, eq=False, slots=slots)(plain)
            _add_methods(made, frozen=frozen, eq=eq)
            return made

        return wrap if cls is None else wrap(cls)


def _add_methods(cls: Any, *, frozen: bool, eq: bool) -> None:
    fields = dataclasses.fields(cls)
    names = [field.name for field in fields]
    values = _getter(names)

    def represent(self: Any) -> str:
        shown = ", ".join(f"{name}={value!r}" for name, value in zip(names, values(self), strict=True))
        return f"{type(self).__qualname__}({shown})"

    def equal(self: Any, other: Any) -> Any:
        return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

    def hashed(self: Any) -> int:
        return hash(values(self))

    cls.__init__ = _init(cls, fields, frozen=frozen)
    cls.__repr__ = represent
    if eq:
        cls.__eq__ = equal
        cls.__hash__ = hashed if frozen else None
    if frozen:
        cls.__setattr__, cls.__delattr__ = _refuse_set, _refuse_delete
        cls.__getstate__, cls.__setstate__ = _state, _set_state


def _getter(names: list[str]) -> Values:
    """A function that gives all fields of a record."""
    if len(names) > 1:
        return attrgetter(*names)
    return lambda record: tuple(getattr(record, name) for name in names)


def _init(cls: Any, fields: tuple[dataclasses.Field[Any], ...], *, frozen: bool) -> Any:
    """The compiled ``__init__``: fields are stored by their slots, which is what a frozen record leaves open."""
    missing = dataclasses.MISSING
    space: dict[str, Any] = {"missing": missing}
    arguments, body = ["self"], []
    for field in fields:
        name = value = field.name
        if field.default_factory is not missing:
            space[f"make_{name}"] = field.default_factory
            value = f"make_{name}() if {name} is missing else {name}"
            arguments.append(f"{name}=missing")
        elif field.default is not missing:
            space[f"default_{name}"] = field.default
            arguments.append(f"{name}=default_{name}")
        elif field.init:
            arguments.append(name)
        else:
            continue
        if frozen:
            space[f"set_{name}"] = _setter(cls, name)
            body.append(f" set_{name}(self, {value})")
        else:
            body.append(f" self.{name} = {value}")
    if hasattr(cls, "__post_init__"):
        body.append(" self.__post_init__()")
    exec("\n".join([f"def __init__({', '.join(arguments)}):", *body, " pass"]), space)
    return space["__init__"]


def _setter(cls: Any, name: str) -> Callable[[Any, Any], None]:
    slot: Any = getattr(cls, name, None)
    if hasattr(slot, "__set__"):
        store: Callable[[Any, Any], None] = slot.__set__
        return store
    return lambda record, value: object.__setattr__(record, name, value)


def _refuse_set(_record: Any, name: str, _value: Any) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot assign to field {name!r}")


def _refuse_delete(_record: Any, name: str) -> None:
    raise dataclasses.FrozenInstanceError(f"cannot delete field {name!r}")


def _state(record: Any) -> list[Any]:
    return [getattr(record, field.name) for field in dataclasses.fields(record)]


def _set_state(record: Any, state: list[Any]) -> None:
    for field, value in zip(dataclasses.fields(record), state, strict=True):
        object.__setattr__(record, field.name, value)
