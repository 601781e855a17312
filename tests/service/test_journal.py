"""Records in the journal's native protocol, read back by a decoder of the test's own."""

from __future__ import annotations

import logging
import socket
import struct
from pathlib import Path

from hapticd.service.journal import JournalHandler, stderr_is_journal
from hapticd.service.sink import Sink
from tests.polling import PATIENCE_S


def decode(datagram: bytes) -> dict[str, str]:
    fields = {}
    while datagram:
        line, _, rest = datagram.partition(b"\n")
        name, equals, value = line.partition(b"=")
        if not equals:
            (length,) = struct.unpack("<Q", rest[:8])
            value, rest = rest[8 : 8 + length], rest[8 + length + 1 :]
        fields[name.decode()] = value.decode()
        datagram = rest
    return fields


def test_a_fault_is_a_field(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal:
        journal.bind(str(tmp_path / "journal"))
        sink = Sink()
        handler = JournalHandler(sink, str(tmp_path / "journal"))
        record = logging.LogRecord("hapticd.service.daemon", logging.ERROR, "", 0, "fault %s", ("over_speed",), None)
        record.journal = {"fault": "over_speed", "cause": "speed 500 rad/s\nis above 400 rad/s"}
        handler.emit(record)
        fields = decode(journal.recv(4096))
        assert sink.end(PATIENCE_S)
        handler.close()
    assert fields["MESSAGE"] == "fault over_speed"
    assert fields["PRIORITY"] == "3"
    assert fields["HAPTICD_FAULT"] == "over_speed"
    assert fields["HAPTICD_CAUSE"] == "speed 500 rad/s\nis above 400 rad/s"


def test_without_a_journal_standard_error_has_the_words(tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    sink = Sink()
    handler = JournalHandler(sink, str(tmp_path / "nobody"))
    handler.emit(logging.LogRecord("x", logging.INFO, "", 0, "state %s", ("off",), None))
    assert sink.end(PATIENCE_S)
    handler.close()
    assert capsys.readouterr().err == "state off\n"
    assert not stderr_is_journal()
