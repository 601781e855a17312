"""The control API under requests that schemathesis makes; the attack asks a real daemon."""

from __future__ import annotations

import os
from pathlib import Path

import httpx
import pytest
import yaml

from hapticd.config import load_config
from hapticd.control.endpoints import JsonDict
from hapticd.service.api import ApiServer, openapi_document
from hapticd.service.daemon import Daemon
from hapticd.service.latch import FaultLatch
from hapticd.service.socket import bind
from hapticd.servo.authority import Command
from tests.hostile.api import Attack, State
from tests.service.fake_control import FakeControl, serve


def test_no_request_ends_in_a_failure_or_changes_something_and_is_refused(tmp_path: Path) -> None:
    control = FakeControl()
    with serve(control, tmp_path / "h.sock"):
        report = Attack(control, tmp_path / "h.sock", 5, examples=5).run(200)
    assert report.requests >= 200
    assert not [status for status in report.answers if status >= 500]
    assert {200, 400, 422} <= report.answers.keys()
    assert report.findings == {}


@pytest.mark.attack
@pytest.mark.timeout(0)
def test_no_request_harms_a_daemon(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))  # as a service: no request can write elsewhere
    socket, source = tmp_path / "h.sock", tmp_path / "rig.yaml"
    wanted = {
        "servo": {"overrun": {"fault_after": None}},
        "safety": {"heartbeat_timeout_s": 10},
        "record": {"directory": str(tmp_path / "runs"), "enabled": False},
        "api": {"socket": str(socket)},
    }
    source.write_text(yaml.safe_dump(wanted))
    daemon = Daemon(load_config(str(source)), str(source), FaultLatch(socket))
    server = ApiServer(daemon, bind(socket))
    server.start()
    try:
        report = Attack(daemon, socket, int(os.environ.get("SEED", "12"))).run(int(os.environ.get("REQUESTS", "20000")))
    finally:
        server.stop()
        daemon.shutdown()
    assert report.findings == {}


class Careless(FakeControl):
    """Changes something before it refuses."""

    def set(self, settings: JsonDict, force: bool = False, *, command: Command | None = None) -> JsonDict:
        self.fault = {"code": "estop", "cause": "careless", "help": ""}
        return super().set(settings, force, command=command)


def test_a_change_by_a_refused_request_would_be_seen(tmp_path: Path) -> None:
    control = Careless()
    with serve(control, tmp_path / "h.sock"):
        report = Attack(control, tmp_path / "h.sock", 5, path="/set").run(100)
    assert "POST /set: an error that changed something" in report.findings


def test_a_state_that_an_experiment_changes_is_its_own_matter() -> None:
    running, off, too_fast = ("running", None, 0), ("off", None, 0), ("fault", "over_speed", 5)
    before = State("a", 1, 2, True, running)
    assert before.same_as(State("a", 3, 2, False, off))
    assert not State("a", 1, 2, False, off).same_as(State("a", 3, 2, False, off))
    assert not State("a", 1, 2, False, running).same_as(State("a", 1, 2, False, off))
    assert not before.same_as(State("b", 1, 2, True, running))
    assert State("a", 1, 2, False, running).same_as(State("a", 1, 2, False, too_fast))
    assert not State("a", 1, 2, False, off).same_as(State("a", 1, 2, False, too_fast))


def test_replies_are_described_as_what_they_are() -> None:
    for path, methods in openapi_document()["paths"].items():
        for operation in methods.values():
            for code, reply in operation["responses"].items():
                for kind, content in reply.get("content", {}).items():
                    if kind == "application/json":
                        assert content.get("schema", {}).get("type") != "string", (path, code)


def test_the_wrong_method_is_answered_with_the_right_one(tmp_path: Path) -> None:
    with (
        serve(FakeControl(), tmp_path / "h.sock"),
        httpx.Client(transport=httpx.HTTPTransport(uds=str(tmp_path / "h.sock")), base_url="http://h") as client,
    ):
        reply = client.get("/estop")
    assert (reply.status_code, reply.headers["allow"]) == (405, "POST")


@pytest.mark.parametrize(
    "body", [b"[" * 60_000, b'{"settings": {"spring.stiffness": ' + b"9" * 5000 + b"}}", b"\xff\xfe{}"]
)
def test_bodies_that_no_generator_makes(tmp_path: Path, body: bytes) -> None:
    control = FakeControl()
    with (
        serve(control, tmp_path / "h.sock"),
        httpx.Client(transport=httpx.HTTPTransport(uds=str(tmp_path / "h.sock")), base_url="http://h") as client,
    ):
        reply = client.post("/set", content=body, headers={"content-type": "application/json"})
    assert (reply.status_code, control.calls) == (400, [])


def test_a_key_that_is_no_unicode_is_refused_as_any_other(tmp_path: Path) -> None:
    with (
        serve(FakeControl(), tmp_path / "h.sock"),
        httpx.Client(transport=httpx.HTTPTransport(uds=str(tmp_path / "h.sock")), base_url="http://h") as client,
    ):
        body = b'{"settings": {"\\udb8a": 1}}'
        reply = client.post("/set", content=body, headers={"content-type": "application/json"})
    assert (reply.status_code, reply.json()["error"]["code"]) == (422, "config")
