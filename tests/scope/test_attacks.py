"""Attacks on the scope: each tries what must not work, beside what must."""

from __future__ import annotations

import http.client
import json
import threading
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from hapticd.scope.access import Access, Names
from hapticd.scope.lease import KEPT_S, Lease
from hapticd.scope.serve import MAX_MESSAGE_BYTES, is_loopback, open_in_browser
from tests.polling import wait_until
from tests.service import fake_control
from tests.service.fake_control import FakeControl

from .served import CLIENT, Served, serve


def socket_to(scope: Served, path: str = "state", *, origin: str | None = None, host: str | None = None) -> Any:
    headers = {} if host is None else {"Host": host}
    return connect(
        f"ws://127.0.0.1:{scope.port}/ws/{path}",
        origin=origin or scope.origin,  # type: ignore[arg-type]
        additional_headers=headers,
        open_timeout=20,
    )


def hello(connection: ClientConnection, token: str | None, client: str = CLIENT) -> dict[str, Any]:
    connection.send(json.dumps({"token": token, "client": client}))
    message: dict[str, Any] = json.loads(connection.recv(timeout=20))
    return message


def take(scope: Served) -> None:
    assert scope.post("lease", {"take": True}).json() == {"mine": True, "free": False}


def commands(control: FakeControl) -> list[str]:
    return [call[0] for call in control.calls]


def test_the_page_itself_may_command(scope: Served, control: FakeControl) -> None:
    take(scope)
    assert scope.post("start", {"force": False}).json()["state"] == "running"
    assert scope.post("stop").status_code == 200
    assert commands(control) == ["start", "stop"]


@pytest.mark.parametrize(
    "token", [None, "Bearer ", "Bearer x", "Basic {}", "Bearer {} ", "bearer\t{}", "{}", "Bearer {}é"]
)
@pytest.mark.parametrize("name", ["stop", "estop", "start", "set", "preview", "lease"])
def test_without_the_token_nothing_is_done(scope: Served, control: FakeControl, name: str, token: str | None) -> None:
    given = token and token.replace("{}", str(scope.access.control_token))
    request = http.client.HTTPConnection("127.0.0.1", scope.port, timeout=20)
    headers = {"Content-Type": "application/json"} | (
        {"Authorization": given.encode().decode("latin-1")} if given else {}
    )
    request.request("POST", f"/api/{name}", "{}", headers)
    reply = request.getresponse()
    if token == "Bearer {} ":  # a header's trailing blank is no part of it (RFC 9110, 5.5)
        assert reply.status != 401
    else:
        assert reply.status == 401
        assert control.calls == []
    request.close()


def test_a_cookie_or_a_query_is_no_token(scope: Served, control: FakeControl) -> None:
    token = scope.access.control_token
    url = f"{scope.origin}/api/stop?token={token}"
    headers = {"Cookie": f"token={token}", "Content-Type": "application/json"}
    assert httpx.post(url, content=b"{}", headers=headers).status_code == 401
    assert control.calls == []


def test_two_authorization_headers_are_none(scope: Served, control: FakeControl) -> None:
    good = ("Authorization", f"Bearer {scope.access.control_token}")
    reply = httpx.post(f"{scope.origin}/api/stop", headers=[good, ("Authorization", "Bearer x")])
    assert reply.status_code == 401
    assert control.calls == []


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{}", "127.0.0.1", "127.0.0.1:1", "localhost.:{}", ""])
def test_a_rebound_name_is_refused(scope: Served, control: FakeControl, host: str) -> None:
    name = host.format(scope.port)
    assert scope.post("stop", Host=name).status_code in (400, 403)
    assert httpx.get(scope.origin, headers={"Host": name}).status_code in (400, 403)
    with pytest.raises(InvalidStatus) as refused, socket_to(scope, host=name):
        pass
    assert refused.value.response.status_code in (400, 403)
    assert control.calls == []


def test_the_names_of_loopback_are_allowed(scope: Served) -> None:
    for name in ("127.0.0.1", "localhost", "LOCALHOST", "[::1]"):
        assert httpx.get(scope.origin, headers={"Host": f"{name}:{scope.port}"}).status_code == 200


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "https://127.0.0.1:{}", "http://127.0.0.1:1", "null", "http://127.0.0.1:{}.evil.example"],
)
def test_another_origin_is_refused_whatever_its_token(scope: Served, control: FakeControl, origin: str) -> None:
    foreign = origin.format(scope.port)
    assert scope.post("stop", Origin=foreign).status_code == 403
    for path in ("state", "rows"):
        with pytest.raises(InvalidStatus) as refused, socket_to(scope, path, origin=foreign):
            pass
        assert refused.value.response.status_code == 403
    assert control.calls == []


def test_an_origin_that_agrees_with_a_foreign_host_is_refused(scope: Served) -> None:
    """The list of origins is not derived from Host: a rebound name would agree with itself."""
    name = f"evil.example:{scope.port}"
    with pytest.raises(InvalidStatus), socket_to(scope, origin=f"http://{name}", host=name):
        pass
    assert scope.post("stop", Host=name, Origin=f"http://{name}").status_code == 403


def test_a_websocket_without_an_origin_is_refused(scope: Served) -> None:
    with pytest.raises(InvalidStatus), connect(f"ws://127.0.0.1:{scope.port}/ws/state"):
        pass


@pytest.mark.parametrize("path", ["state", "rows"])
@pytest.mark.parametrize("first", ["", "x", "[]", "{}", '{"token": null}', '{"token": 1, "client": "abcdefgh"}'])
def test_a_websocket_without_a_token_says_nothing(scope: Served, path: str, first: str) -> None:
    with socket_to(scope, path) as connection:
        connection.send(first)
        with pytest.raises(ConnectionClosed) as closed:
            connection.recv(timeout=20)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 4401


def test_a_websocket_that_stays_silent_is_closed(scope: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hapticd.scope.sockets.HELLO_TIMEOUT_S", 0.2)
    with socket_to(scope) as connection, pytest.raises(ConnectionClosed):
        connection.recv(timeout=20)


def test_a_long_first_message_is_refused(scope: Served) -> None:
    with socket_to(scope) as connection:
        connection.send(
            json.dumps({"token": scope.access.control_token, "client": CLIENT, "pad": "x" * MAX_MESSAGE_BYTES})
        )
        with pytest.raises(ConnectionClosed) as closed:
            connection.recv(timeout=20)
    assert closed.value.sent is not None
    assert closed.value.sent.code == 1009


@pytest.mark.parametrize("media_type", [None, "text/plain", "application/x-www-form-urlencoded", "multipart/form-data"])
def test_what_a_form_can_send_is_refused(scope: Served, control: FakeControl, media_type: str | None) -> None:
    take(scope)
    assert scope.post("start", Content_Type=media_type).status_code == 415
    assert control.calls == []


def test_no_page_of_another_origin_is_told_that_it_may(scope: Served) -> None:
    headers = {"Origin": "http://evil.example", "Access-Control-Request-Method": "POST"}
    reply = httpx.options(f"{scope.origin}/api/stop", headers=headers)
    assert reply.status_code in (403, 405)
    own = httpx.options(f"{scope.origin}/api/stop", headers={**headers, "Origin": scope.origin})
    for found in (reply, own, scope.post("stop")):
        assert not [name for name in found.headers if name.startswith("access-control")]


def test_commands_are_posts(scope: Served, control: FakeControl) -> None:
    headers = {"Authorization": f"Bearer {scope.access.control_token}"}
    for name in ("stop", "estop", "start"):
        assert httpx.get(f"{scope.origin}/api/{name}", headers=headers).status_code == 405
    assert control.calls == []


def test_every_answer_carries_the_policy(scope: Served) -> None:
    for reply in (httpx.get(scope.origin), httpx.get(f"{scope.origin}/nothing"), scope.post("stop"), scope.post("x")):
        policy = reply.headers["content-security-policy"]
        assert policy.startswith("default-src 'self'; frame-ancestors 'none'")
        assert "unsafe" not in policy
        assert reply.headers["x-content-type-options"] == "nosniff"
        assert "set-cookie" not in reply.headers


def test_a_forwarding_header_changes_nothing(scope: Served, control: FakeControl) -> None:
    for name in ("X-Forwarded-For", "X-Real-IP", "Forwarded"):
        assert scope.post("stop", Authorization=None, **{name: "127.0.0.1"}).status_code == 401
    assert scope.post("stop", Host="evil.example", X_Forwarded_Host=f"127.0.0.1:{scope.port}").status_code == 403
    assert control.calls == []


def test_who_may_look_may_not_touch(scope: Served, control: FakeControl) -> None:
    view = f"Bearer {scope.access.view_token}"
    for name in (
        "stop",
        "estop",
        "start",
        "clear",
        "set",
        "release",
        "sequence",
        "excite",
        "record",
        "note",
        "marker",
        "lease",
    ):
        reply = scope.post(name, {"take": True}, Authorization=view)
        assert (reply.status_code, reply.json()["error"]["code"]) == (403, "view_only")
    assert control.calls == []
    with socket_to(scope) as connection:
        assert hello(connection, scope.access.view_token)["lease"] == {"mine": False, "free": True, "may": False}
        asked = {"settings": {"spring.stiffness": 1.0}, "deflection": {"text": "10.3", "unit": "ticks"}}
        reply = scope.post("preview", asked, Authorization=view)
        assert reply.status_code == 200


def test_view_only_has_no_control_token(control: FakeControl, tmp_path: Path) -> None:
    path = tmp_path / "h.sock"
    with fake_control.serve(control, path), serve(path, access=Access(control_token=None)) as scope:
        for given in ("Bearer None", "Bearer", f"Bearer {scope.access.view_token}"):
            assert scope.post("stop", Authorization=given).status_code in (401, 403)
    assert control.calls == []


def test_tokens_of_two_starts_differ_and_are_long() -> None:
    one, other = Access(), Access()
    tokens = {one.control_token, one.view_token, other.control_token, other.view_token}
    assert len(tokens) == 4
    assert all(len(str(token)) >= 32 for token in tokens)


def test_only_the_holder_of_the_controls_commands_but_anybody_stops(scope: Served, control: FakeControl) -> None:
    take(scope)
    for name in ("start", "clear", "set", "release", "sequence", "excite", "record"):
        reply = scope.post(name, X_Client="another-page-altogether")
        assert (reply.status_code, reply.json()["error"]["code"]) == (409, "lease")
    assert control.calls == []
    assert scope.post("stop", X_Client=None).status_code == 200
    assert scope.post("estop", X_Client="another-page-altogether").status_code == 200


def test_a_page_is_not_told_another_pages_name(scope: Served) -> None:
    with socket_to(scope) as mine, socket_to(scope) as other:
        assert hello(mine, scope.access.control_token)["lease"]["mine"]
        seen = hello(other, scope.access.control_token, "another-page-altogether")
    assert seen["lease"] == {"mine": False, "free": False, "may": True}
    assert CLIENT not in json.dumps(seen)


def test_the_controls_outlast_a_reload_and_no_longer() -> None:
    now = [0.0]
    lease = Lease(lambda: now[0])
    assert lease.claim("one")
    lease.gone("one")
    now[0] = KEPT_S
    assert not lease.claim("two")
    assert lease.claim("one")
    lease.gone("one")
    now[0] += KEPT_S + 0.1
    assert lease.claim("two")
    assert lease.claim("one", take_over=True)
    assert not lease.held_by("two")


def test_a_stop_passes_a_command_that_hangs(scope: Served, control: FakeControl) -> None:
    take(scope)
    control.gate.clear()
    with httpx.Client(timeout=60) as other:
        hanging = threading.Thread(target=lambda: scope.post("start", {"force": False}))
        hanging.start()
        assert control.waiting.wait(20)
        assert other.post(
            f"{scope.origin}/api/stop", headers={"Authorization": f"Bearer {scope.access.control_token}"}
        ).is_success
        assert "stop" in commands(control)
        control.gate.set()
        hanging.join(20)


@pytest.mark.parametrize(
    "path", ["../app.py", "%2e%2e/app.py", "..%2f..%2faccess.py", "vendor/../../app.py", "/etc/passwd", "%2fetc/passwd"]
)
def test_files_outside_the_page_are_not_served(scope: Served, path: str) -> None:
    request = http.client.HTTPConnection("127.0.0.1", scope.port, timeout=20)
    for folder in ("static", "faults"):
        request.request("GET", f"/{folder}/{path}")
        reply = request.getresponse()
        assert reply.status == 404
        assert b"import" not in reply.read()
    request.close()


def test_a_body_too_large_is_refused(scope: Served, control: FakeControl) -> None:
    take(scope)
    assert scope.post("set", {"settings": {"spring.stiffness": "9" * 70_000}}).status_code == 413
    assert control.calls == []


@pytest.mark.parametrize("body", [[], {"settings": 1}, {"settings": {}, "more": 1}, {}])
def test_a_body_of_another_form_is_refused(scope: Served, control: FakeControl, body: Any) -> None:
    take(scope)
    assert scope.post("set", body).status_code == 422
    assert control.calls == []


def test_a_file_that_is_no_run_is_refused_in_words(scope: Served) -> None:
    for content in ({"not": "a run"}, "x" * 1000):
        reply = scope.post("open", content, Content_Type="application/vnd.apache.arrow.stream")
        assert reply.status_code == 422
        assert "not a run file" in reply.json()["error"]["message"]
    reply = scope.post("save", "x" * 1000, Content_Type="application/vnd.hapticd.frames")
    assert reply.status_code in (409, 422)


def test_connections_that_vanish_leave_nothing(scope: Served, control: FakeControl) -> None:
    for _ in range(50):
        with socket_to(scope, "rows") as connection:
            connection.send(json.dumps({"token": scope.access.control_token, "client": CLIENT}))
    hub = scope.server.hub
    wait_until(lambda: scope.server.connections == 0 and not hub.rows and not control.live.watched, "an idle scope")
    assert hub._relay is None


def test_another_origin_can_be_allowed_and_must_be_one() -> None:
    names = Names.of("127.0.0.1", 8765, ("http://localhost:9000",))
    assert "localhost:9000" in names.hosts
    assert "http://localhost:9000" in names.origins
    for wrong in ("localhost:9000", "http://", "http://a/b", "ftp://a", "http://a/", "*"):
        with pytest.raises(ValueError, match="is not an origin"):
            Names.of("127.0.0.1", 8765, (wrong,))
    assert not {name for name in Names.of("0.0.0.0", 8765).hosts if "0.0.0.0" in name}


def test_only_loopback_is_loopback() -> None:
    assert all(map(is_loopback, ("127.0.0.1", "127.8.8.8", "::1", "localhost")))
    assert not any(map(is_loopback, ("0.0.0.0", "192.168.1.2", "lab-pc", "::", "localhost.evil.example")))


def test_the_token_is_in_no_command_line(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[str] = []
    monkeypatch.setattr("webbrowser.open", seen.append)
    path = open_in_browser("http://127.0.0.1:1/#secret&<>")
    try:
        assert "secret" not in seen[0]
        assert path.stat().st_mode & 0o777 == 0o600
        assert "url=http://127.0.0.1:1/#secret&amp;&lt;&gt;" in path.read_text()
    finally:
        path.unlink()
