"""Numbers in words."""

import pytest

from hapticd.config.text import jitter


@pytest.mark.parametrize(
    ("seconds", "period_s", "said"),
    [
        (4.66e-16, 2e-3, "jitter below 0.01 % of a period"),
        (6.05e-3, 5e-3, "jitter 6050 µs (121 % of a period)"),
        (2e-6, None, "jitter 2 µs"),
    ],
)
def test_jitter(seconds: float, period_s: float | None, said: str) -> None:
    assert jitter(seconds, period_s) == said
