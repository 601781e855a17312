"""The rows as a Foxglove WebSocket server, with a client of the protocol written from its specification."""

from __future__ import annotations

import contextlib
import json
import os
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets import Subprotocol
from websockets.sync.client import ClientConnection, connect

from hapticd.cli.main import main
from hapticd.record.frames import Context
from hapticd.record.mcap import MESSAGE, TOPIC
from hapticd.record.schema import Rows, empty_rows
from tests.polling import PATIENCE_S, wait_until

from .browser import Testbed

MESSAGE_DATA = 0x01
SUBPROTOCOL = Subprotocol("foxglove.sdk.v1")


def rows(count: int, first: int) -> Rows:
    made = empty_rows(count)
    made["tick"] = first + np.arange(count)
    made["time_s"] = made["tick"] * 1e-3
    made["encoder_counts"] = -made["tick"]
    made["current_command_A"] = 0.25
    return made


def subscribe(connection: ClientConnection) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the server says of itself, and its channel, subscribed to."""
    info = channel = None
    while info is None or channel is None:
        said = json.loads(connection.recv(10))
        if said["op"] == "serverInfo":
            info = said
        elif said["op"] == "advertise":
            channel = next(each for each in said["channels"] if each["topic"] == TOPIC)
    connection.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel["id"]}]}))
    return info, channel


def message(connection: ClientConnection) -> tuple[int, bytes]:
    """Time in ns and payload of the next message."""
    while True:
        data = connection.recv(PATIENCE_S)
        if isinstance(data, bytes) and data[0] == MESSAGE_DATA:
            _, stamp = struct.unpack_from("<IQ", data, 1)
            return stamp, data[13:]


def test_rows_come_as_they_are_and_nothing_can_be_asked() -> None:
    pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    from hapticd.scope.foxglove import FoxgloveServer

    server = FoxgloveServer("127.0.0.1", 0)
    try:
        with connect(f"ws://127.0.0.1:{server.port}", subprotocols=[SUBPROTOCOL]) as connection:
            info, channel = subscribe(connection)
            assert not {"clientPublish", "parameters", "services"} & set(info["capabilities"])
            assert (channel["encoding"], channel["schemaName"], channel["schemaEncoding"]) == (
                "cdr",
                MESSAGE,
                "ros2msg",
            )
            assert "float64 current_command_a  # A" in channel["schema"]
            heard = False
            while not heard:  # the subscription is on its way
                server.log(rows(1, 0), Context(0, 0, 1, 1e-3, 0, 1_600_000_000.0))
                with contextlib.suppress(TimeoutError):
                    heard = bool(connection.recv(0.1))
            server.log(rows(3, 100), Context(100, 0, 1, 1e-3, 0, 1_700_000_000.5))
            first = next(each for each in iter(lambda: message(connection), None) if each[0] > 1_650_000_000 * 10**9)
            found = [first, message(connection), message(connection)]
            assert [stamp for stamp, _ in found] == pytest.approx(
                [1_700_000_000_498_000_000, 1_700_000_000_499_000_000, 1_700_000_000_500_000_000], abs=1000
            )
            for number, (_, payload) in enumerate(found):
                assert payload[:4] == b"\x00\x01\x00\x00"
                tick, time_s, counts, _, current = struct.unpack_from("<qdqqd", payload, 4)
                assert (tick, time_s, counts, current) == (
                    100 + number,
                    pytest.approx(0.1 + number * 1e-3),
                    -tick,
                    0.25,
                )
    finally:
        server.close()


def test_the_command_serves_the_daemons_rows(shared: Testbed, tmp_path: Path) -> None:
    pytest.importorskip("foxglove", reason="the extra foxglove is not installed")
    # the library may lie where only this process looks
    environment = {**shared.environment, "PYTHONPATH": os.pathsep.join(sys.path)}
    words = ["scope", "--socket", str(shared.socket), "--port", "0", "--foxglove", "0", "--json"]
    with (tmp_path / "out").open("w") as out:
        process = subprocess.Popen([sys.executable, "-m", "hapticd.cli", *words], stdout=out, env=environment)
    try:
        wait_until(lambda: "pid" in (tmp_path / "out").read_text(), "the scope's URLs")
        url = json.loads((tmp_path / "out").read_text())["foxglove"]
        with connect(url, subprotocols=[SUBPROTOCOL]) as connection:
            subscribe(connection)
            ticks = [struct.unpack_from("<q", message(connection)[1], 4)[0] for _ in range(500)]
        steps = np.diff(ticks)
        assert (steps >= 1).all()
        assert np.median(steps) == 1
    finally:
        process.terminate()
        process.wait(15)


def test_without_the_library_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    assert main(["scope", "--foxglove", "0", "--port", "0", "--socket", str(tmp_path / "h.sock")]) == 2
    assert "pip install 'hapticd[foxglove]'" in capsys.readouterr().err
