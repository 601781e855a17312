"""Commands that talk to a daemon: what they send, what they print, how they exit."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from hapticd.client import Client
from hapticd.service.refusals import DriverFailure, Refused

from ..service.fake_control import ADMITTED, FAULT, FakeControl, serve
from .conftest import Run

JSON_COMMANDS = [
    ("status",),
    ("start",),
    ("stop",),
    ("estop",),
    ("clear",),
    ("reload",),
    ("set", "spring.stiffness=0.02"),
    ("release", "--deflection", "20.3"),
    ("release", "--deflection", "20.3", "--no-wait"),
    ("excite", "chirp", "--amplitude", "0.2"),
    ("record", "start"),
]


@pytest.mark.parametrize("words", JSON_COMMANDS)
def test_json_is_one_document_and_all_of_stdout(daemon: Run, words: tuple[str, ...]) -> None:
    outcome = daemon(*words, "--json")
    assert (outcome.code, outcome.err) == (0, "")
    assert isinstance(outcome.document, dict)
    assert outcome.document.get("error") is None


def test_status_fits_one_screen_and_has_units(daemon: Run) -> None:
    outcome = daemon("status")
    assert outcome.code == 0
    assert len(outcome.out.splitlines()) <= 24
    for words in (
        "off",
        "1000 Hz: keeps up: lateness and execution take 76 % of a period at p99.9",
        "since start   12345 ticks, 2 periods and 1 exchanges missed",
        "last 10 s     9000 ticks, 0 periods and 0 exchanges missed",
        "p99.9 380 µs",
        "μ 523.3",
        "τ_D 0",
        "region A",
        "0.0155 rad = 20.25 ticks",
        "0 rad/s",
        "0.5 A",
    ):
        assert words in outcome.out


def test_status_of_a_fault_says_what_and_where_to_read_and_exits_1(daemon: Run, control: FakeControl) -> None:
    control.state, control.fault = "fault", FAULT
    outcome = daemon("status")
    assert outcome.code == 1
    assert "over_speed: speed 401 rad/s is above 400 rad/s" in outcome.out
    assert "latched from before at 2026-01-02 03:04:05.678 UTC, with rig.yaml (0123456789ab)" in outcome.out
    assert "to do: when the rig is safe, 'hapticd clear'" in outcome.out
    assert "more: hapticd help over_speed" in outcome.out
    assert daemon("status", "--json").document["fault"] == FAULT


def test_watching_shows_the_status_until_interrupted(
    daemon: Run, control: FakeControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks: list[float] = []

    def look(interval: float) -> None:
        looks.append(interval)
        if len(looks) == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr("hapticd.cli.status.time.sleep", look)
    outcome = daemon("status", "--watch", "--interval", "0.25")
    assert (outcome.code, outcome.err, looks) == (130, "hapticd: interrupted\n", [0.25] * 3)
    assert outcome.out.count("12345 ticks") == 3


def test_watch_and_json_exclude_each_other(daemon: Run) -> None:
    outcome = daemon("status", "--watch", "--json")
    assert (outcome.code, outcome.document["error"]["code"]) == (2, "usage")


def test_set_sends_text_and_reports_what_was_applied(daemon: Run, control: FakeControl) -> None:
    outcome = daemon("set", "servo.rate_hz=500", "encoder.decimation=217")
    assert outcome.code == 0
    assert control.calls == [("set", {"servo.rate_hz": "500", "encoder.decimation": "217"})]
    assert control.resolved.servo.rate_hz == 500
    assert outcome.out.splitlines()[:2] == ['servo.rate_hz = "500"', 'encoder.decimation = "217"']


def test_release_prints_what_it_found(daemon: Run, control: FakeControl) -> None:
    control.job_result = {
        "outcome": "decaying",
        "held_by_friction": False,
        "final": {"position_ticks": -0.7250123456789012},
        "rest": {"after_periods": 417, "after_s": 0.41700000000000004},
        "oscillation": None,
    }
    assert daemon("release", "--deflection", "20.300000000000001").out.splitlines() == [
        "deflection   20.3 ticks",
        "outcome      decaying, at rest after 0.417 s (417 periods)",
        "final        -0.725012 ticks",
        "recorded     3 s in /r/release.arrow",
        "admitted: region A: globally stable",
    ]


def test_a_release_that_keeps_moving_says_how(daemon: Run, control: FakeControl) -> None:
    swing = {"peak_to_peak_ticks": 0.009208103130755064, "peak_to_peak_counts": 20.0, "frequency_hz": 62.50111}
    control.job_result = {"outcome": "persistent", "final": {"position_ticks": 0.0}, "rest": None, "oscillation": swing}
    assert (
        "oscillation  0.009208 ticks (20 counts) peak to peak at 62.5 Hz" in daemon("release", "--deflection", "3").out
    )


def test_a_release_that_friction_holds_does_not_pretend_to_have_moved(daemon: Run, control: FakeControl) -> None:
    rest = {"after_periods": 0, "after_s": 0.0}
    control.job_result = {
        "outcome": "decaying",
        "held_by_friction": True,
        "final": {"position_ticks": 5.0},
        "rest": rest,
    }
    out = daemon("release", "--deflection", "5").out
    assert "outcome      held by friction: the shaft did not move" in out
    assert "at rest after" not in out


def test_release_takes_a_negative_deflection_and_reports_the_result(daemon: Run, control: FakeControl) -> None:
    outcome = daemon("release", "--deflection", "-20.3", "--duration", "2", "--json")
    assert control.calls == [("release", -20.3, 2.0)]
    assert outcome.document == {
        "experiment": 1,
        "achieved_deflection": -20.3,
        "soft_start_s": 0.0,
        "duration_s": 2.0,
        "run": "/r/release.arrow",
        "state": "done",
        "result": {"outcome": "decaying"},
        "guard": ADMITTED,
    }


@pytest.mark.parametrize(
    ("state", "result", "code"),
    [
        ("done", {"outcome": "decaying"}, 0),
        ("done", {"outcome": "growing", "fault": "over_speed"}, 5),
        ("aborted", {"run": "/r/release.arrow"}, 1),
        ("aborted", None, 1),
    ],
)
def test_exit_code_of_an_experiment(
    daemon: Run, control: FakeControl, state: str, result: dict[str, str] | None, code: int
) -> None:
    control.job_states, control.job_result = [(state, 1.0)], result  # type: ignore[assignment]
    outcome = daemon("release", "--deflection", "10.3", "--json")
    assert (outcome.code, outcome.document["state"], outcome.document["result"]) == (code, state, result)


def test_ctrl_c_during_an_experiment_stops_the_motor(
    daemon: Run, control: FakeControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hapticd.client.client.time.sleep", interrupt)
    outcome = daemon("release", "--deflection", "20.3", "--json")
    assert (outcome.code, outcome.out) == (130, "")
    assert control.calls[-1] == ("stop",)
    assert outcome.err == "hapticd: a stop was sent to the daemon\nhapticd: interrupted\n"


def test_ctrl_c_while_an_experiment_begins_stops_the_motor_too(
    daemon: Run, control: FakeControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Client, "excite", interrupt)
    assert daemon("excite", "chirp").code == 130
    assert control.calls == [("stop",)]


def test_excite_lists_its_experiments_without_a_daemon(hapticd: Run) -> None:
    outcome = hapticd("excite", "--list", "--json")
    assert [entry["name"] for entry in outcome.document["experiments"]] == [
        "ramp",
        "sweep",
        "chirp",
        "steps",
        "release",
    ]
    assert "amplitude in A" in hapticd("excite", "--list").out


def test_paths_are_made_absolute_before_they_are_sent(
    daemon: Run, control: FakeControl, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.yaml").write_text("servo: {rate_hz: 500}\n")
    assert daemon("record", "start", "wall.arrow").code == 0
    assert daemon("reload", "rig.yaml").code == 0
    assert daemon("reload", "phantom").code == 0
    assert control.calls == [
        ("record_start", str(tmp_path / "wall.arrow"), "trusted"),
        ("reload", str(tmp_path / "rig.yaml")),
        ("reload", "phantom"),
    ]


@pytest.mark.parametrize(
    ("words", "code", "error", "message"),
    [
        (("start",), 1, "fault", "a fault is latched (over_speed); check the rig, then 'hapticd clear'"),
        (("record", "stop"), 1, "recording", "nothing is being recorded"),
        (
            ("set", "amplifier.dac_bits=12"),
            1,
            "restart_needed",
            "amplifier.dac_bits: cannot change while the daemon runs; edit the config and restart",
        ),
        (("reload", "omega"), 4, "driver", "reload failed: no board answers on /dev/ttyUSB0"),
        (
            ("excite", "chrip"),
            2,
            "excitation",
            "excitation 'chrip' is unknown (known: ramp, sweep, chirp, steps, release, all)",
        ),
        (("release", "--deflection", "1e300"), 2, "request", None),
        (("set", "servo.rate=500"), 2, "config", None),
        (("set", "servo.rate_hz=fast"), 2, "config", None),
        (("set", "spring.stiffness=.nan"), 2, "config", None),
    ],
)
def test_refusals_keep_their_words_and_have_their_exit_code(
    daemon: Run, control: FakeControl, words: tuple[str, ...], code: int, error: str, message: str | None
) -> None:
    control.fault = FAULT
    for extra in ((), ("--json",)):
        outcome = daemon(*words, *extra)
        assert outcome.code == code
        assert "Traceback" not in outcome.err
        if extra:
            assert outcome.document["error"]["code"] == error
            assert outcome.err == f"hapticd: {outcome.document['error']['message']}\n"
            assert message in (None, outcome.document["error"]["message"])
        else:
            assert outcome.out == ""


def test_start_that_ends_in_a_fault_exits_5(daemon: Run, control: FakeControl, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(control, "start", lambda **_: control.estop())
    outcome = daemon("start")
    assert outcome.code == 5
    first, *_, last = outcome.out.splitlines()
    assert (first, last) == ("fault: software stop", "more: hapticd help estop")


def test_estop_exits_0_although_it_latches_a_fault(daemon: Run) -> None:
    assert daemon("estop").code == 0
    assert daemon("status").code == 1
    assert daemon("clear").code == 0


def test_device_failure_exits_4(daemon: Run, control: FakeControl) -> None:
    control.fails_with = DriverFailure("the board on /dev/ttyUSB0 does not answer")
    outcome = daemon("start")
    assert (outcome.code, outcome.err) == (4, "hapticd: the board on /dev/ttyUSB0 does not answer\n")


CLIENTS = [words for words in JSON_COMMANDS if "--no-wait" not in words] + [("record", "stop"), ("status", "--watch")]


@pytest.mark.parametrize("words", CLIENTS)
def test_without_a_daemon_every_client_exits_3_and_says_how_to_start_one(
    hapticd: Run, tmp_path: Path, words: tuple[str, ...]
) -> None:
    path = tmp_path / "none.sock"
    outcome = hapticd(*words, "--socket", str(path))
    message = f"hapticd: no daemon answers on {path}; start one with 'hapticd run'\n"
    assert (outcome.code, outcome.out, outcome.err) == (3, "", message)


def test_without_a_daemon_json_is_an_error_document(hapticd: Run, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    outcome = hapticd("status", "--json", "--socket", str(tmp_path / "file"))
    assert (outcome.code, outcome.document["error"]["code"]) == (3, "unreachable")


def test_socket_option_beats_the_variable(daemon: Run, tmp_path: Path) -> None:
    assert daemon("status").code == 0
    assert daemon("status", "--socket", str(tmp_path / "other.sock")).code == 3


def test_socket_defaults_to_that_of_the_config(hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert str(tmp_path / "hapticd.sock") in hapticd("status").err


def test_nothing_is_sent_to_a_socket_in_a_folder_that_others_may_change(
    hapticd: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    monkeypatch.setattr("hapticd.config.paths.SERVICE_RUNTIME", tmp_path / "missing")
    monkeypatch.setattr("hapticd.config.paths.TEMPORARY", tmp_path)
    own = tmp_path / f"hapticd-{os.getuid()}"
    with serve(FakeControl(), own / "hapticd.sock"):
        assert hapticd("status").code == 0
        own.chmod(0o777)
        outcome = hapticd("status")
        assert (outcome.code, f"others may write to {own}" in outcome.err) == (3, True)
        own.chmod(0o755)


def test_daemon_that_hangs_exits_3(daemon: Run, control: FakeControl, monkeypatch: pytest.MonkeyPatch) -> None:
    path = Path(os.environ["HAPTICD_SOCKET"])
    monkeypatch.setattr("hapticd.cli.state.connect", lambda socket: Client(path, timeout_s=0.1))
    control.gate.clear()
    outcome = daemon("start")
    message = f"hapticd: the daemon on {path} accepts requests and does not answer; look at its log\n"
    assert (outcome.code, outcome.err) == (3, message)


REASON = "region C: unstable; nothing is started or changed\n  spring.stiffness  0.5 → 0.0156 N m/rad"


@pytest.mark.parametrize(
    "words",
    [
        ("start",),
        ("set", "encoder.decimation=217", "spring.stiffness=0.5"),
        ("release", "--deflection", "3"),
        ("excite", "chirp"),
        ("reload",),
    ],
)
def test_what_the_guard_refuses_exits_1_in_its_words_and_force_is_sent(
    daemon: Run, control: FakeControl, words: tuple[str, ...]
) -> None:
    control.fails_with = Refused("unstable", REASON)
    outcome = daemon(*words)
    assert (outcome.code, outcome.out) == (1, "")
    assert REASON in outcome.err
    assert daemon(*words, "--json").document["error"] == {"code": "unstable", "message": REASON}
    assert "force" not in control.calls[-1]
    control.fails_with = None
    assert daemon(*words, "--force").code == 0
    assert control.calls[-1][-1] == "force"


CHOICE = {
    "reason": "region D: too fast; nothing is started or changed",
    "remedies": [
        {"key": "spring.stiffness", "before": 0.5, "after": 0.01, "unit": "N m/rad", "words": "a softer spring"},
        {"key": "deflection", "before": 20.3, "after": 2.5, "unit": "ticks", "words": "a smaller deflection"},
    ],
    "help": "",
    "force": True,
}


@pytest.mark.parametrize(
    ("words", "deflection"),
    [(("release", "--deflection", "20.3"), "--deflection"), (("sequence", "s.yaml"), "deflection")],
)
def test_what_helps_is_told_with_the_options_of_the_command_at_hand(
    daemon: Run,
    control: FakeControl,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    deflection: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("s.yaml").write_text("steps: [{deflection: 20.3}]")
    control.fails_with = Refused("unstable", "of the API", CHOICE)
    assert daemon(*words).err.splitlines() == [
        f"hapticd: {CHOICE['reason']}",
        "One of these changes is enough:",
        "  spring.stiffness     0.5 → 0.01 N m/rad               a softer spring",
        f"  {deflection:<20} 20.3 → 2.5 ticks                 a smaller deflection",
        "Render it all the same: --force",
    ]
    assert daemon(*words, "--json").document["error"]["remedies"] == CHOICE["remedies"]


def test_a_command_without_force_does_not_name_it(daemon: Run, control: FakeControl) -> None:
    control.fails_with = Refused("unstable", "of the API", {**CHOICE, "remedies": [], "help": "change two"})
    assert daemon("clear").err == f"hapticd: {CHOICE['reason']}\nchange two\n"


def test_the_guards_sentence_is_under_the_answer(daemon: Run) -> None:
    assert daemon("start").out == "running\nadmitted: region A: globally stable\n"
