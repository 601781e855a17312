"""Every format says every effect, in one way or another, and the command says how."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest

from docs.make_pages import model_formats
from hapticd.effects.catalogue import OWN_SLUGS
from hapticd.export import FORMATS, SUFFIXES, TABLE, Format, sayings
from tests.cli.conftest import Run, hapticd
from tests.export.cases import PARAMETERS

__all__ = ["hapticd"]


@pytest.mark.parametrize("to", FORMATS)
def test_each_effect_is_said_and_what_is_not_exact_is_explained(to: Format) -> None:
    assert set(TABLE[to]) == set(OWN_SLUGS) == set(PARAMETERS)
    for said in TABLE[to].values():
        assert bool(said.where) == (said.how != "refused")
        assert bool(said.why) == (said.how != "exact")


def test_the_reference_page_is_current() -> None:
    page = Path(__file__).parents[2] / "docs" / "reference" / "model-formats.md"
    assert page.read_text(encoding="utf-8") == model_formats(), "run: python -m docs.make_pages"


def test_a_law_from_outside_is_refused() -> None:
    assert sayings(["a_law_of_yours"], "python")["a_law_of_yours"].how == "refused"


@pytest.mark.parametrize("to", FORMATS)
def test_the_command_says_it_all(to: Format, hapticd: Run, tmp_path: Path) -> None:
    if to == "fmu":
        pytest.importorskip("pythonfmu")
    effects = [{"name": slug, **PARAMETERS[slug]} for slug in OWN_SLUGS if slug != "flexible_coupling"]
    config = tmp_path / "rig.yaml"
    config.write_text(json.dumps({"plant": {"effects": effects}}))
    done = hapticd("model", "export", str(config), "--to", to, "--json")
    assert done.code == 0
    document = done.document
    assert document["output"] == str(tmp_path / f"rig{SUFFIXES[to]}")
    assert {said["effect"]: said["how"] for said in document["effects"]} == {
        slug: TABLE[to][slug].how for slug in OWN_SLUGS if slug != "flexible_coupling"
    }
    refused = [slug for slug in OWN_SLUGS if TABLE[to][slug].how == "refused"]
    assert all(slug in done.err for slug in refused)
    assert ("left out" in done.err) == bool(refused)
    if to != "fmu":
        text = Path(document["output"]).read_text()
        assert all(f"{slug}: " in text for slug in PARAMETERS if slug != "flexible_coupling")


def test_what_is_not_known_of_the_driver_is_said(hapticd: Run, tmp_path: Path) -> None:
    config = tmp_path / "rig.yaml"
    config.write_text(json.dumps({"driver": {"name": 'a-->"""\\'}}))
    for to in ("mjcf", "python"):
        done = hapticd("model", "export", str(config), "--to", to)
        assert done.code == 0
        assert "its latency is not known" in done.err
    compile((tmp_path / "rig.py").read_text(), "rig.py", "exec")
    ElementTree.parse(tmp_path / "rig.xml")


def test_a_file_that_is_there_stays(hapticd: Run, tmp_path: Path) -> None:
    config, module = tmp_path / "rig.yaml", tmp_path / "rig_mujoco.py"
    config.write_text("{}")
    module.write_text("mine")
    done = hapticd("model", "export", str(config), "--to", "mjcf")
    assert done.code == 2
    assert f"{module} exists" in done.err
    assert module.read_text() == "mine"
    assert hapticd("model", "export", str(config), "--to", "mjcf", "--force").code == 0
    assert "mine" not in module.read_text()
    done = hapticd("model", "export", str(config), "--to", "python", "-o", str(config), "--force")
    assert done.code == 2
    assert "is the file that is read" in done.err
