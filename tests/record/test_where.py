"""Conditions on recordings: ``runs --where``."""

from __future__ import annotations

import copy
from pathlib import Path

import pytest
from record_samples import CONFIG, make_rows

from hapticd.record import RunWriter, run_metadata
from hapticd.record.listing import listed
from hapticd.record.where import ConditionError, choose, read_condition


def recording(path: Path, subject: str | None, stiffness: float, note: str = "") -> Path:
    config = copy.deepcopy(dict(CONFIG))
    config["record"] = {"subject": subject}
    config["spring"] = {**config.get("spring", {}), "stiffness": stiffness}
    with RunWriter(path, {**run_metadata(config), "kind": "run", "label": "release"}) as writer:
        writer.write(make_rows(300))
        if note:
            writer.annotate({"event": "note", "text": note, "tick": 1})
        writer.annotate({"event": "marker", "name": "trial", "value": 3, "tick": 2})
        writer.write(make_rows(300))
    return path


@pytest.mark.parametrize(
    ("conditions", "left"),
    [
        (["subject=S07"], "a"),
        (["subject!=S07"], "bc"),
        (["spring.stiffness>0.015"], "bc"),
        (["spring.stiffness>0.015", "subject=S8"], "b"),
        (["spring.stiffness=2e-2"], "b"),
        (["note ~ SLIP"], "b"),
        (["note=trial 3"], "abc"),
        (["rows>=600"], "abc"),
        (["rows<600"], ""),
        (["file=c.arrow"], "c"),
        (["whole=true"], "abc"),
        (["condition!=x"], "abc"),
        (["condition~x"], ""),
    ],
)
def test_conditions(tmp_path: Path, conditions: list[str], left: str) -> None:
    paths = [
        recording(tmp_path / "a.arrow", "S07", 0.01),
        recording(tmp_path / "b.arrow", "S8", 0.02, "a slip of the hand"),
        recording(tmp_path / "c.arrow", None, 0.03),
    ]
    found = choose([listed(path) for path in paths], [read_condition(text) for text in conditions])
    assert "".join(each.path.stem for each in found) == left


def test_an_event_between_batches_has_its_rows_time(tmp_path: Path) -> None:
    found = listed(recording(tmp_path / "a.arrow", None, 0.01, "here"))
    rows = make_rows(300)
    for note in found.notes:
        assert note["row"] == 300
        assert note["after_s"] == pytest.approx(rows["time_s"][0] - rows["time_s"][0])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("subject", "is no condition"),
        ("subjekt=3", "did you mean subject?"),
        ("spring.stifness>1", "did you mean spring.stiffness?"),
        ("rows>many", "'many' is no number"),
    ],
)
def test_what_is_no_condition(text: str, said: str) -> None:
    with pytest.raises(ConditionError, match=said.replace("?", r"\?")):
        read_condition(text)
