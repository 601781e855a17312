"""Hooks of the site's build: whole folders in the navigation, and the references of commands and settings."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any


def on_config(config: Any) -> Any:
    """Replace every navigation entry ``folder/`` by the folder's pages, its README first."""
    config.nav = _expanded(config.nav, Path(config.docs_dir))
    return config


def on_page_markdown(markdown: str, /, *, page: Any, config: Any, files: Any) -> str:
    """Put what is made from the program where the pages of commands and settings have their marks."""
    if page.file.src_uri not in ("reference/cli.md", "reference/config.md"):
        return markdown
    sys.path.insert(0, str(Path(config.config_file_path).parent))
    from docs import config_page, make_pages

    markdown = markdown.replace(make_pages.SECTIONS, make_pages.command_sections())
    return markdown.replace(config_page.SECTIONS, config_page.key_sections())


def _expanded(entry: Any, root: Path) -> Any:
    if isinstance(entry, list):
        parts: list[Any] = []
        for part in entry:
            found = _expanded(part, root)
            parts += found if isinstance(part, str) and isinstance(found, list) else [found]
        return parts
    if isinstance(entry, dict):
        return {title: _expanded(part, root) for title, part in entry.items()}
    if not entry.endswith("/"):
        return entry
    pages = sorted((root / entry).glob("*.md"), key=lambda page: (page.name != "README.md", page.name))
    if not pages:
        raise ValueError(f"mkdocs.yml, nav: {entry} holds no page")
    return [page.relative_to(root).as_posix() for page in pages]
