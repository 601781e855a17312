from __future__ import annotations

import re
import threading
from pathlib import Path

import numpy as np
import pytest
from record_samples import CONFIG, Ring, wait_until

from hapticd.record import Recorder, RecordingError, files, read_run


def test_a_recording_holds_every_row_between_start_and_stop(recorder: Recorder, ring: Ring) -> None:
    ring.push(50)
    path = recorder.start()
    ring.push(1000)
    wait_until(lambda: recorder.status()["rows"] == 1000)
    ring.push(7)
    assert recorder.stop() == path
    ring.push(9)
    run = read_run(path)
    assert np.array_equal(run.columns["tick"], np.arange(50, 1057))
    assert not run.truncated
    assert run.metadata["kind"] == "run"
    assert run.metadata["config"] == CONFIG
    assert run.events[-1]["event"] == "end"
    assert (run.events[-1]["rows"], run.events[-1]["dropped"]) == (1057 - 50, 0)
    assert recorder.status()["state"] == "off"


def test_consecutive_recordings_split_the_rows_and_lose_none(recorder: Recorder, ring: Ring) -> None:
    paths = []
    for _ in range(20):
        paths.append(recorder.start())
        ring.push(13)
        assert recorder.stop() == paths[-1]
    assert len(set(paths)) == 20
    ticks = np.concatenate([read_run(path).columns["tick"] for path in paths])
    assert np.array_equal(ticks, np.arange(20 * 13))


def test_a_running_producer_loses_nothing_at_the_edges_and_meets_one_consumer(recorder: Recorder, ring: Ring) -> None:
    ending = threading.Event()

    def produce() -> None:
        while not ending.wait(0.001):
            ring.push(10)

    producer = threading.Thread(target=produce)
    producer.start()
    runs = []
    for _ in range(5):
        path = recorder.start()
        seen = ring.made
        wait_until(lambda seen=seen: ring.made > seen + 300)
        made = ring.made
        recorder.stop()
        runs.append((read_run(path).columns["tick"], seen, made))
    ending.set()
    producer.join()
    for ticks, seen, made in runs:
        assert np.all(np.diff(ticks) == 1)
        assert ticks[0] <= seen
        assert ticks[-1] >= made - 1
    assert ring.most_inside == 1


def test_names_are_unique_and_as_documented(
    recorder: Recorder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = recorder.start()
    recorder.stop()
    assert path.parent == tmp_path / "runs"
    assert re.fullmatch(r"run-\d{8}T\d{6}\.\d{3}Z\.arrow", path.name)
    moment = files.utc_now()
    monkeypatch.setattr(files, "utc_now", lambda: moment)
    names = []
    for _ in range(3):
        names.append(recorder.start(label="Fig. 8/a ../x").name)
        recorder.stop()
    stem = f"run-{moment:%Y%m%dT%H%M%S}.{moment.microsecond // 1000:03d}Z-Fig_8_a_x"
    assert names == [f"{stem}.arrow", f"{stem}-2.arrow", f"{stem}-3.arrow"]
    assert read_run(tmp_path / "runs" / names[0]).metadata["label"] == "Fig. 8/a ../x"


def test_an_explicit_path_is_used_and_refused_if_it_exists(recorder: Recorder, tmp_path: Path) -> None:
    path = tmp_path / "mine.arrow"
    assert recorder.start(path) == path
    recorder.stop()
    before = path.read_bytes()
    with pytest.raises(RecordingError, match=r"mine\.arrow exists: a recording never overwrites"):
        recorder.start(str(path))
    assert path.read_bytes() == before
    assert recorder.status()["state"] == "off"


def test_only_one_recording_at_a_time(recorder: Recorder) -> None:
    path = recorder.start()
    with pytest.raises(RecordingError, match=f"already recording to {re.escape(str(path))}; stop that first"):
        recorder.start()
    assert recorder.status()["path"] == str(path)


def test_stop_without_a_recording_gives_none(recorder: Recorder) -> None:
    assert recorder.stop() is None


def test_a_folder_that_cannot_be_made_is_named(ring: Ring, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for directory, message in [
        (tmp_path / "file", r"record\.directory .*/file is not a folder"),
        (tmp_path / "file" / "below", r"cannot make record\.directory .*/file/below: Not a directory"),
    ]:
        made = Recorder(ring.drain, lambda: 0, ring.history, dict, directory)
        with pytest.raises(RecordingError, match=message):
            made.start()
        with pytest.raises(RecordingError, match=message):
            made.dump_past("over_speed")
        assert made.status()["state"] == "off"
        made.shutdown()


def test_dropped_rows_are_counted_per_recording_and_noted_where_they_were_lost(recorder: Recorder, ring: Ring) -> None:
    ring.lost = 5
    path = recorder.start()
    ring.push(10)
    wait_until(lambda: recorder.status()["rows"] == 10)
    assert recorder.status()["dropped"] == 0
    ring.lose(3)
    wait_until(lambda: recorder.status()["dropped"] == 3)
    ring.push(10)
    recorder.stop()
    assert recorder.status()["dropped"] == 3
    assert recorder.status()["dropped_total"] == 8
    noted = [event for event in read_run(path).events if event["event"] == "dropped"]
    keys = ("row", "rows", "after_tick", "before_tick")
    assert [tuple(event[key] for key in keys) for event in noted] == [(10, 3, 9, 13)]


def test_changes_made_while_recording_are_in_the_file(recorder: Recorder, ring: Ring) -> None:
    recorder.annotate({"event": "set", "changes": {}})
    path = recorder.start()
    ring.push(10)
    recorder.annotate({"event": "set", "changes": {"servo.rate_hz": 500.0}})
    recorder.stop()
    first = read_run(path).events[0]
    assert (first["row"], first["changes"]) == (10, {"servo.rate_hz": 500.0})


def test_the_seconds_before_a_fault_are_kept_without_a_recording(recorder: Recorder, ring: Ring) -> None:
    ring.push(15_000)
    path = recorder.dump_past("over_speed")
    assert re.fullmatch(r"fault-\d{8}T\d{6}\.\d{3}Z-over_speed\.arrow", path.name)
    run = read_run(path)
    assert np.array_equal(run.columns["tick"], np.arange(5000, 15_000))
    assert not run.truncated
    assert (run.metadata["kind"], run.metadata["label"]) == ("fault", "over_speed")


def test_a_fault_while_recording_leaves_the_recording_alone(recorder: Recorder, ring: Ring) -> None:
    recording = recorder.start()
    ring.push(100)
    dumps = [recorder.dump_past("excursion") for _ in range(3)]
    ring.push(100)
    recorder.stop()
    assert len({recording, *dumps}) == 4
    assert read_run(recording).rows == 200
    assert [read_run(path).rows for path in dumps] == [100, 100, 100]


def test_a_fault_before_any_row_still_leaves_a_readable_file(recorder: Recorder) -> None:
    assert read_run(recorder.dump_past("driver_lost")).rows == 0


def test_a_broken_ring_stops_the_recording_and_the_thread_lives_on(
    recorder: Recorder, ring: Ring, caplog: pytest.LogCaptureFixture
) -> None:
    path = recorder.start()
    ring.push(30)
    wait_until(lambda: recorder.status()["rows"] == 30)
    ring.broken = ValueError("bad index")
    wait_until(lambda: recorder.status()["state"] == "failed")
    assert recorder.status()["error"] == "recording stopped: ValueError: bad index"
    assert recorder.stop() == path
    ring.broken = None
    run = read_run(path)
    assert (run.rows, run.truncated) == (30, True)
    again = recorder.start()
    ring.push(4)
    recorder.stop()
    assert read_run(again).rows == 4
    assert recorder.status()["error"] is None
    assert caplog.text.count("bad index") == 1


def test_status_answers_while_the_disk_hangs(recorder: Recorder, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder.start()
    monkeypatch.setattr("hapticd.record.recorder._LOCK_TIMEOUT_S", 0.05)
    with recorder._lock:
        assert recorder.status()["state"] == "recording"
        with pytest.raises(RecordingError, match="the disk has not answered for"):
            recorder.stop()


def test_the_thread_is_named_and_ends_with_shutdown(ring: Ring, tmp_path: Path) -> None:
    made = Recorder(ring.drain, lambda: 0, ring.history, dict, tmp_path)
    assert "hapticd-recorder" in {thread.name for thread in threading.enumerate()}
    path = made.start()
    ring.push(3)
    assert made.shutdown() == path
    assert made.shutdown() is None
    assert read_run(path).rows == 3
    assert "hapticd-recorder" not in {thread.name for thread in threading.enumerate()}
