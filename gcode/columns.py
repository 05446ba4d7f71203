"""Plain lines as columns: one chunk of text becomes a table of word values, line by letter, without a loop over lines.

A plain line has only letters of ``LETTERS`` each with one number, blanks, and an N word in front. All others (comments,
parameters, other codes, doubtful numbers) are left to the scanner.

Blanks mean nothing and are taken out first. Of what is left only the marks, the characters that are no digits, are
listed; the digits of a number are the gap between two marks. So a word is a letter, a sign perhaps, digits, a point
perhaps, digits, and then the next letter or the line's end:

    X-12.5\\n     marks   X - . \\n     gaps behind them   0 2 1

The digits themselves are read eight at a time as one 64-bit word. A number is an integer mantissa divided by a power
of ten, which is exact for up to 15 digits, so the value is the very float that ``float()`` gives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gcode.scanner import MAX_LINE

F8 = npt.NDArray[np.float64]
I8 = npt.NDArray[np.int64]
U1 = npt.NDArray[np.uint8]
U8 = npt.NDArray[np.uint64]
Flags = npt.NDArray[np.bool_]

LETTERS = "gxyzabcuvwijkrfn"
_NEWLINE, _PLUS, _MINUS, _POINT, _ZERO, _LETTER, _OTHER = 0x0A, 0x2B, 0x2D, 0x2E, 0x30, 0x60, 0xFF
"""The characters as ``_FOLDED`` gives them: of a letter the low four bits are its column."""
_BLANKS = b" \t\r"
MAX_DIGITS = 15
_WINDOW = 8
"""Characters that are read at once."""
_NO_POINT = 99
_FREED_BYTES = 1 << 24


def _folded() -> bytes:
    """What stands for each byte: digits, points, signs and newlines for themselves, letters for their columns."""
    table = bytearray([_OTHER]) * 256
    for char in b"0123456789.+-\n":
        table[char] = char
    for column, letter in enumerate(LETTERS):
        table[ord(letter)] = table[ord(letter.upper())] = _LETTER + column
    return bytes(table)


def _divisors() -> F8:
    """By number of decimals, and 16 more for a minus: powers of ten with the sign."""
    powers = 10.0 ** np.arange(MAX_DIGITS + 1)
    return np.concatenate((powers, -powers))


def _masks() -> tuple[U8, U8]:
    """Of a window, the digits to keep behind the point and before it, by decimals * 9 + digits.

    The last character is the highest byte. Those before the point move up by one, over it.
    """
    behind = np.zeros((9, 9), np.uint64)
    before = np.zeros((9, 9), np.uint64)
    for decimals in range(9):
        for digits in range(9):
            for place in range(digits):
                part = behind if place < decimals else before
                part[decimals, digits] |= np.uint64(0x0F << (8 * (_WINDOW - 1 - place)))
    return behind.ravel(), before.ravel()


_FOLDED = _folded()
_DIVISORS = _divisors()
_BEHIND, _BEFORE = _masks()
_ROOM = np.array([_WINDOW - 1] * _WINDOW + [_WINDOW])
"""Digits that a window holds, by decimals: the point takes the room of one."""
_TENS = 10 ** np.arange(_WINDOW + 1)


def keep_freed_memory() -> None:
    """Lets the C library keep what is freed for the next chunk.

    glibc gives great blocks back to the kernel, and every page of a new one is a fault, which takes as long as the work
    in it; but the greatest block that was ever freed becomes the measure of what is great. Elsewhere nothing changes.
    """
    np.empty(_FREED_BYTES, np.uint8)


@dataclass(frozen=True, slots=True)
class Table:
    """One chunk. starts: i8[L + 1], byte offsets of lines; plain: bool[L]; values: f8[letters, L], NaN where absent."""

    starts: I8
    plain: Flags
    values: F8


def tabulate(chunk: bytes) -> Table:
    """The table of a chunk of whole lines (the last one ends with a newline)."""
    ends = np.flatnonzero(np.frombuffer(chunk, np.uint8) == _NEWLINE)
    count = len(ends)
    starts = np.zeros(count + 1, np.int64)
    np.add(ends, 1, out=starts[1:])
    text = b"\n" * (2 * _WINDOW) + chunk.translate(_FOLDED, _BLANKS) + b"\n\n"
    data = np.frombuffer(text, np.uint8)
    at = np.flatnonzero(data - np.uint8(_ZERO) > 9)[2 * _WINDOW - 1 :]
    mark = data[at]
    gap = np.diff(at)
    # the newline before the first line is mark 0, those at the end keep the marks behind a word inside
    newlines = np.flatnonzero(mark == _NEWLINE)[: count + 1]
    plain = starts[1:] - starts[:-1] <= MAX_LINE + 1
    _reject_heads(plain, mark, gap, newlines)
    values = np.full((len(LETTERS), count), np.nan)
    lettered = (mark >= _LETTER) & (mark != _OTHER)
    words = np.flatnonzero(lettered)
    if len(words):
        per_line = np.add.reduceat(lettered.view(np.int8), newlines, dtype=np.int32)[:-1]
        _fill(values, plain, words, per_line, _Marks(data, at, mark, gap))
    return Table(starts, plain, values)


@dataclass(frozen=True, slots=True)
class _Marks:
    """Characters that are no digits. at: i8[M], offsets in ``data``; mark: u1[M]; gap: i8[M - 1], to the next one."""

    data: U1
    at: I8
    mark: U1
    gap: I8


def _reject_heads(plain: Flags, mark: U1, gap: I8, newlines: I8) -> None:
    """A line begins with a letter or is empty, and has no foreign characters."""
    heads = newlines[:-1]
    first = mark[heads + 1]
    plain &= (gap[heads] == 1) & ((first == _NEWLINE) | (first >= _LETTER))
    foreign = np.flatnonzero(mark == _OTHER)
    if len(foreign):
        plain[np.searchsorted(newlines, foreign) - 1] = False


def _fill(values: F8, plain: Flags, words: I8, per_line: I8, marks: _Marks) -> None:
    """Puts the values of all words into their cells; a line with a word that is not good is not plain."""
    count = values.shape[1]
    line = np.repeat(np.arange(count), per_line)
    column = marks.mark[words] & np.uint8(0x0F)
    value, good = _numbers(words, marks)
    if not good.all():
        plain[line[~good]] = False
        value[~good] = 0.0
    cell = line + column * np.int64(count)
    flat = values.reshape(-1)
    flat[cell] = value
    if len(flat) - np.count_nonzero(np.isnan(flat)) != len(words):
        plain &= np.count_nonzero(~np.isnan(values), axis=0) == per_line  # no letter twice
    numbered = np.flatnonzero(column == LETTERS.index("n"))
    if len(numbered):
        inside = numbered[numbered > 0]
        plain[line[inside[line[inside] == line[inside - 1]]]] = False  # N stands first


def _numbers(words: I8, marks: _Marks) -> tuple[F8, Flags]:
    """The value of each word, and whether it is a good number."""
    mark, gap = marks.mark, marks.gap
    after = mark[words + 1]
    minus = after == _MINUS
    signed = minus | (after == _PLUS)
    before_digits = words + signed
    whole = gap[before_digits] - 1
    end = before_digits + 1
    pointed = mark[end] == _POINT
    decimals = gap[end] - 1
    decimals *= pointed
    end += pointed
    close = mark[end]
    digits = whole + decimals
    good = (digits > 0) & (digits <= MAX_DIGITS) & ((close == _NEWLINE) | (close >= _LETTER))
    good &= (before_digits == words) | (gap[words] == 1)
    if not good.all():
        digits[~good] = decimals[~good] = 0
    mantissa = _mantissas(marks, end, digits, np.where(pointed, decimals, _NO_POINT))
    decimals += minus * np.int64(MAX_DIGITS + 1)
    return mantissa / _DIVISORS[decimals], good


def _mantissas(marks: _Marks, end: I8, digits: I8, decimals: I8) -> I8:
    """The digits of each word as one number. decimals: of those behind the point, or ``_NO_POINT``.

    end: the mark behind the word. Two windows hold all digits and the point: the last eight characters, and
    those before.
    """
    windows = np.ascontiguousarray(np.ndarray((len(marks.data) - _WINDOW + 1,), "<u8", marks.data, strides=(1,)))
    last = marks.at[end] - _WINDOW
    shown = np.minimum(decimals, _WINDOW)
    low = np.minimum(digits, _ROOM[shown])
    number = _digits(windows[last], shown * 9 + low)
    long = np.flatnonzero(digits > low)
    if len(long):
        behind = decimals[long] - _WINDOW
        behind[(behind < 0) | (behind > _WINDOW)] = _WINDOW
        rest = digits[long] - low[long]
        number[long] += _digits(windows[last[long] - _WINDOW], behind * 9 + rest) * _TENS[low[long]]
    return number


def _digits(window: U8, kept: I8) -> I8:
    """The number that the kept digits of each window are: neighbours are joined to pairs, pairs to fours, to eight."""
    part = window << np.uint64(8)
    part &= _BEFORE[kept]
    window &= _BEHIND[kept]
    part |= window
    part *= np.uint64(10 * (1 << 8) + 1)
    part >>= np.uint64(8)
    part &= np.uint64(0x00FF00FF00FF00FF)
    part *= np.uint64(100 * (1 << 16) + 1)
    part >>= np.uint64(16)
    part &= np.uint64(0x0000FFFF0000FFFF)
    part *= np.uint64(10_000 * (1 << 32) + 1)
    part >>= np.uint64(32)
    return part.view(np.int64)
