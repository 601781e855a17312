"""The protocol page cut into statements, and the mark by which a test says which of them it proves."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs" / "protocols" / "serial-dac.md"
_SENTENCE = re.compile(r"(?<=[.;])\s+(?=[A-Z`“\"(*])")


def cites(*quotes: str) -> pytest.MarkDecorator:
    """The test proves every statement of the page that contains one of these quotes."""
    return pytest.mark.cites(*quotes)


def plain(text: str) -> str:
    """Without emphasis, code marks, link targets and line breaks."""
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return re.sub(r"\s+", " ", re.sub(r"[*`]", "", text)).strip(" |")


def statements(page: str) -> list[str]:
    """Sentences of prose and lists, rows of tables without their heads, lines of code blocks."""
    found: list[str] = []
    prose: list[str] = []
    lines = page.splitlines()
    in_code = False

    def end_prose() -> None:
        found.extend(_SENTENCE.split(plain(" ".join(prose))) if prose else [])
        prose.clear()

    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        text = line.strip()
        if text.startswith("```"):
            end_prose()
            in_code = not in_code
        elif in_code or text.startswith("|"):
            end_prose()
            is_head = following.strip().startswith("|--") or text.startswith("|--")
            if text and not is_head:
                found.append(plain(text))
        elif not text or text.startswith("#"):
            end_prose()
        else:
            if re.match(r"(- |\d+\. )", text):
                end_prose()
            prose.append(re.sub(r"^(- |\d+\. )", "", text))
    end_prose()
    return found
