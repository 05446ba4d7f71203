"""Commands and status packets between bytes and named values, driven by the fact tables of ``nmc.chips``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nmc.chips.common import ChipFacts, CommandFact, Field
from nmc.errors import LocalFault


@dataclass(frozen=True, slots=True)
class Decoded:
    """A command in words. ``complaints``: what the chip's data sheet does not allow in it.

    control: which of the values are bits of the control byte.
    """

    name: str
    values: Mapping[str, int]
    complaints: tuple[str, ...] = ()
    control: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Status:
    """A status packet in words. ``flags``: names of the bits that are set. ``values``: items by name."""

    byte: int
    flags: frozenset[str]
    values: Mapping[str, int]


def encode(facts: ChipFacts, name: str, values: Mapping[str, int] | None = None) -> tuple[int, bytes]:
    """(command code, data bytes) of a command from its named values.

    Control bits that say "this field is present" are set by the fields that are given. A 13- or 14-byte Set Gain and
    the like leave out trailing fields. Raises LocalFault for unknown names, missing or out-of-range values.
    """
    try:
        fact = facts.command(name)
    except KeyError as error:
        raise LocalFault(str(error.args[0])) from None
    left = dict(values or {})
    control = 0
    body = b""
    for field in fact.fields:
        if field.name in left:
            value = left.pop(field.name)
            _check_range(fact, field, value)
            body += int(value).to_bytes(field.size, "little", signed=field.signed)
            if field.when is not None:
                control |= _bits(fact, field.when)
        elif field.when is None and len(body) not in fact.lengths:
            raise LocalFault(f"{name} needs {field.name}", rule=f"{facts.name} {fact.section}")
    presence = {field.when for field in fact.fields if field.when is not None}
    for bits in fact.control:
        value = int(left.pop(bits.name, 0))
        if bits.name in presence and value and not control & bits.mask:
            raise LocalFault(
                f"{name}: {bits.name} is set but its value is missing", rule=f"{facts.name} {fact.section}"
            )
        if value < 0 or value >> bits.width:
            raise LocalFault(f"{name}: {bits.name} = {value} does not fit {bits.width} bit(s)")
        control |= value << bits.shift
    if left:
        raise LocalFault(f"{name} of {facts.name} has no {', '.join(sorted(left))}")
    data = bytes((control,)) + body if fact.control else body
    complaints = complain(fact, data)
    if complaints:
        raise LocalFault(f"{name}: {complaints[0]}", rule=f"{facts.name} {fact.section}")
    return fact.code, data


def decode(facts: ChipFacts, command: int, data: bytes) -> Decoded:
    """A command's bytes in words; takes any bytes, never raises."""
    fact = facts.commands.get(command)
    if fact is None:
        return Decoded(f"undefined_{command:x}", {}, (f"{facts.name} has no command 0x{command:X}",))
    values: dict[str, int] = {}
    control = data[0] if fact.control and data else 0
    rest = data[1:] if fact.control else data
    for bits in fact.control:
        values[bits.name] = (control & bits.mask) >> bits.shift
    for field in fact.fields:
        if field.when is not None and not control & _bits(fact, field.when):
            continue
        if len(rest) < field.size:
            break
        values[field.name] = int.from_bytes(rest[: field.size], "little", signed=field.signed)
        rest = rest[field.size :]
    return Decoded(fact.name, values, complain(fact, data), frozenset(bits.name for bits in fact.control))


def complain(fact: CommandFact, data: bytes) -> tuple[str, ...]:
    """What is wrong with a command: data length, undefined control bits, ranges, more than one manner of stop."""
    found: list[str] = []
    if len(data) not in fact.lengths:
        return (f"{len(data)} data bytes instead of {' or '.join(map(str, fact.lengths))}",)
    at = 0
    control = 0
    if fact.control:
        control, at = data[0], 1
        defined = sum(bits.mask for bits in fact.control)
        if control & ~defined:
            found.append(f"control bits 0x{control & ~defined:02X} must be zero")
        stops = [b.name for b in fact.control if b.name.startswith(("stop_", "motor_off")) and control & b.mask]
        if len(stops) > 1:
            found.append(f"only one of {', '.join(stops)} may be set")
    for field in fact.fields:
        if field.when is not None and not control & _bits(fact, field.when):
            continue
        if at + field.size > len(data):
            if field.when is not None or len(data) != at:
                found.append(f"{field.name} is missing")
            break
        value = int.from_bytes(data[at : at + field.size], "little", signed=field.signed)
        if not field.least <= value <= field.greatest:
            found.append(f"{field.name} = {value} is outside {field.least}..{field.greatest}")
        at += field.size
    if at < len(data):
        found.append(f"{len(data) - at} data bytes too many")
    return tuple(found)


def status_flags(facts: ChipFacts, status: int) -> frozenset[str]:
    """Names of the status bits that are set."""
    return frozenset(name for bit, name in enumerate(facts.status_bits) if status >> bit & 1)


def decode_status(facts: ChipFacts, status: int, mask: int, extra: bytes) -> Status:
    """A status packet in words. ``mask``: the items it was asked for; items that are cut short are left out.

    Type and version come as two values ``type`` and ``version``; one-byte items with named bits also appear bit by
    bit, as ``inputs.limit1``. Never raises.
    """
    values: dict[str, int] = {}
    at = 0
    for item in facts.status_items:
        if not mask >> item.bit & 1:
            continue
        part = extra[at : at + item.size]
        if len(part) < item.size:
            break
        at += item.size
        if item.name == "type_version":
            values["type"], values["version"] = part
            continue
        values[item.name] = int.from_bytes(part, "little", signed=item.signed)
        for bit, name in enumerate(facts.byte_items.get(item.name, ())):
            values[f"{item.name}.{name}"] = part[0] >> bit & 1
    return Status(status, status_flags(facts, status), values)


def _bits(fact: CommandFact, name: str) -> int:
    return next(bits.mask for bits in fact.control if bits.name == name)


def _check_range(fact: CommandFact, field: Field, value: int) -> None:
    if not field.least <= value <= field.greatest:
        raise LocalFault(
            f"{fact.name}: {field.name} = {value} is outside {field.least}..{field.greatest}", rule=fact.section
        )
