"""A sequence as a file."""

from __future__ import annotations

import pytest

from hapticd.config import ConfigError, load_config
from hapticd.config.units import UnitError
from hapticd.servo.sequence import read_sequence

FILE = """
name: stiffness
deflection: 30deg
duration_s: 2
repeat: 2
steps:
  - {spring.stiffness: 0.008, encoder.decimation: 2}
  - {deflection: 5, duration_s: 500ms}
"""


def test_a_file_is_a_request() -> None:
    fields = read_sequence(FILE, "s.yaml").request(load_config(None))
    assert fields["name"] == "stiffness"
    assert len(fields["steps"]) == 4
    first, second = fields["steps"][:2]
    assert first["deflection"] == pytest.approx(8192 / 12 / 2)  # of the step's own ticks
    assert first["settings"] == {"spring.stiffness": 0.008, "encoder.decimation": 2}
    assert second == {"deflection": 5, "settings": {}, "duration_s": 0.5}
    assert first["duration_s"] == 2.0


def test_a_bare_list_will_do() -> None:
    assert read_sequence("[{spring.stiffness: 0.01}]", "s").request(load_config(None))["steps"] == [
        {"deflection": 10.3, "settings": {"spring.stiffness": 0.01}}
    ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3", "contains no sequence"),
        ("name: a", "steps"),
        ("steps: []", "steps"),
        ("steps: [{spring.stifness: 1}]", "did you mean spring.stiffness?"),
        ("steps: [{amplifier.dac_bits: 8}]", "steps.1.amplifier.dac_bits"),
        ("steps: [{deflection: fast}]", "steps.1.deflection"),
        ("steps: [{duration_s: -1}]", "steps.1.duration_s"),
        ("steps: [{}]\nrepeat: 501", "500"),
        ("steps: [{}]\nrepeet: 2", "did you mean repeat?"),
    ],
)
def test_what_is_wrong_is_named(text: str, said: str) -> None:
    with pytest.raises(ConfigError) as error:
        read_sequence(text, "s.yaml")
    assert said in str(error.value)


def test_a_unit_of_another_device() -> None:
    with pytest.raises(UnitError):
        read_sequence("steps: [{deflection: 3mm}]", "s").request(load_config(None))
