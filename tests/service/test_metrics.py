"""Metrics of a real daemon, read with Prometheus' own parser."""

from __future__ import annotations

from pathlib import Path

import pytest
from prometheus_client.parser import text_string_to_metric_families

from tests.polling import wait_until
from tests.service.daemons import daemon_on, state_home, wait_for_state

__all__ = ["state_home"]


def values(text: str) -> dict[tuple[str, tuple[tuple[str, str], ...]], float]:
    families = text_string_to_metric_families(text)
    return {(s.name, tuple(sorted(s.labels.items()))): s.value for family in families for s in family.samples}


@pytest.mark.realtime
def test_metrics_follow_the_daemon(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with daemon_on(monkeypatch, tmp_path) as (daemon, _devices):
        daemon.start()
        wait_until(lambda: daemon.status()["timing"]["ticks"] > 200, "200 ticks")
        found = values(daemon.metrics())
        status = daemon.status()
        assert 200 < found["hapticd_ticks_total", ()] <= status["timing"]["ticks"]
        assert found["hapticd_state", (("state", "running"),)] == 1.0
        assert found["hapticd_state", (("state", "fault"),)] == 0.0
        # Every tick is in the histogram, and the bounds are cumulative.
        bounds = [value for (name, _), value in found.items() if name == "hapticd_lateness_seconds_bucket"]
        assert bounds == sorted(bounds)
        count = found["hapticd_lateness_seconds_count", ()]
        assert bounds[-1] == count
        # The histogram is read a moment after the ticks, while the loop goes on.
        assert found["hapticd_ticks_total", ()] - 2 <= count <= status["timing"]["ticks"] + 2
        daemon.estop()
        wait_for_state(daemon, "fault")
        wait_until(
            lambda: values(daemon.metrics()).get(("hapticd_faults_total", (("code", "estop"),))) == 1.0, "the fault"
        )
        daemon.clear()
