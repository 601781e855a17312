"""Wrong requests: each with its status, its code and its exact message; none of them reaches the daemon's state."""

import json
import logging
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from hapticd.client import Client, DaemonUnreachable
from hapticd.service.refusals import DriverFailure, Refused

from .fake_control import FAULT, FakeControl, renew, serve

TOO_LARGE = json.dumps({"settings": {"spring.stiffness": "9" * 70_000}})

PATH = 'path: the daemon has its own working directory: give an absolute path, got "run.arrow"'

WRONG = [
    ("GET", "/nothing", "", 404, "not_found", "no such path: /nothing; /openapi.json lists them all"),
    ("GET", "/estop", "", 405, "method", "GET is not the method of /estop"),
    ("POST", "/status", "", 405, "method", "POST is not the method of /status"),
    ("POST", "/release", "", 422, "request", "a JSON body is needed (Content-Type: application/json)"),
    ("POST", "/release", "{}", 422, "request", "missing field 'deflection'"),
    ("POST", "/release", "[1]", 422, "request", "the body must be a JSON object (Content-Type: application/json)"),
    (
        "POST",
        "/release",
        '{"deflection": 1',
        400,
        "json",
        "the body is not valid JSON: Expecting ',' delimiter at character 16",
    ),
    ("POST", "/release", "[" * 60_000, 400, "json", "the body cannot be read as JSON"),
    ("POST", "/release", b'{"deflection": "\xff"}', 400, "json", "the body cannot be read as JSON"),
    ("POST", "/release", '{"deflection": NaN}', 422, "request", "deflection: input should be a finite number, got NaN"),
    (
        "POST",
        "/release",
        '{"deflection": 1e999}',
        422,
        "request",
        "deflection: input should be a finite number, got Infinity",
    ),
    (
        "POST",
        "/release",
        '{"deflection": "20"}',
        422,
        "request",
        'deflection: input should be a valid number, got "20"',
    ),
    (
        "POST",
        "/release",
        '{"deflection": true}',
        422,
        "request",
        "deflection: input should be a valid number, got true",
    ),
    (
        "POST",
        "/release",
        '{"deflection": 2e9}',
        422,
        "request",
        "deflection: input should be less than or equal to 1000000000, got 2000000000.0",
    ),
    (
        "POST",
        "/release",
        '{"deflction": 1}',
        422,
        "request",
        "missing field 'deflection'; "
        "unknown field 'deflction'; did you mean 'deflection'? (fields: deflection, duration_s, force)",
    ),
    (
        "POST",
        "/release",
        '{"deflection": 1, "duration_s": 0}',
        422,
        "request",
        "duration_s: input should be greater than 0, got 0",
    ),
    ("POST", "/start", '{"now": true}', 422, "request", "unknown field 'now' (fields: force)"),
    (
        "POST",
        "/excite",
        '{"name": "chrip"}',
        422,
        "excitation",
        "excitation 'chrip' is unknown (known: ramp, sweep, chirp, steps, release, all)",
    ),
    (
        "POST",
        "/excite",
        '{"name": "chirp", "amplitude": 50}',
        422,
        "excitation",
        "chirp: amplitude = 50: must be at most 2 A (amplifier.continuous_current)",
    ),
    (
        "POST",
        "/excite",
        '{"name": "chirp", "frequency": 3}',
        422,
        "request",
        "unknown field 'frequency' (fields: name, amplitude, duration_s, low_hz, high_hz, seed, force)",
    ),
    ("POST", "/set", "{}", 422, "request", "missing field 'settings'"),
    (
        "POST",
        "/set",
        '{"settings": {}}',
        422,
        "request",
        "settings: dictionary should have at least 1 item after validation, not 0, got {}",
    ),
    (
        "POST",
        "/set",
        '{"settings": {"amplifier.dac_bits": 12}}',
        409,
        "restart_needed",
        "amplifier.dac_bits: cannot change while the daemon runs; edit the config and restart",
    ),
    (
        "POST",
        "/set",
        '{"settings": {"dither": {"amplitude": 1}}}',
        422,
        "request",
        'settings.dither: input should be a number, text, true, false or null, got {"amplitude": 1}',
    ),
    ("POST", "/set", TOO_LARGE, 413, "too_large", "the body is longer than 65536 bytes"),
    ("POST", "/record/start", '{"path": "run.arrow"}', 422, "request", PATH),
    ("POST", "/record/stop", "", 409, "recording", "nothing is being recorded"),
    ("POST", "/reload", '{"path": "omega"}', 502, "driver", "reload failed: no board answers on /dev/ttyUSB0"),
]


@dataclass(frozen=True)
class Served:
    """A stand-in for the daemon that answers, and two ways to ask it."""

    control: FakeControl
    client: Client
    raw: httpx.Client


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    path, control = tmp_path_factory.mktemp("api") / "h.sock", FakeControl()
    transport = httpx.HTTPTransport(uds=str(path))
    with serve(control, path) as client, httpx.Client(transport=transport, base_url="http://h") as raw:
        yield Served(control, client, raw)


@pytest.fixture
def control(served: Served) -> FakeControl:
    """The stand-in, as at its start."""
    renew(served.control, served.client)
    return served.control


@pytest.fixture
def raw(served: Served, control: FakeControl) -> httpx.Client:
    return served.raw


@pytest.mark.parametrize(("method", "path", "body", "status", "code", "message"), WRONG)
def test_wrong_request(
    raw: httpx.Client, method: str, path: str, body: str | bytes, status: int, code: str, message: str
) -> None:
    reply = raw.request(method, path, content=body, headers={"content-type": "application/json"})
    assert (reply.status_code, reply.json()) == (status, {"error": {"code": code, "message": message}})


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"servo.rate": 500}, "servo.rate"),
        ({"servo.rate_hz": "fast"}, "servo.rate_hz"),
        ({"servo.rate_hz": -1}, "servo.rate_hz"),
        ({"spring.stiffness": ".nan"}, "spring.stiffness"),
        ({"encoder.decimation": 1.5}, "encoder.decimation"),
    ],
)
def test_wrong_setting_names_its_key(
    raw: httpx.Client, control: FakeControl, settings: dict[str, Any], key: str
) -> None:
    before = control.resolved
    reply = raw.post("/set", json={"settings": settings})
    error = reply.json()["error"]
    assert (reply.status_code, error["code"]) == (422, "config")
    assert error["problems"][0]["key"] == key
    assert key in error["message"]
    assert error["message"].startswith("request: ")
    assert control.resolved is before


def test_non_finite_setting_is_refused_before_the_daemon(raw: httpx.Client, control: FakeControl) -> None:
    json_type = {"content-type": "application/json"}
    reply = raw.post("/set", content='{"settings": {"spring.stiffness": Infinity}}', headers=json_type)
    message = "settings.spring.stiffness: input should be a finite number, got Infinity"
    assert (reply.status_code, reply.json()) == (422, {"error": {"code": "request", "message": message}})
    assert control.calls == []


def test_body_that_is_too_large_and_of_unknown_length(raw: httpx.Client, control: FakeControl) -> None:
    reply = raw.post("/set", content=(b"x" * 1000 for _ in range(100)))
    assert (reply.status_code, reply.json()["error"]["code"]) == (413, "too_large")
    assert control.calls == []


def test_body_of_another_type_is_refused(raw: httpx.Client) -> None:
    reply = raw.post("/release", content="deflection=1", headers={"content-type": "application/x-www-form-urlencoded"})
    message = "the body must be a JSON object (Content-Type: application/json)"
    assert (reply.status_code, reply.json()) == (422, {"error": {"code": "request", "message": message}})


def test_refusal_of_the_daemon_is_passed_on(raw: httpx.Client, control: FakeControl) -> None:
    control.fault = FAULT
    reply = raw.post("/start")
    message = "a fault is latched (over_speed); check the rig, then 'hapticd clear'"
    assert (reply.status_code, reply.json()) == (409, {"error": {"code": "fault", "message": message}})


@pytest.mark.parametrize(
    ("failure", "status"), [(Refused("busy", "no"), 409), (DriverFailure("no"), 502), (RuntimeError("secret"), 500)]
)
def test_failures_have_their_status_and_no_traceback(
    raw: httpx.Client, control: FakeControl, failure: Exception, status: int, caplog: pytest.LogCaptureFixture
) -> None:
    control.fails_with = failure
    with caplog.at_level(logging.ERROR):
        reply = raw.post("/clear")
    assert reply.status_code == status
    assert set(reply.json()["error"]) == {"code", "message"}
    assert "Traceback" not in reply.text
    assert "secret" not in reply.text
    assert ("secret" in caplog.text) == (status == 500)


def test_what_answers_but_is_no_daemon_is_said_to_be_none(tmp_path: Path) -> None:
    path = tmp_path / "h.sock"
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        server.listen()

        def greet() -> None:
            peer, _ = server.accept()
            with peer:
                peer.recv(4096)
                peer.sendall(b"HTTP/1.1 200 OK\r\nContent-Length: 5\r\nConnection: close\r\n\r\nhello")

        thread = threading.Thread(target=greet)
        thread.start()
        with pytest.raises(DaemonUnreachable) as failure:
            Client(path).status()
        thread.join()
    assert str(failure.value) == f"what answers on {path} is not hapticd (HTTP 200)"
