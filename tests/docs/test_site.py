"""The documentation as a site: it builds, a broken link or anchor is an error, and reading it asks nobody for anything."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import typer

from hapticd.cli.main import build_app
from hapticd.cli.man import commands
from hapticd.config.keys import leaf_fields

from .snippets import PAGES, ROOT

SOUGHT = (
    "aarch64, backlash, calibration, cogging, emergency stop, EtherCAT, jitter, latency, license, max velocity, PID, "
    "PREEMPT RT, Raspberry Pi, ROS, torque ripple, tune, uninstall, upgrade"
)
"""What users type into the search."""
PROGRAM = dict(commands(typer.main.get_command(build_app()), "hapticd"))


def build(root: Path, site: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(site)]
    return subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=200, check=False)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    shutil.copy(ROOT / "mkdocs.yml", tmp_path)
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    (tmp_path / "hapticd").symlink_to(ROOT / "hapticd")  # the API page is made from the docstrings
    return tmp_path


def test_site_has_every_page_loads_nothing_from_elsewhere_and_is_found_by_users_words(tmp_path: Path) -> None:
    done = build(ROOT, tmp_path)
    assert done.returncode == 0, done.stderr
    made = {page.relative_to(tmp_path).with_suffix("") for page in tmp_path.rglob("*.html")}
    for page in PAGES[1:]:
        name = page.relative_to(ROOT / "docs").with_suffix("")
        assert (name.with_name("index") if name.name == "README" else name) in made
    help_page = (tmp_path / "reference" / "cli.html").read_text(encoding="utf-8")
    for path, command in PROGRAM.items():
        assert f'id="{path.replace(" ", "-")}"' in help_page
        options = [max(parameter.opts, key=len) for parameter in command.params]
        assert [name for name in options if name.startswith("--") and name not in help_page] == [], path
    settings = (tmp_path / "reference" / "config.html").read_text(encoding="utf-8")
    assert [key for key in leaf_fields() if f"<code>{key}</code>" not in settings] == []
    html = (tmp_path / "index.html").read_text(encoding="utf-8")
    loaded = re.findall(r'<(?:link|script|img|iframe)\b[^>]*(?:href|src)="(https?:)?//', html)
    assert loaded == []
    index = json.loads((tmp_path / "search" / "search_index.json").read_text(encoding="utf-8"))
    separator = index["config"]["separator"]
    sections = [set(re.split(separator, f"{part['title']} {part['text']}".lower())) for part in index["docs"]]
    assert [
        words for words in SOUGHT.split(", ") if not any({*words.lower().split()} <= section for section in sections)
    ] == []


def test_broken_links_and_anchors_and_a_page_outside_the_navigation_are_errors(source: Path) -> None:
    complaints = {
        "[gone](how-to/gone.md)": "a link 'how-to/gone.md', but the target is not found",
        "[gone](how-to/install.md#gone)": "does not contain an anchor '#gone'",
        "[outside](../README.md)": "a link '../README.md', but the target is not found",
        "[absolute](/how-to/install.md)": "an absolute link '/how-to/install.md'",
    }
    page = source / "docs" / "index.md"
    page.write_text("\n\n".join((page.read_text(encoding="utf-8"), *complaints)), encoding="utf-8")
    (source / "docs" / "how-to" / "lost.md").write_text("# Lost\n")
    done = build(source, source / "site")
    assert done.returncode != 0
    for complaint in (*complaints.values(), 'not included in the "nav" configuration:\n  - how-to/lost.md'):
        assert complaint in done.stderr
    assert done.stderr.count("WARNING -") == len(complaints) + 1
    assert f"Aborted with {len(complaints) + 1} warnings" in done.stdout


def test_every_fault_is_on_the_troubleshooting_page() -> None:
    text = (ROOT / "docs/how-to/troubleshoot.md").read_text(encoding="utf-8")
    for page in (ROOT / "docs/faults").glob("[a-z]*.md"):
        assert f"[{page.stem}](../faults/{page.name})" in text


@pytest.mark.parametrize("page", ["README.md", "systemd/README.md"])
def test_links_of_pages_outside_the_site_lead_to_files(page: str) -> None:
    source = ROOT / page
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", source.read_text(encoding="utf-8"))
    assert [link for link in links if not (source.parent / link).exists()] == []
