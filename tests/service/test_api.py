"""The control API over its real socket: every endpoint, and stops that nothing stands in front of."""

import inspect
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from hapticd.client import Client, DaemonUnreachable, RequestRefused
from hapticd.control.endpoints import Endpoints, declared
from hapticd.service.api import ApiServer
from hapticd.service.daemon import Daemon
from hapticd.service.socket import SocketError, bind
from tests.polling import PATIENCE_S, wait_until

from .fake_control import FakeControl, serve


@pytest.fixture
def control() -> FakeControl:
    return FakeControl()


@pytest.fixture
def client(control: FakeControl, tmp_path: Path) -> Iterator[Client]:
    with serve(control, tmp_path / "h.sock") as client:
        yield client


@pytest.mark.parametrize("owner", [Daemon, FakeControl])
def test_every_endpoint_is_overridden_with_its_arguments(owner: type) -> None:
    for endpoint in declared(Endpoints):
        own = inspect.signature(vars(owner)[endpoint.name])
        own.bind(None, **dict.fromkeys(endpoint.signature.parameters))


def test_every_endpoint_reaches_its_method_with_its_arguments(client: Client, control: FakeControl) -> None:
    client.start()
    client.clear()
    client.set({"servo.rate_hz": 500, "spring.stiffness": "0.02"})
    client.release(-20.5, 2)
    client.excite("chirp", amplitude=0.2)
    client.excite()
    client.record_start("/r/a.arrow")
    client.record_start()
    client.note("sweating")
    client.marker("stimulus", 3)
    client.reload()
    client.start(force=True)
    client.set({"spring.stiffness": 1}, force=True)
    client.release(3, force=True)
    client.excite("chirp", force=True)
    client.reload(force=True)
    client.stop()
    client.estop()
    assert control.calls == [
        ("start",),
        ("clear",),
        ("set", {"servo.rate_hz": 500, "spring.stiffness": "0.02"}),
        ("release", -20.5, 2),
        ("excite", "chirp", {"amplitude": 0.2}),
        ("excite", "all", {}),
        ("record_start", "/r/a.arrow", "trusted"),
        ("record_start", None, "trusted"),
        ("note", "sweating"),
        ("marker", "stimulus", 3),
        ("reload", None),
        ("start", "force"),
        ("set", {"spring.stiffness": 1}, "force"),
        ("release", 3, None, "force"),
        ("excite", "chirp", {}, "force"),
        ("reload", None, "force"),
        ("stop",),
        ("estop",),
    ]


def test_queries_return_what_the_daemon_says(client: Client, control: FakeControl) -> None:
    assert client.status() == control.status()
    assert client.config() == control.config()
    assert client.experiment()["state"] == "idle"


def test_a_number_that_is_not_known_is_null(client: Client, control: FakeControl) -> None:
    control.velocity = float("nan")
    assert client.status()["velocity"] is None


def test_waiting_for_an_experiment_reports_progress(client: Client) -> None:
    job = client.release(20.3)
    seen: list[float] = []
    report = client.wait(job["experiment"], seen.append, interval_s=0.0)
    assert (report["state"], report["result"], seen) == ("done", {"outcome": "decaying"}, [0.5, 1.0])


def test_waiting_for_an_experiment_that_another_has_replaced(client: Client, control: FakeControl) -> None:
    job = client.release(20.3)
    control.job = {**control.job, "id": 2}
    with pytest.raises(RequestRefused) as refusal:
        client.wait(job["experiment"])
    assert refusal.value.code == "experiment_lost"


def test_stops_are_answered_while_everything_else_waits(client: Client, control: FakeControl, tmp_path: Path) -> None:
    control.gate.clear()

    def ask(number: int) -> str:
        return str(Client(tmp_path / "h.sock").set({"spring.stiffness": 0.01 + number / 1000})["config_digest"])

    with ThreadPoolExecutor(60) as pool:
        waiting = [pool.submit(ask, number) for number in range(60)]
        assert control.waiting.wait(PATIENCE_S)
        assert client.estop()["fault"]["code"] == "estop"
        assert client.stop()["state"] == "off"
        assert client.status()["state"] == "off"
        assert not any(future.done() for future in waiting)
        control.gate.set()
        assert len({future.result() for future in waiting}) == 60


def test_estop_works_whatever_its_body_says(client: Client, control: FakeControl, tmp_path: Path) -> None:
    transport = httpx.HTTPTransport(uds=str(tmp_path / "h.sock"))
    with httpx.Client(transport=transport, base_url="http://hapticd") as raw:
        for body in (b"", b"{", b'{"unknown": NaN}', b"x" * 100_000):
            assert raw.post("/estop", content=body).status_code == 200
    assert control.calls == [("estop",)] * 4


def test_commands_run_one_at_a_time(client: Client, control: FakeControl) -> None:
    inside = threading.Semaphore(1)
    overlaps: list[int] = []
    enter = control._enter

    def watch(*call: object) -> None:
        if not inside.acquire(blocking=False):
            overlaps.append(1)
        time.sleep(0.002)
        enter(*call)
        inside.release()

    control._enter = watch  # type: ignore[method-assign]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: client.clear(), range(8)))
    assert overlaps == []
    assert control.calls == [("clear",)] * 8


def test_stop_leaves_no_thread_and_no_socket(control: FakeControl, tmp_path: Path) -> None:
    before = set(threading.enumerate())
    server = ApiServer(control, bind(tmp_path / "h.sock"))
    server.start()
    client = Client(tmp_path / "h.sock")
    client.status()
    client.clear()
    server.stop()
    server.stop()
    wait_until(lambda: set(threading.enumerate()) <= before, "the end of its threads")
    assert list(tmp_path.iterdir()) == []


def test_stop_does_not_wait_for_a_request_that_hangs(control: FakeControl, tmp_path: Path) -> None:
    control.gate.clear()
    server = ApiServer(control, bind(tmp_path / "h.sock"))
    server.start()
    with ThreadPoolExecutor(1) as pool:
        hanging = pool.submit(Client(tmp_path / "h.sock").start)
        assert control.waiting.wait(PATIENCE_S)
        server.stop()
        with pytest.raises((DaemonUnreachable, RequestRefused)):
            hanging.result(PATIENCE_S)
        control.gate.set()
    assert list(tmp_path.iterdir()) == []


def test_second_server_on_the_same_socket_is_refused(client: Client, tmp_path: Path) -> None:
    with pytest.raises(SocketError, match="another daemon"):
        bind(tmp_path / "h.sock")
    assert client.status()["state"] == "off"


def test_server_can_take_over_after_a_stop(control: FakeControl, tmp_path: Path) -> None:
    for _ in range(2):
        with serve(control, tmp_path / "h.sock") as client:
            assert client.status()["state"] == "off"
