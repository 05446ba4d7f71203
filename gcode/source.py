"""A program's text as physical lines, and the compact form of one line.

Compact form: lower case, no blanks, every comment replaced by one ``COMMENT_MARK``. Blanks mean nothing in RS274/NGC
("g 1 x 1 0 . 5" is G1 X10.5), so the scanner reads the compact form; a column of the source line is found again, when
a diagnostic needs it, by counting the characters that were kept.
"""

from __future__ import annotations

from gcode.errors import GcodeError

COMMENT_MARK = "\x01"
_DELETE_BLANKS = {ord(c): None for c in " \t\r\n\f\v\xa0"}
_BLANKS = frozenset(" \t\r\n\f\v\xa0")


def split_lines(text: str) -> list[str]:
    """Physical lines without their ends. A byte order mark is dropped; CR LF, LF and CR alone all end a line."""
    if text.startswith("\ufeff"):
        text = text[1:]
    if "\r" in text:
        text = text.replace("\r\n", "\n").replace("\r", "\n")
    lines = text.split("\n")
    if lines and not lines[-1]:
        lines.pop()
    return lines


def compact(text: str, *, lenient: bool = False) -> tuple[str, list[str]]:
    """The compact form of a source line and the texts of its parenthesised comments. Raises ``GcodeError``.

    lenient: an open comment ends with the line, and a comment may hold another one.
    """
    if "(" not in text and ";" not in text:
        return text.translate(_DELETE_BLANKS).lower(), []
    pieces: list[str] = []
    comments: list[str] = []
    at = 0
    while True:
        opened = text.find("(", at)
        semicolon = text.find(";", at)
        if semicolon >= 0 and (opened < 0 or semicolon < opened):
            pieces.append(text[at:semicolon].translate(_DELETE_BLANKS).lower())
            break
        if opened < 0:
            pieces.append(text[at:].translate(_DELETE_BLANKS).lower())
            break
        pieces.append(text[at:opened].translate(_DELETE_BLANKS).lower())
        closed = text.find(")", opened)
        start = len("".join(pieces))
        if lenient:
            closed = _matching(text, opened)
        if closed < 0:
            raise GcodeError("GC002", "the comment is not closed", "close it with ')' on this line", (start, start + 1))
        nested = text.find("(", opened + 1, closed)
        if nested >= 0 and not lenient:
            raise GcodeError(
                "GC003",
                "a comment inside a comment",
                "use [ ] or ; inside a comment, or close it first",
                (start, start + 1),
            )
        comments.append(text[opened + 1 : closed])
        pieces.append(COMMENT_MARK)
        at = closed + 1
    return "".join(pieces), comments


def _matching(text: str, opened: int) -> int:
    """The parenthesis that closes the one at ``opened``, counting inner ones; the end of the line if none does."""
    depth = 0
    for index in range(opened, len(text)):
        depth += (text[index] == "(") - (text[index] == ")")
        if depth == 0:
            return index
    return len(text)


def columns(text: str, start: int, end: int) -> tuple[int, int]:
    """Source columns (from 1, end exclusive) of the compact span ``start``..``end`` of the source line ``text``."""
    kept = _kept_columns(text)
    if not kept:
        return 1, 2
    if start >= len(kept):
        past = kept[-1] + 1
        return past, past + 1
    first = kept[start]
    last = kept[min(max(end, start + 1), len(kept)) - 1]
    return first, max(last, first) + 1


def _kept_columns(text: str) -> list[int]:
    kept: list[int] = []
    column = 0
    while column < len(text):
        char = text[column]
        if char == ";":
            break
        if char == "(":
            kept.append(column + 1)
            closed = text.find(")", column)
            column = len(text) if closed < 0 else closed + 1
            continue
        if char not in _BLANKS:
            kept.append(column + 1)
        column += 1
    return kept
