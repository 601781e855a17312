"""The pages about faults, ``docs/faults``: beside the package in a checkout, among the data files of an installation."""

from __future__ import annotations

import re
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parents[1] / "docs" / "faults"
_INSTALLED = "share/doc/hapticd/faults/"
_CODE = re.compile(r"[a-z_]{1,40}")


def fault_pages() -> dict[str, Path]:
    """The page of every fault's code, by code; empty where they were not installed."""
    if CHECKOUT.is_dir():
        pages = list(CHECKOUT.glob("*.md"))
    else:
        try:
            listed = files("hapticd") or ()
        except PackageNotFoundError:
            listed = ()
        pages = [Path(str(entry.locate())) for entry in listed if _INSTALLED in str(entry)]
    return {page.stem: page for page in sorted(pages) if _CODE.fullmatch(page.stem) and page.is_file()}


def fault_page(code: str) -> str | None:
    """The text of a fault's page, Markdown; None where there is no such fault."""
    page = fault_pages().get(code)
    return None if page is None else page.read_text(encoding="utf-8")
