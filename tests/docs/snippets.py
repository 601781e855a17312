"""Fenced blocks of the documentation: where each stands, in which language, and whether it asks to be run."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
GENERATED = {ROOT / "docs/reference/cli.md", ROOT / "docs/reference/config.md"}

_FENCE = re.compile(r"^(?P<indent> *)```(?P<language>\w*)[^\n]*\n(?P<body>.*?)^(?P=indent)```$", re.M | re.S)
_INDENTED = re.compile(r"(?:^    .*\n)+", re.M)
_RUN = re.compile(r"<!-- run(?:: (?P<pattern>.*?))? -->\n$")


@dataclass(frozen=True)
class Snippet:
    """One block. ``pattern`` is searched in the output of one that is run; None: it is not run."""

    page: Path
    line: int
    language: str
    body: str
    pattern: str | None

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def snippets(page: Path) -> list[Snippet]:
    """Every block of a page in order: the fenced ones, and indented ones as language ``""``."""
    text = page.read_text(encoding="utf-8")
    found = []
    for match in _FENCE.finditer(text):
        mark = _RUN.search(text, 0, match.start())
        pattern = (mark["pattern"] or "") if mark else None
        body = re.sub(f"^{match['indent']}", "", match["body"], flags=re.M)
        found.append(Snippet(page, _line(text, match.start()), match["language"], body, pattern))
    rest = _FENCE.sub(lambda match: re.sub(r"[^\n]+", "", match[0]), text)
    found += [
        Snippet(page, _line(rest, match.start()), "", match[0], None)
        for match in _INDENTED.finditer(rest)
        if "$ " in match[0] or "hapticd" in match[0]
    ]
    return sorted(found, key=lambda snippet: snippet.line)


def _line(text: str, offset: int) -> int:
    return text.count("\n", 0, offset) + 1


def hapticd_commands(snippet: Snippet) -> list[list[str]]:
    """The words after ``hapticd`` of every such command in a shell block or console transcript."""
    text = snippet.body.replace("\\\n", " ")
    lines = [line.strip() for line in text.splitlines()]
    if any(line.startswith("$ ") for line in lines):  # a transcript: only what is typed
        lines = [line[2:] for line in lines if line.startswith("$ ")]
    return [words for line in lines for words in _commands(line)]


def _commands(line: str) -> list[list[str]]:
    lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;<>()")
    lexer.whitespace_split = True
    lexer.commenters = "#"
    found: list[list[str]] = []
    words: list[str] = []
    for word in [*lexer, ";"]:
        if set(word) <= set("|&;<>()"):
            found += _from_hapticd(words)
            words = []
        else:
            words.append(word)
    return found


def _from_hapticd(words: list[str]) -> list[list[str]]:
    """What follows the program's name, behind prefixes such as ``sudo -u hapticd`` and ``if``."""
    names = [k for k, word in enumerate(words) if Path(word).name == "hapticd" and words[k - 1 : k] != ["-u"]]
    if not names or (words[0] not in ("sudo", "if", "time", "timeout") and names[0] != 0):
        return []
    return [words[names[0] + 1 :]]
