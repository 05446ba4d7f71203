"""The line of a CY545 as text: commands by name, answers with their values, and what the manual does not allow."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from nmc.chips import cy545 as facts
from nmc.cy545_text import encode, read_answer
from nmc.dump import Line
from nmc.errors import LocalFault
from nmc.recording_link import HOST, STATUS, Chunk


def dump_cy545(chunks: Iterable[Chunk]) -> Iterator[Line]:
    """One line a command or answer, at the time of its first character."""
    held: dict[str, tuple[int, bytes]] = {}
    for chunk in chunks:
        if chunk.line not in (HOST, STATUS):
            continue
        for value in chunk.data:
            begin_ns, text = held.get(chunk.line, (chunk.time_ns, b""))
            text += bytes((value,))
            if value != facts.END:
                held[chunk.line] = begin_ns, text
                continue
            held.pop(chunk.line, None)
            yield _command(begin_ns, text) if chunk.line == HOST else _answer(begin_ns, text)
    for line, (begin_ns, text) in sorted(held.items()):
        yield Line(begin_ns, line, "unfinished", text, ("no carriage return",))


def _command(time_ns: int, text: bytes) -> Line:
    line = text[:-1].decode("latin-1")
    if not line:
        return Line(time_ns, HOST, "carriage return", text)
    if line[0] == "?":
        known = line[1:] in facts.QUERY_DIGITS
        return Line(time_ns, HOST, f"query {line[1:]}", text, () if known else ("nothing is known of this query",))
    letter, _, rest = line.lstrip("/").partition(" ")
    words = rest.replace(",", " ").split()
    fact = facts.COMMANDS.get(letter)
    name = fact.name if fact is not None else f"letter {letter}"
    complaints: tuple[str, ...] = ()
    try:
        encode(letter, *(int(word[:-1], 16) if word.endswith("H") else int(word) for word in words))
    except (LocalFault, ValueError) as error:
        complaints = (str(error),)
    return Line(time_ns, HOST, " ".join([name, *words]), text, complaints)


def _answer(time_ns: int, text: bytes) -> Line:
    about = text[:1].decode("latin-1")
    try:
        return Line(time_ns, STATUS, f"{about} is {read_answer(text, about)}", text)
    except (ValueError, KeyError):
        return Line(time_ns, STATUS, "no answer that is known", text, (f"{text!r} is no answer",))
