"""Whatever comes in, the answer is a configuration or a ConfigError, never another exception."""

from hypothesis import given, settings
from hypothesis import strategies as st

from hapticd.config import Config, ConfigError, apply_settings, parse_config, parse_yaml
from hapticd.config.keys import leaf_fields, valid_keys

words = st.sampled_from([part for key in valid_keys() for part in key.split(".")]) | st.text(max_size=5)
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.binary(max_size=2),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words | st.integers() | st.none(), inner, max_size=4),
    max_leaves=12,
)
yaml_text = st.lists(
    words | st.sampled_from([*"{}[]:,-#&*!|>'\"%@?\t\n ", ": ", "\n  ", "- ", "1e3", "<<"]), max_size=25
)


def outcome(error: ConfigError) -> str:
    assert error.problems
    assert str(error).splitlines() == [str(problem) for problem in error.problems]
    return str(error)


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(words, values, max_size=4) | values)
def test_any_plain_data(data: object) -> None:
    try:
        assert isinstance(parse_config(data, "request"), Config)
    except ConfigError as error:
        assert outcome(error).startswith("request: ")


@settings(max_examples=200, deadline=None)
@given(yaml_text)
def test_any_text(parts: list[str]) -> None:
    try:
        assert isinstance(parse_yaml("".join(parts), "lab.yaml"), Config)
    except ConfigError as error:
        assert outcome(error).startswith("lab.yaml: ")


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(st.sampled_from(sorted(leaf_fields())) | st.text(max_size=8), values, max_size=3))
def test_any_settings(changes: dict[str, object]) -> None:
    try:
        assert isinstance(apply_settings(Config(), changes), Config)
    except ConfigError as error:
        assert outcome(error).startswith("command line: ")
