"""Another user holds as many connections as he can, and a daemon with few descriptors still stops, and says what is true."""

from __future__ import annotations

import json
import resource
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from tests.service.processes import Rig
from tests.service.strangers import NOBODY, as_nobody, connect_often, many_descriptors, needs_root, open_folder

pytestmark = [pytest.mark.realtime, needs_root]
HELD = 1139
SOFT = 1024
"""What systemd and most shells give."""


@pytest.fixture(params=["5002", str(NOBODY)], ids=["without a role", "who may watch"])
def rig(request: pytest.FixtureRequest) -> Iterator[Rig]:
    """A daemon whose socket another user may connect to, and which cannot have more descriptors than it begins with."""
    with open_folder() as folder:
        made = Rig(folder)
        config = {**yaml.safe_load(made.config.read_text()), "api": {"watch_group": request.param}}
        made.config.write_text(yaml.safe_dump(config))
        process = made.launch()
        resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (SOFT, SOFT))
        yield made
        for process in made.processes:
            process.close()


def _flood(path: Path, says: bytes) -> Callable[[], int]:
    return lambda: connect_often(path, HELD, says)


@pytest.mark.parametrize("says", [b"", b"GET /status HTTP/1.1\r\nHost: h\r\n"], ids=["silent", "half a request"])
def test_stop_and_estop_come_through(rig: Rig, says: bytes) -> None:
    rig.render()
    with many_descriptors(), as_nobody(_flood(rig.socket, says)) as held:
        assert int(held) > SOFT
        for word, state in (("stop", "off"), ("estop", "fault")):
            found = rig.command(word, "--json", "--socket", str(rig.socket))
            assert found.returncode == 0, found.stderr
            assert json.loads(found.stdout)["state"] == state
        assert (
            json.loads(rig.command("status", "--json", "--socket", str(rig.socket)).stdout)["fault"]["code"] == "estop"
        )
    log = rig.output.read_text()
    assert "Too many open files" not in log
    assert "Traceback" not in log
    assert rig.commands()[-1].split()[:2] == ["0.0", "0"]
