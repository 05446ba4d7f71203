"""Plain lines as columns: one chunk of text becomes a table of word values, line by letter, without a loop over lines.

A plain line has only letters of ``LETTERS`` each with one number, blanks, and an N word in front. All others (comments,
parameters, other codes, doubtful numbers) are left to the scanner. A number is read as an integer mantissa divided by
a power of ten, which is exact for up to 15 digits, so the value is the very float that ``float()`` gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]
Flags = npt.NDArray[np.bool_]

LETTERS = "gxyzabcuvwijkrfn"
_OTHER, _DIGIT, _POINT, _SIGN, _LETTER, _BLANK, _NEWLINE = range(7)
_POWERS = 10.0 ** np.arange(23)
MAX_DIGITS = 15


def _classes() -> tuple[U1, U1]:
    kinds = np.full(256, _OTHER, np.uint8)
    columns = np.zeros(256, np.uint8)
    kinds[[ord(c) for c in "0123456789"]] = _DIGIT
    kinds[ord(".")] = _POINT
    kinds[[ord(c) for c in "+-"]] = _SIGN
    kinds[[ord(c) for c in " \t\r"]] = _BLANK
    kinds[ord("\n")] = _NEWLINE
    for column, letter in enumerate(LETTERS):
        for char in (letter, letter.upper()):
            kinds[ord(char)] = _LETTER
            columns[ord(char)] = column
    return kinds, columns


_KIND, _COLUMN = _classes()


@dataclass(frozen=True, slots=True)
class Table:
    """One chunk. starts: i8[L + 1], byte offsets of lines; plain: bool[L]; values: f8[letters, L], NaN where absent."""

    starts: I8
    plain: Flags
    values: F8


def tabulate(chunk: bytes) -> Table:
    """The table of a chunk of whole lines (the last one ends with a newline)."""
    data = np.frombuffer(chunk, np.uint8)
    kind = np.take(_KIND, data)
    newlines = np.flatnonzero(kind == _NEWLINE)
    count = len(newlines)
    starts = np.empty(count + 1, np.int64)
    starts[0] = 0
    starts[1:] = newlines + 1
    plain = np.ones(count, np.bool_)
    plain[np.searchsorted(newlines, np.flatnonzero(kind == _OTHER))] = False
    letters = np.flatnonzero(kind == _LETTER)
    values = np.full((len(LETTERS), count), np.nan)
    if len(letters) == 0:
        plain &= _has_nothing_else(kind, newlines)
        return Table(starts, plain, values)
    letter_count = np.cumsum(kind == _LETTER, dtype=np.int32)
    per_line = np.diff(letter_count[newlines], prepend=0)
    line_of = np.repeat(np.arange(count), per_line)
    digits = np.flatnonzero(kind == _DIGIT)
    word_value, good = _numbers(data, kind, letters, digits, letter_count)
    _reject_leading(plain, kind, letters, line_of, newlines, starts)
    column = _COLUMN[data[letters]]
    values[column, line_of] = word_value
    plain[line_of[~good]] = False
    distinct = np.count_nonzero(~np.isnan(values), axis=0)
    plain &= distinct == per_line
    _check_sequence(plain, column, line_of)
    return Table(starts, plain, values)


def _has_nothing_else(kind: U1, newlines: I8) -> Flags:
    """Lines without digits, points and signs."""
    empty = np.ones(len(newlines), np.bool_)
    marks = np.flatnonzero((kind == _DIGIT) | (kind == _POINT) | (kind == _SIGN))
    empty[np.searchsorted(newlines, marks)] = False
    return empty


def _numbers(data: U1, kind: U1, letters: I8, digits: I8, letter_count: npt.NDArray[np.int32]) -> tuple[F8, Flags]:
    """The value of each word, and whether it is a good number."""
    words = len(letters)
    owner_of_digit = letter_count[digits]
    skipped = int(np.searchsorted(owner_of_digit, 1))
    digits = digits[skipped:]
    count = np.bincount(owner_of_digit[skipped:], minlength=words + 1)[1:]
    first = np.cumsum(count) - count
    good = (count > 0) & (count <= MAX_DIGITS)
    mantissa = _mantissas(data, digits, first, count)
    points = np.flatnonzero(kind == _POINT)
    owner = letter_count[points] - 1
    inside = owner >= 0
    points, owner = points[inside], owner[inside]
    decimals = _decimals(digits, first, count, points, owner, good)
    good[owner[1:][owner[1:] == owner[:-1]]] = False
    value = mantissa / _POWERS[np.minimum(decimals, 22)]
    signs = np.flatnonzero(kind == _SIGN)
    if len(signs):
        _apply_signs(data, signs, letter_count, (digits, first), (points, owner), value, good)
    value[~good] = 0.0
    return value, good


def _decimals(
    digits: I8, first: I8, count: I8, points: I8, owner: npt.NDArray[np.integer], good: Flags
) -> npt.NDArray[np.int64]:
    """Digits behind the point of each word. Numbers with blanks inside are left to the scanner."""
    decimals = np.zeros(len(count), np.int64)
    if len(digits) == 0:
        return decimals
    start = digits[np.minimum(first, len(digits) - 1)]
    last = digits[np.minimum(first + np.maximum(count, 1) - 1, len(digits) - 1)]
    span = last - start + 1
    behind = last[owner] - points
    decimals[owner] = np.maximum(behind, 0)
    span[owner] -= (behind > 0) & (points > start[owner])
    good &= span == count
    return decimals


def _mantissas(data: U1, digits: I8, first: I8, count: I8) -> F8:
    """The digits of each word as one number, digit after digit for all words at once."""
    padded = np.zeros(len(digits) + MAX_DIGITS + 1)
    padded[: len(digits)] = data[digits]
    padded[: len(digits)] -= 48.0
    mantissa = padded[first]
    least, most = int(count.min(initial=1)), min(int(count.max(initial=1)), MAX_DIGITS)
    for place in range(1, most):
        longer = mantissa * 10.0
        longer += padded[first + place]
        if place < least:
            mantissa = longer
        else:
            np.copyto(mantissa, longer, where=count > place)
    return mantissa


def _apply_signs(
    data: U1,
    signs: I8,
    letter_count: npt.NDArray[np.int32],
    digits: tuple[I8, npt.NDArray[np.integer]],
    points: tuple[I8, npt.NDArray[np.integer]],
    value: F8,
    good: Flags,
) -> None:
    """A sign must be the only one of its word and stand before its digits and its point."""
    owner = letter_count[signs] - 1
    inside = owner >= 0
    signs, owner = signs[inside], owner[inside]
    good[owner[1:][owner[1:] == owner[:-1]]] = False
    places, first = digits
    first_digit = places[np.minimum(first[owner], len(places) - 1)] if len(places) else np.zeros(len(owner), np.int64)
    first_point = np.full(len(value), len(data), np.int64)
    at, owner_of_point = points
    first_point[owner_of_point[::-1]] = at[::-1]
    good[owner[(first_digit < signs) | (first_point[owner] < signs)]] = False
    minus = owner[data[signs] == ord("-")]
    value[minus] = -value[minus]


def _reject_leading(plain: Flags, kind: U1, letters: I8, line_of: I8, newlines: I8, starts: I8) -> None:
    """A digit, point or sign before the first letter of a line makes it and the line before doubtful."""
    heads = kind[starts[:-1]]
    suspects = np.flatnonzero((heads != _LETTER) & (heads != _NEWLINE))
    if len(suspects) == 0:
        return
    begin = starts[:-1][suspects]
    after = np.searchsorted(letters, begin)
    first_letter = np.append(letters, len(kind))[after]
    leading = np.minimum(first_letter, newlines[suspects])
    marks = np.flatnonzero((kind == _DIGIT) | (kind == _POINT) | (kind == _SIGN))
    bad = np.searchsorted(marks, leading) > np.searchsorted(marks, begin)
    plain[suspects[bad]] = False
    owners = after[bad] - 1
    plain[line_of[owners[owners >= 0]]] = False


def _check_sequence(plain: Flags, column: U1, line_of: I8) -> None:
    """N must be the first word of its line."""
    numbered = np.flatnonzero(column == LETTERS.index("n"))
    if len(numbered):
        heads = np.diff(line_of, prepend=-1) != 0
        plain[line_of[numbered[~heads[numbered]]]] = False
