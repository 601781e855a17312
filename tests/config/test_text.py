"""Numbers in words."""

import pytest

from hapticd.config.text import jitter, legible, significant


@pytest.mark.parametrize(
    ("seconds", "period_s", "said"),
    [
        (4.66e-16, 2e-3, "jitter below 0.01 % of a period"),
        (6.05e-3, 5e-3, "jitter 6050 µs (121 % of a period)"),
        (1e-4, 2e-3, "jitter 100 µs (5 % of a period)"),
        (2e-6, None, "jitter 2 µs"),
    ],
)
def test_jitter(seconds: float, period_s: float | None, said: str) -> None:
    assert jitter(seconds, period_s) == said


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (0.012345, "0.0123"),
        (999.6, "1000"),
        (1000.0, "1000"),
        (12345.0, "12300"),
        (2.54e-6, "2.54e-06"),
        (1e15, "1e+15"),
    ],
)
def test_a_number_has_three_digits_and_no_exponent_below_10_to_the_15(value: float, said: str) -> None:
    assert significant(value) == said
    assert significant(-value) == f"-{said}"


def test_a_text_for_a_terminal_has_no_control_characters_and_an_end() -> None:
    assert legible("a\nb") == "a\nb"
    assert legible("a\x1b[2Jb\nc") == "a\\x1b[2Jb\nc"
    assert legible("a" * 20_000) == "a" * 20_000
    assert legible("abcde", 5) == "abcde"
    assert legible("abcdef", 5) == "abcd…"
