"""Whatever comes in, the answer is a configuration or a ConfigError, never another exception."""

from collections.abc import Callable

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
    words | st.sampled_from([*"{}[]:,-#&*!|>'\"%@?\t\n", ": ", "\n  ", "- ", "1e3", "<<"]), max_size=25
)


def complaint(parse: Callable[[], Config]) -> str | None:
    """What is said of wrong input, checked to be one line a problem; None for good input."""
    try:
        parse()
    except ConfigError as error:
        lines = [str(problem) for problem in error.problems]
        if str(error).splitlines() != lines:
            return f"not one line a problem: {lines}"
        return str(error)
    return None


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(words, values, max_size=4) | values)
def test_any_plain_data(data: object) -> None:
    said = complaint(lambda: parse_config(data, "request"))
    assert said is None or said.startswith("request: ")


@settings(max_examples=200, deadline=None)
@given(yaml_text)
def test_any_text(parts: list[str]) -> None:
    said = complaint(lambda: parse_yaml("".join(parts), "lab.yaml"))
    assert said is None or said.startswith("lab.yaml: ")


@settings(max_examples=200, deadline=None)
@given(st.dictionaries(st.sampled_from(sorted(leaf_fields())) | st.text(max_size=8), values, max_size=3))
def test_any_settings(changes: dict[str, object]) -> None:
    said = complaint(lambda: apply_settings(Config(), changes))
    assert said is None or said.startswith("command line: ")
