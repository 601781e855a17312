"""Mutations of bytes and of text: one valid file in, one file out that is wrong in a place or two."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

_WORD = re.compile(r"[^\s{}\[\],:#=]+")
_BOUNDARIES = (0, 1, -1, 2**7, 2**15 - 1, 2**16, 2**31 - 1, -(2**31), 2**32 - 1, 2**40, 2**63 - 1, -(2**63))
_LONGEST = 1 << 18

SCALARS = (
    "0", "-0.0", "1", "-1", "0.5", "2", "3.7", "1e-3", "5e-324", "1e-300", "1e308", "-1e308", "1e999", ".inf",
    "-.inf", ".nan", "NaN", "Infinity", "null", "true", "false", "~", "2147483648", "9007199254740993",
    "18446744073709551616", "1_000", "0x10", "0b1", "0o17", "1:30", "2026-01-01", "{}", "[]", "[[[]]]", "{a:1}",
    "9" * 400, "9" * 5000, "0x" + "f" * 5000, "-" + "9" * 30, "x" * 5000, "[1, 2]", "{a: 1}", "{? [a] : 1}", "''",
    '""', "'\\0'", '"\\u0000"', '"\\e[31m"', "*a", "&a 1", "!!python/object:os.system x", "!!binary aGk=", "!x y",
    "µ", "\U0001f600", "a.b", "../x", "/dev/zero", "~nobody/x", "%(x)s", "$NODEID+1", "- 1", "---", "...",
    "%YAML 9.9", "-", "?", "|", ">", "@", "`", "<<", "\t", "\x85", "\ufeff", "\x7f",
)  # fmt: skip
"""What somebody may write where a value or a name belongs."""


def mutated(chance: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """The bytes with one to four mutations.

    Args:
        chance: source of randomness. data: a valid file. others: files of the same kind, for splices.
    """
    for _ in range(chance.choice((1, 1, 1, 2, 4))):
        data = chance.choice(_OF_BYTES)(chance, data, chance.choice(others))[:_LONGEST]
    return data


def mutated_text(chance: random.Random, data: bytes, others: Sequence[bytes]) -> bytes:
    """As `mutated`, for a text: mostly words and lines, sometimes bytes."""
    if chance.random() < 0.2:
        return mutated(chance, data, others)
    text = data.decode()
    for _ in range(chance.choice((1, 1, 1, 2, 4, 8))):
        text = chance.choice(_OF_TEXT)(chance, text, chance.choice(others).decode())[:_LONGEST]
    return text.encode(errors="surrogatepass")


def _span(chance: random.Random, size: int) -> slice:
    begin = chance.randrange(size + 1)
    return slice(begin, min(size, begin + int(2 ** chance.uniform(0, 10))))


def _flip(chance: random.Random, data: bytes, _: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8))):
        if changed:
            changed[chance.randrange(len(changed))] ^= 1 << chance.randrange(8)
    return bytes(changed)


def _integer(chance: random.Random, data: bytes, _: bytes) -> bytes:
    """A number at its limits, as large as it is a length, an offset or a count somewhere."""
    size = chance.choice((1, 2, 4, 8))
    value = chance.choice((*_BOUNDARIES, len(data), len(data) + 1, chance.getrandbits(32)))
    word = (value % (1 << 8 * size)).to_bytes(size, chance.choice(("little", "big")))
    at = chance.randrange(len(data) + 1)
    at -= at % chance.choice((1, size))
    return data[:at] + word + data[at + size :]


def _cut(chance: random.Random, data: bytes, _: bytes) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def _remove(chance: random.Random, data: bytes, _: bytes) -> bytes:
    span = _span(chance, len(data))
    return data[: span.start] + data[span.stop :]


def _repeat(chance: random.Random, data: bytes, _: bytes) -> bytes:
    span = _span(chance, len(data))
    return data[: span.stop] + data[span] * chance.choice((1, 2, 100)) + data[span.stop :]


def _zero(chance: random.Random, data: bytes, _: bytes) -> bytes:
    span = _span(chance, len(data))
    return data[: span.start] + chance.choice((b"\0", b"\xff")) * (span.stop - span.start) + data[span.stop :]


def _noise(chance: random.Random, data: bytes, _: bytes) -> bytes:
    span = _span(chance, len(data))
    return data[: span.start] + chance.randbytes(span.stop - span.start) + data[span.stop :]


def _splice(chance: random.Random, data: bytes, other: bytes) -> bytes:
    return data[: chance.randrange(len(data) + 1)] + other[chance.randrange(len(other) + 1) :]


_OF_BYTES: tuple[Callable[[random.Random, bytes, bytes], bytes], ...] = (
    *(_flip, _flip, _integer, _integer, _cut),
    *(_remove, _repeat, _zero, _noise, _splice),
)


def _replace_word(chance: random.Random, text: str, _: str) -> str:
    words = list(_WORD.finditer(text))
    if not words:
        return chance.choice(SCALARS)
    word = chance.choice(words)
    return text[: word.start()] + chance.choice(SCALARS) + text[word.end() :]


def _swap_words(chance: random.Random, text: str, other: str) -> str:
    words, theirs = list(_WORD.finditer(text)), _WORD.findall(other)
    if not (words and theirs):
        return text
    word = chance.choice(words)
    return text[: word.start()] + chance.choice(theirs) + text[word.end() :]


def _misspell(chance: random.Random, text: str, _: str) -> str:
    at = chance.randrange(len(text) + 1)
    return text[:at] + chance.choice("{}[]:,-#&*!|>'\"%@?\t\n =;aZ09._\0\x1b\u0130") + text[at + chance.randrange(2) :]


def _lines(chance: random.Random, text: str, other: str) -> str:
    """A line goes, stands twice, moves in or out, or comes from elsewhere."""
    lines, theirs = text.split("\n"), other.split("\n")
    at = chance.randrange(len(lines))
    what = chance.randrange(5)
    if what == 0:
        del lines[at]
    elif what == 1:
        lines.insert(at, lines[at])
    elif what == 2:
        lines[at] = " " * chance.randrange(5) + lines[at]
    elif what == 3:
        lines[at] = lines[at].lstrip()
    else:
        lines.insert(at, chance.choice(theirs))
    return "\n".join(lines)


def _many(chance: random.Random, text: str, _: str) -> str:
    """A line many times, each with another key."""
    lines = text.split("\n")
    at = chance.randrange(len(lines))
    line = lines[at]
    count = min(int(2 ** chance.uniform(0, 14)), _LONGEST // (len(line) + 1) + 1)
    head = len(line) - len(line.lstrip(" -{["))
    lines[at : at + 1] = [f"{line[:head]}k{n}{line[head:]}" for n in range(count)]
    return "\n".join(lines)


def _deep(chance: random.Random, text: str, _: str) -> str:
    depth = int(2 ** chance.uniform(0, 12))
    begin, end = chance.choice((("[", "]"), ("{a: ", "}"), ("- ", ""), ("? ", ""), ("&a [*a, ", "]"), ("!!seq [", "]")))
    at = chance.randrange(len(text) + 1)
    return text[:at] + begin * depth + chance.choice(SCALARS) + end * chance.choice((depth, 0)) + text[at:]


def _aliases(chance: random.Random, text: str, _: str) -> str:
    """The billion laughs, or one that contains itself."""
    rows = [
        "a0: &a0 [x, x]",
        *(f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}, *a{n - 1}]" for n in range(1, chance.choice((3, 30)))),
    ]
    return "\n".join([text, *rows, chance.choice(("", "b: {<<: *a1}", "c: &c {d: *c}", "<<: [*a0, *a1]"))])


_OF_TEXT: tuple[Callable[[random.Random, str, str], str], ...] = (
    *(_replace_word, _replace_word, _replace_word, _replace_word, _swap_words, _swap_words),
    *(_misspell, _misspell, _lines, _lines, _many, _deep, _aliases),
)
