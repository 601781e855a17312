"""The files of a reproduction: all there, whole, self-contained, and all or nothing."""

from __future__ import annotations

import base64
import json
import re
import struct
from html.parser import HTMLParser
from pathlib import Path

import pytest

from hapticd.reproduce import build
from hapticd.reproduce.build import BUILDERS, reproduce
from hapticd.reproduce.items import Item, Progress

from .conftest import Made

FIGURES = tuple(name for name in BUILDERS if name.startswith("fig"))


class Page(HTMLParser):
    """Ids, links and every address of a page, and whether its tags match."""

    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.addresses: list[str] = []
        self.tags: list[str] = []
        self.alts: list[str] = []
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("src", "href", "srcset", "action"):
                self.addresses.append(value or "")
            if name == "alt":
                self.alts.append(value or "")
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def page(made: Made) -> Page:
    parser = Page()
    parser.feed((made.folder / "index.html").read_text())
    return parser


def test_every_file_is_there_and_nothing_else(made: Made) -> None:
    wanted = {"index.html", "numbers.json"} | {f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")}
    assert {path.name for path in made.folder.iterdir()} == wanted == set(build.names_of_files())
    assert [path.name for path in made.folder.parent.iterdir()] == ["paper"]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_a_picture_with_something_in_it(made: Made, name: str) -> None:
    png = (made.folder / f"{name}.png").read_bytes()
    assert png.startswith(b"\x89PNG")
    width, height = struct.unpack(">II", png[16:24])
    assert width >= 900
    assert height >= 500
    assert len(png) > 20_000
    svg = (made.folder / f"{name}.svg").read_text()
    assert svg.count("<path") > 20


def test_the_page_needs_nothing_else(made: Made, page: Page) -> None:
    text = (made.folder / "index.html").read_text()
    assert re.findall(r"https?:|//[a-z]|@import|url\(", re.sub(r"base64,[^\"]*", "", text)) == []
    assert "script" not in page.tags
    assert all(address.startswith(("#", "data:image/svg+xml;base64,")) for address in page.addresses)
    for data in re.findall(r"base64,([^\"]*)", text):
        svg = base64.b64decode(data).decode()
        assert [
            link for link in re.findall(r'(?:href|src)="([^"]*)"', svg) if not link.startswith(("#", "data:"))
        ] == []


def test_the_page_has_a_section_for_every_item_and_links_that_lead_there(page: Page) -> None:
    assert page.ids == list(BUILDERS)
    links = [address[1:] for address in page.addresses if address.startswith("#")]
    assert set(links) == set(BUILDERS)
    assert page.open == []
    assert len(page.alts) == len(FIGURES)
    assert all(page.alts)


def test_the_page_is_readable_in_light_and_dark_and_names_the_traps(made: Made) -> None:
    text = (made.folder / "index.html").read_text()
    assert "prefers-color-scheme: dark" in text
    for trap in (
        "T = 1/3 ms",
        "b/(KT) = 0.01/(2400·10⁻³)",
        "(71) is garbled",
        "bound (46)",
        "(54): the last two terms",
    ):
        assert trap in text


def test_numbers_are_the_returned_document(made: Made) -> None:
    assert json.loads((made.folder / "numbers.json").read_text()) == made.document


def test_progress_rises_to_one(made: Made) -> None:
    assert made.progress == sorted(made.progress)
    assert made.progress[-1] == pytest.approx(1.0)


def test_only_makes_what_is_asked_for_twice_the_same(tmp_path: Path) -> None:
    first, second = tmp_path / "a", tmp_path / "b" / "c"
    for folder in (first, second):
        assert list(reproduce(folder, only=("fig9", "table1"))["items"]) == ["table1", "fig9"]
    names = {"index.html", "numbers.json", "fig9.png", "fig9.svg"}
    assert {path.name for path in first.iterdir()} == names
    assert all((first / name).read_bytes() == (second / name).read_bytes() for name in names)


def test_a_name_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no such table or figure: fig10; there are table1"):
        reproduce(tmp_path / "a", only=("fig10",))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("exists", [False, True])
def test_an_interrupt_leaves_the_folder_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool
) -> None:
    def interrupted(quick: bool, progress: Progress) -> Item:
        raise KeyboardInterrupt

    folder = tmp_path / "paper"
    if exists:
        folder.mkdir()
        (folder / "index.html").write_text("before")
    monkeypatch.setitem(build.BUILDERS, "fig4", (interrupted, 1.0))
    with pytest.raises(KeyboardInterrupt):
        reproduce(folder, only=("fig3", "fig4"))
    assert {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")} == (
        {"paper", "paper/index.html"} if exists else set()
    )
    assert not exists or (folder / "index.html").read_text() == "before"
