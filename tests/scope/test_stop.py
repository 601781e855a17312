"""The page's stop where the daemon's API is silent: the stop channel is asked first, and what it says is told."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.service.stop_listener import mute_api, stop_channel

from .served import serve


@pytest.mark.parametrize(("word", "state"), [("stop", "off"), ("estop", "fault")])
def test_a_stop_that_only_the_channel_answers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, word: str, state: str
) -> None:
    monkeypatch.setattr("hapticd.client.client.STOPPED_TIMEOUT_S", 0.1)
    path = tmp_path / "h.sock"
    with mute_api(path), stop_channel(path, state.encode()) as heard, serve(path) as scope:
        reply = scope.post(word)
    assert (reply.status_code, reply.json()["state"]) == (200, state)
    assert reply.json()["unanswered"].startswith(f"{state}: zero current; the API did not answer: ")
    assert heard == [word.encode()]


def test_a_stop_that_nobody_confirms_is_refused_in_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "h.sock"
    with mute_api(path), stop_channel(path, b"late"), serve(path) as scope:
        scope.server.client.timeout_s = 0.1
        reply = scope.post("stop")
    assert reply.status_code == 502
    assert reply.json()["error"]["message"].endswith("to be sure, cut the power of the amplifier")
