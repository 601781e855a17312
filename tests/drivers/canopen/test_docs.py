"""The pages about CANopen say what the code does."""

from __future__ import annotations

import math
import re
from dataclasses import fields
from pathlib import Path

import pytest
import yaml

from drivers import DriverConfigError
from drivers.canopen import bus_load
from drivers.canopen.options import Options
from drivers.canopen.profile import FOLDER, Profile, load_profile

DOCS = Path(__file__).parents[3] / "docs"


def test_table_of_rates() -> None:
    page = (DOCS / "how-to/canopen-drive.md").read_text()
    bitrates = [int(cell.replace(" ", "")) for cell in page.split("| bit/s |")[1].split("\n")[0].strip(" |").split("|")]
    rates = [int(cell) for cell in page.split("at a watchdog of 100 ms |")[1].split("\n")[0].strip(" |").split("|")]
    assert [math.floor(bus_load.fastest_rate_hz(bitrate)) for bitrate in bitrates] == rates


def test_every_option_and_key_is_described() -> None:
    page = (DOCS / "how-to/canopen-drive.md").read_text()
    assert [item.name for item in fields(Options) if f"`{item.name}" not in page] == []
    page = (DOCS / "reference/canopen-profile.md").read_text()
    assert [key for key in Profile.model_fields if f"`{key}`" not in page] == []


def test_the_example_is_a_profile(tmp_path: Path) -> None:
    page = (DOCS / "reference/canopen-profile.md").read_text()
    (example,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "lab.yaml").write_text(example)
    profile, eds = load_profile(str(tmp_path / "lab.yaml"))
    assert (profile.guarding, eds) == ("heartbeat", tmp_path / "lab_drive.eds")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"position": 99}, "position: Input should be greater than or equal to 4096, not 99 (0x63)"),
        ({"postion": 0x6063}, "postion: Extra inputs are not permitted"),
        ({"modes": []}, "modes: "),
        ({"actual": {"object": 0x221C, "unit": "amperes"}}, "actual.unit: Input should be 'centiampere'"),
        ({"guarding": None}, "guarding: Input should be 'node_guarding' or 'heartbeat'"),
    ],
)
def test_wrong_profiles(tmp_path: Path, change: dict[str, object], text: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(yaml.safe_load((FOLDER / "copley.yaml").read_text()) | change))
    with pytest.raises(DriverConfigError) as caught:
        load_profile(str(path))
    assert str(caught.value).startswith(f"{path}: not a drive profile: ")
    assert text in str(caught.value)


@pytest.mark.parametrize("text", ["- 1\n", "a: [\n", "\xff"])
def test_files_that_are_no_profiles(tmp_path: Path, text: str) -> None:
    path = tmp_path / "mine.yaml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(DriverConfigError, match=re.escape(str(path))):
        load_profile(str(path))
