"""What the daemon says, where it is read late or never: nobody waits, what is lost is counted and told."""

from __future__ import annotations

import contextlib
import io
import logging
import os
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from hapticd.service import sink as module
from hapticd.service.journal import JournalHandler
from hapticd.service.sink import ROOM, Sink, SinkStream, write_all
from tests.polling import PATIENCE_S, wait_until


@contextlib.contextmanager
def stderr_on_a_pipe() -> Iterator[int]:
    """Standard error is a pipe; the end that is read."""
    reading, writing = os.pipe()
    before = sys.stderr
    with os.fdopen(reading, "rb", buffering=0), os.fdopen(writing, "w", encoding="utf-8") as sys.stderr:
        try:
            yield reading
        finally:
            sys.stderr = before


def fill(descriptor: int) -> None:
    """Write until nothing goes in any more."""
    os.set_blocking(descriptor, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(descriptor, b"x" * 4096)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(descriptor, b"x")
    os.set_blocking(descriptor, True)


def read_to(descriptor: int, end: str) -> str:
    """Read until the text ends in this; what it was filled with is left out."""
    found = b""
    while not found.endswith(end.encode()):
        found += os.read(descriptor, 1 << 16)
    return found.decode().lstrip("x")


def test_order_and_bytes_are_kept_and_the_end_waits_for_them() -> None:
    with stderr_on_a_pipe() as pipe:
        before, sink = sys.stderr, Sink()
        sink.take_stderr()
        print("stiffness 0.012 N·m/rad", file=sys.stderr)
        logging.StreamHandler(sink.stream).emit(logging.LogRecord("x", logging.INFO, "", 0, "state %s", ("off",), None))
        assert sys.stderr is not before
        assert sink.end(PATIENCE_S)
        assert sys.stderr is before
        assert os.read(pipe, 1 << 16).decode() == "stiffness 0.012 N·m/rad\nstate off\n"
        assert sink.dropped == 0


def test_nobody_waits_for_a_full_pipe_and_one_line_says_how_much_is_lost() -> None:
    with stderr_on_a_pipe() as pipe:
        fill(sys.stderr.fileno())
        sink = Sink()
        handler = logging.StreamHandler(sink.stream)
        module.log.addHandler(handler)
        try:
            for number in range(ROOM + 201):
                sink.stream.write(f"{number}\n")
                if number == 0:
                    wait_until(lambda: not sink._thread.waiting(), "the first line at work")
            assert sink.dropped == 200
            assert sink.behind
            said = read_to(pipe, "in time\n").splitlines()
        finally:
            module.log.removeHandler(handler)
        assert said[: ROOM + 1] == [str(number) for number in range(ROOM + 1)]
        assert said[ROOM + 1 :] == ["200 lines before this one are lost: they were not read in time"]
        assert sink.end(PATIENCE_S)


def test_the_end_comes_though_the_pipe_is_full_and_who_speaks_afterwards_does_not_hang() -> None:
    with stderr_on_a_pipe() as pipe:
        fill(sys.stderr.fileno())
        sink = Sink()
        sink.take_stderr()
        print("a last word", file=sys.stderr)
        assert not sink.end(0.05)
        for _ in range(3 * ROOM):
            print("too late", file=sys.stderr)
        assert isinstance(sys.stderr, SinkStream)
        assert read_to(pipe, "a last word\n") == "a last word\n"
        sink._thread.end(PATIENCE_S)


def test_a_reader_that_has_gone_is_counted_and_nothing_is_drawn_for_it() -> None:
    with stderr_on_a_pipe():
        sink = Sink()
        assert not sink.behind
        with socket.socket(socket.AF_UNIX) as nobody, os.fdopen(nobody.detach(), "w") as stream:
            SinkStream(sink, stream).write("to nobody\n")
            wait_until(lambda: sink.dropped == 1, "a line that cannot be written")
        assert sink.behind
        sink.stream.write("to somebody\n")
        wait_until(lambda: not sink.behind, "a line that can")
        assert sink.end(PATIENCE_S)


def test_a_descriptor_that_somebody_made_non_blocking_loses_nothing() -> None:
    with stderr_on_a_pipe() as pipe:
        os.set_blocking(sys.stderr.fileno(), False)
        text = bytes(range(256)) * 4096
        found = bytearray()

        def read() -> None:
            while len(found) < len(text):
                found.extend(os.read(pipe, 5000))

        reader = threading.Thread(target=read)
        reader.start()
        write_all(sys.stderr.fileno(), text)
        reader.join(PATIENCE_S)
        assert bytes(found) == text


def test_without_standard_error_nothing_is_written_anywhere() -> None:
    sink = Sink()
    stream = SinkStream(sink, None)
    assert stream.write("whose descriptor is 2 now?\n") > 0
    assert not stream.isatty()
    with pytest.raises(io.UnsupportedOperation):
        stream.fileno()
    assert sink.end(PATIENCE_S)
    assert sink.dropped == 0


def test_a_request_of_64_kib_does_not_fill_the_memory_that_is_locked() -> None:
    with stderr_on_a_pipe() as pipe:
        sink = Sink()
        sink.stream.write("k" * 65_536)
        said = read_to(pipe, ")\n")
        assert said == "k" * module.LONGEST + " … (65536 characters)\n"
        assert sink.end(PATIENCE_S)


def test_nobody_waits_for_a_journal_that_is_never_read_beside_a_full_pipe(tmp_path: Path) -> None:
    with stderr_on_a_pipe() as pipe:
        fill(sys.stderr.fileno())
        sink = Sink()
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal:
            journal.bind(str(tmp_path / "journal"))
            handler = JournalHandler(sink, str(tmp_path / "journal"))
            written = 0
            # The datagrams that the kernel keeps first, then the line at work, then the queue.
            while not sink.dropped:
                handler.emit(logging.LogRecord("x", logging.INFO, "", 0, "line %d", (written,), None))
                written += 1
            assert written > ROOM
            assert b"MESSAGE=line 0\n" in journal.recv(4096)
            read_to(pipe, f"line {written - 2}\n")
            assert sink.end(PATIENCE_S)
            handler.close()
