from __future__ import annotations

import re
import shutil
import threading
from collections.abc import Callable
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
    monkeypatch.setattr("hapticd.record.recorder.LOCK_TIMEOUT_S", 0.05)
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


def _delete(path: Path) -> None:
    path.unlink()


def _delete_folder(path: Path) -> None:
    shutil.rmtree(path.parent)


def _move_folder(path: Path) -> None:
    path.parent.rename(path.parent.with_name("moved"))


def _cut(path: Path) -> None:
    path.write_bytes(b"")


def _append(path: Path) -> None:
    with path.open("ab") as file:
        file.write(b"garbage")


def _replace(path: Path) -> None:
    other = path.with_name("other")
    other.write_bytes(path.read_bytes())
    other.rename(path)


@pytest.mark.parametrize(
    ("harm", "what"),
    [
        (_delete, "was deleted"),
        (_delete_folder, "was deleted"),
        (_move_folder, "cannot be reached at its path any more (No such file or directory)"),
        (_cut, "was cut to "),
        (_append, "was written to by somebody else: "),
        (_replace, "was deleted"),
    ],
)
def test_a_run_file_that_somebody_takes_away_is_gone_on_with_in_a_new_one(
    harm: Callable[[Path], None], what: str, recorder: Recorder, ring: Ring, caplog: pytest.LogCaptureFixture
) -> None:
    path = recorder.start(label="release")
    ring.push(400)
    recorder.annotate({"event": "set", "changed": {}})
    wait_until(lambda: recorder._writer is not None and recorder._writer.rows_written == 400)
    harm(path)
    ring.push(300)
    wait_until(lambda: recorder.status()["continued"] is not None)
    ring.push(200)
    wait_until(lambda: recorder.status()["rows"] == 500)
    status = recorder.status()
    assert (status["state"], status["error"], status["rows_total"]) == ("recording", None, 900)
    new = recorder.stop()
    assert new is not None
    assert new != path
    assert (str(new), new.parent) == (status["path"], path.parent)
    run = read_run(new)
    assert np.array_equal(run.columns["tick"], np.arange(400, 900))
    assert not run.truncated
    assert run.metadata["label"] == "release"
    noted = run.events[0]
    assert (noted["event"], noted["row"], noted["file"], noted["rows"]) == ("continued", 0, str(path), 400)
    assert noted["what"].startswith(what)
    assert status["continued"].startswith(f"{path} {what}")
    assert caplog.text.count("the recording goes on in") == 1
    recorder.start()
    assert recorder.status()["continued"] is None


def test_what_was_accepted_and_not_yet_written_is_in_the_new_file(recorder: Recorder, ring: Ring) -> None:
    path = recorder.start()
    with recorder._lock:
        assert recorder._writer is not None
        ring.push(50)
        recorder.pull()
        recorder._writer.flush()
        ring.push(60)
        recorder.pull()
        assert (recorder._writer.rows_written, recorder._writer.rows) == (50, 110)
        recorder._writer.annotate({"event": "set", "changed": {"a": 1}})
        path.unlink()
        recorder.pull()
    new = recorder.stop()
    assert new is not None
    run = read_run(new)
    assert np.array_equal(run.columns["tick"], np.arange(50, 110))
    assert [event["event"] for event in run.events] == ["continued", "set", "end"]


def test_where_there_can_be_no_new_file_the_recording_has_failed_and_says_why(
    recorder: Recorder, ring: Ring, caplog: pytest.LogCaptureFixture
) -> None:
    path = recorder.start()
    ring.push(40)
    wait_until(lambda: recorder.status()["rows"] == 40)
    shutil.rmtree(path.parent)
    path.parent.write_text("in the way")
    wait_until(lambda: recorder.status()["state"] == "failed")
    error = recorder.status()["error"]
    assert error.startswith(f"recording stopped: {path} was deleted; ")
    assert error.endswith(f"record.directory {path.parent} is not a folder")
    assert caplog.text.count("recording stopped") == 1
    assert recorder.stop() == path


def test_a_file_that_is_always_taken_away_ends_the_recording(
    recorder: Recorder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("hapticd.record.recorder.MOST_FILES", 3)
    recorder.start()
    for _ in range(3):
        (path,) = recorder.directory.iterdir()
        path.unlink()
        wait_until(lambda path=path: recorder.status()["path"] != str(path) or recorder.status()["state"] == "failed")
    wait_until(lambda: recorder.status()["state"] == "failed")
    assert "it was the file number 3 of this recording" in recorder.status()["error"]
    assert list(recorder.directory.iterdir()) == []


def test_a_thread_that_has_ended_is_an_error(recorder: Recorder, monkeypatch: pytest.MonkeyPatch) -> None:
    recorder.start()
    assert recorder.alive() == {"hapticd-recorder": True, "hapticd-sync": True}

    class Ended(BaseException):
        pass

    def end() -> None:
        raise Ended

    monkeypatch.setattr(threading, "excepthook", lambda _: None)
    monkeypatch.setattr(recorder, "pull", end)
    wait_until(lambda: not recorder.alive()["hapticd-recorder"])
    monkeypatch.undo()
    status = recorder.status()
    assert (status["state"], status["error"]) == (
        "failed",
        "the recorder's thread has ended: no row is written any more; restart the daemon",
    )
