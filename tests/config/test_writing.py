"""Round trips, digest, schema, reference page, and what an import costs."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from docs.config_page import key_sections, reference_page
from hapticd.config import (
    Config,
    config_digest,
    config_schema,
    config_to_yaml,
    load_config,
    parse_config,
    parse_yaml,
    preset_names,
)
from hapticd.config.fields import is_quantity
from hapticd.config.keys import leaf_fields
from hapticd.config.sections import Correlation

ROOT = Path(__file__).parents[2]


def numbers(least: float, most: float, above: bool = False) -> st.SearchStrategy[float]:
    return floats(least, most, above) | st.integers(int(least) + above, int(most))


def floats(least: float, most: float, above: bool = False, below: bool = False) -> st.SearchStrategy[float]:
    return st.floats(least, most, exclude_min=above, exclude_max=below).filter(is_quantity)


limits = st.none() | numbers(0, 1e9)
plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=5,
)


@st.composite
def configurations(draw: st.DrawFn) -> dict[str, Any]:
    """Valid configurations, rotary and linear, with some sections left out."""
    rate = draw(numbers(1, 20_000))
    counts = draw(st.sampled_from(["counts_per_rev", "counts_per_metre"]))
    continuous = draw(limits)
    peak = draw(st.none() | floats(continuous or 0, 1e9))
    bits = draw(st.integers(0, 24))
    small = numbers(0, 1e6)
    sections: dict[str, Any] = {
        "servo": {
            "rate_hz": rate,
            "priority": draw(st.integers(1, 99)),
            "cpu": draw(st.none() | st.integers(0, 4095)),
            "require_realtime": draw(st.booleans()),
            "overrun": {
                "policy": draw(st.sampled_from(["skip", "hold", "fault"])),
                "fault_after": draw(st.none() | st.integers(0, 1_000_000)),
            },
        },
        "spring": {
            "stiffness": draw(small),
            "origin": draw(floats(-1e3, 1e3)),
            "half_tick_bias": draw(st.booleans()),
            "side": draw(st.sampled_from(["both", "positive", "negative"])),
        },
        "encoder": {
            counts: draw(numbers(1, 1e9)),
            "decimation": draw(st.integers(1, 2**31 - 1)),
            "invert": draw(st.booleans()),
        },
        "dither": {
            "target": draw(st.sampled_from(["none", "position"])),
            "waveform": draw(st.sampled_from(["sine", "triangle", "square", "uniform"])),
            "amplitude": draw(small),
            "frequency_hz": draw(floats(0, rate / 2, above=True, below=True)),
            "seed": draw(st.integers(0, 2**63 - 1)),
        },
        "delay": {"computation_s": draw(floats(0, 1))},
        "amplifier": {
            "torque_constant": draw(numbers(0, 1e6, above=True)),
            "continuous_current": continuous,
            "peak_current": peak,
            "bandwidth_hz": draw(st.none() | st.just(0) | floats(2, 1e9)),
            "dac_bits": bits,
            "dac_full_scale": draw(numbers(0, 1e3, above=bits > 0)),
        },
        "plant": {"inertia": draw(numbers(0, 1e6, above=True)), "viscous": draw(small), "coulomb": draw(small)},
        "hand": {"inertia": draw(small), "damping": draw(small), "stiffness": draw(small)},
        "driver": {**draw(st.dictionaries(st.text(), plain, max_size=3)), "name": draw(st.text(min_size=1))},
        "safety": {"max_velocity": draw(limits), "max_excursion": draw(limits)},
        "record": {"directory": draw(st.none() | st.sampled_from(["/a b/ç#", "runs: x", "null", "1e3", "yes", "~"]))},
        "api": {"mode": draw(st.sampled_from(["0600", "777"])), "group": draw(st.none() | st.text())},
    }
    kept = draw(st.sets(st.sampled_from(["hand", "driver", "safety", "record", "api", "delay", "spring"])))
    return {name: section for name, section in sections.items() if name not in kept}


@settings(max_examples=60, deadline=None)
@given(configurations())
def test_yaml_round_trip_is_exact(mapping: dict[str, Any]) -> None:
    config = parse_config(mapping, "generated")
    again = parse_yaml(config_to_yaml(config), "written")
    assert again == config
    assert again.driver.options == config.driver.options
    assert config_digest(again) == config_digest(config)
    assert config_to_yaml(again) == config_to_yaml(config)


@pytest.mark.parametrize("name", preset_names())
def test_presets_round_trip_and_other_yaml_readers_agree(name: str) -> None:
    config = load_config(name)
    text = config_to_yaml(config)
    assert parse_yaml(text, "written") == config
    assert parse_config(yaml.safe_load(text), "written") == config


def test_written_yaml_names_units() -> None:
    assert "  stiffness: 0.012  # N m/rad\n" in config_to_yaml(Config())
    assert "  stiffness: 14500  # N/m\n" in config_to_yaml(load_config("delta"))


def test_digest_tells_configurations_apart() -> None:
    digests = {config_digest(load_config(name)) for name in preset_names()}
    assert len(digests) == len(preset_names())
    assert all(len(digest) == 12 and int(digest, 16) >= 0 for digest in digests)


def test_digest_is_of_meaning_not_of_writing() -> None:
    same = [
        "servo: {rate_hz: 1000}",
        "servo: {rate_hz: 1e3}",
        "spring: {origin: -0.0}",
        "{record: {directory: /elsewhere}, api: {socket: /tmp/other}}",
    ]
    assert {config_digest(parse_yaml(text, "x")) for text in same} == {config_digest(Config())}
    assert config_digest(parse_yaml("driver: {name: loopback, seed: 1}", "x")) != config_digest(Config())


def test_schema_documents_every_key() -> None:
    schema = config_schema()
    json.dumps(schema, allow_nan=False)
    for model in schema["$defs"].values():
        for name, field in model["properties"].items():
            assert field.get("description"), name
    undocumented = [key for key, field in leaf_fields().items() if not field.description]
    assert undocumented == []


def test_schema_carries_units_limits_and_nulls() -> None:
    schema = config_schema()
    servo, plant, amplifier = (schema["$defs"][name]["properties"] for name in ("Servo", "Plant", "Amplifier"))
    rate = servo["rate_hz"]
    assert (rate["unit"], rate["minimum"], rate["maximum"], rate["default"]) == ("Hz", 1, 20_000, 1000.0)
    assert (plant["inertia"]["unit"], plant["inertia"]["unit_linear"]) == ("kg m²", "kg")
    assert amplifier["bandwidth_hz"]["type"] == ["number", "null"]
    assert schema["properties"]["servo"]["anyOf"] == [{"$ref": "#/$defs/Servo"}, {"type": "null"}]
    assert schema["additionalProperties"] is False
    assert "stribeck" in schema["$defs"]["Effect"]["properties"]["name"]["enum"]
    assert "default" not in schema["$defs"]["Api"]["properties"]["socket"]


def test_every_number_has_a_unit_or_needs_none() -> None:
    schema = config_schema()
    bare = {
        f"{model}.{name}"
        for model, content in schema["$defs"].items()
        for name, field in content["properties"].items()
        if "unit" not in field
        and {"number", "integer"} & {str(part.get("type")) for part in field.get("anyOf", [field])}
    }
    correlations = {f"Correlation.{name}" for name in Correlation.model_fields}
    assert bare == {"Servo.priority", "Servo.cpu", "Dither.seed", "Amplifier.damping_ratio", *correlations}


def test_reference_page_is_up_to_date() -> None:
    page = (ROOT / "docs/reference/config.md").read_text(encoding="utf-8")
    assert page == reference_page(), "run: python -m docs.make_pages"


def test_reference_page_has_every_key() -> None:
    page = key_sections()
    assert [key for key in leaf_fields() if f"| `{key}` |" not in page] == []


def test_import_loads_no_compiled_code() -> None:
    code = "import hapticd.config, sys; print([m for m in ('numba', 'numpy', 'scipy', 'pyarrow') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[]"
