"""The flight recorder: the servo's ring and its shared atomics in a memory-mapped file that outlives the process.

The servo thread stores into memory, as ever; it makes no call and waits for nothing. What it has stored belongs to the
kernel's page cache and is there whatever ends the process (SIGKILL, SIGSEGV, out of memory). The file is best on a file
system in memory: on a disk, each page that the kernel has written back is write-protected, and the next store into it
waits for the file system (decision 26, ``python -m benchmarks ring_store``).

Layout, native byte order, every part at a multiple of a page: `HEADER`; the shared atomics; two metadata slots, written by
turns, each with its number, length and CRC-32; the rows. Row n lies in slot n modulo the number of rows. The header names
the atomic that counts finished rows: the newest of them are valid, except the oldest slot, which may be half
overwritten.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import mmap
import os
import struct
import time
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hapticd.config import paths
from hapticd.config.opening import open_regular
from hapticd.record.errors import RecordingError, RunFileError
from hapticd.record.metadata import to_plain
from hapticd.record.schema import ROW, Rows

SUFFIX = ".flight"
PAST_S = 10.0
_MAGIC = b"HAPTFLT1"
_PAGE = 4096
_SLOT_BYTES = 1 << 16
_SLOT = struct.Struct("<QII")  # number, length, CRC-32
_LARGEST_ROWS = 1 << 24
_ROW_DIGEST = zlib.crc32(repr(ROW.descr).encode())

HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("row_digest", "i8"),  # of the row's fields
        ("rows", "i8"),  # slots, a power of two
        ("words", "i8"),  # how many shared atomics
        ("head_word", "i8"),  # which of them counts finished rows
        ("pid", "i8"),
        ("clock_ns", "i8"),  # Unix time less CLOCK_MONOTONIC, ns
        ("boot", "S40"),  # the kernel's number of this boot
    ]
)


@dataclass(frozen=True)
class _Layout:
    words: int
    rows: int

    @property
    def slots_at(self) -> int:
        return _PAGE + _pages(self.words * 8)

    @property
    def rows_at(self) -> int:
        return self.slots_at + 2 * _SLOT_BYTES

    @property
    def size(self) -> int:
        return self.rows_at + _pages(self.rows * ROW.itemsize)


def _pages(size: int) -> int:
    return -(-size // _PAGE) * _PAGE


class FlightRing:
    """The file of a living daemon, held under ``flock`` for as long as it lives.

    Attributes:
        path: the file.
        shared: the shared atomics, shape (n,), int64, in the file.
        rows: the ring, shape (rows,) of `schema.ROW`, in the file.
    """

    def __init__(self, path: Path, descriptor: int, memory: mmap.mmap, layout: _Layout) -> None:
        self.path = path
        self._descriptor, self._memory, self._slots_at = descriptor, memory, layout.slots_at
        self._file = os.fstat(descriptor)
        self._number = 0
        self.shared: NDArray[np.int64] = np.frombuffer(memory, np.int64, layout.words, _PAGE)
        self.rows: Rows = np.frombuffer(memory, ROW, layout.rows, layout.rows_at)

    @classmethod
    def create(cls, directory: Path, name: str, rows: int, words: int = 1, head_word: int = 0) -> FlightRing:
        """Make the file ``<name>-<pid>-<number>.flight``, all of its pages present.

        Args:
            directory: where; made if missing, for the owner alone.
            name: tells this daemon from others.
            rows: slots, a power of two.
            words: number of shared atomics, a word each.
            head_word: which of them counts finished rows.

        Raises:
            RecordingError: it cannot be made, or there is no room for it.
        """
        layout = _Layout(words, rows)
        path, part = _new_names(directory, name)
        descriptor = -1
        try:
            directory.mkdir(mode=0o700, parents=True, exist_ok=True)
            if reason := paths.foreign(directory):
                raise RecordingError(f"no flight recorder in {directory}: {reason}")
            descriptor = os.open(part, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # Without room a later store would end the process with SIGBUS.
            os.posix_fallocate(descriptor, 0, layout.size)
            memory = mmap.mmap(descriptor, layout.size)
            np.frombuffer(memory, np.uint8).fill(0)
            memory[: HEADER.itemsize] = _header(layout, head_word).tobytes()
            part.rename(path)
        except OSError as error:
            if descriptor >= 0:
                os.close(descriptor)
                part.unlink(missing_ok=True)
            raise RecordingError(
                f"no flight recorder in {directory}: {error.strerror} ({layout.size >> 20} MiB)"
            ) from error
        return cls(path, descriptor, memory, layout)

    def describe(self, metadata: Mapping[str, Any]) -> None:
        """Keep what a run file would say of itself, for whoever recovers the rows; not for the servo thread."""
        data = json.dumps(to_plain(metadata), allow_nan=False).encode()
        if len(data) > _SLOT_BYTES - _SLOT.size:
            data = b"{}"
        self._number += 1
        begin = self._slots_at + (self._number & 1) * _SLOT_BYTES
        self._memory[begin : begin + _SLOT.size] = bytes(_SLOT.size)
        self._memory[begin + _SLOT.size : begin + _SLOT.size + len(data)] = data
        self._memory[begin : begin + _SLOT.size] = _SLOT.pack(self._number, len(data), zlib.crc32(data))

    def intact(self) -> bool:
        """Whether the file is where it was made, for who recovers it. While it is mapped its inode is not used again."""
        try:
            return os.path.samestat(self.path.lstat(), self._file)
        except OSError:
            return False

    def remove(self) -> None:
        """Nothing is left to recover: take the file away. Its memory stays for as long as somebody uses it."""
        if self._descriptor >= 0:
            self.path.unlink(missing_ok=True)
            self.leave()

    def leave(self) -> None:
        """Give up the lock and leave the file to be recovered."""
        if self._descriptor >= 0:
            # The mapping has a descriptor of its own on the same open file: closing ours would not unlock it.
            fcntl.flock(self._descriptor, fcntl.LOCK_UN)
            os.close(self._descriptor)
            self._descriptor = -1


def _new_names(directory: Path, name: str) -> tuple[Path, Path]:
    number = 1
    while (path := directory / f"{name}-{os.getpid()}-{number}{SUFFIX}").exists():
        number += 1
    return path, path.with_suffix(".part")


def _header(layout: _Layout, head_word: int) -> NDArray[Any]:
    clock_ns = time.time_ns() - time.monotonic_ns()
    return np.array(
        [(_MAGIC, _ROW_DIGEST, layout.rows, layout.words, head_word, os.getpid(), clock_ns, _boot())], HEADER
    )


def _boot() -> bytes:
    with contextlib.suppress(OSError):
        return Path("/proc/sys/kernel/random/boot_id").read_bytes().strip()
    return b""


def memory_directory() -> Path | None:
    """A folder of ours in memory: ``$RUNTIME_DIRECTORY``, ``$XDG_RUNTIME_DIR``, ``/dev/shm``; None: none of them is."""
    for place in (os.environ.get("RUNTIME_DIRECTORY", "").split(":")[0], os.environ.get("XDG_RUNTIME_DIR", "")):
        if place and Path(place).is_absolute() and in_memory(Path(place)):
            return Path(place)
    own = paths.memory_folder()
    return own if in_memory(own.parent) else None


def in_memory(directory: Path) -> bool:
    """Whether files there are kept in memory (tmpfs, ramfs), by the longest mount point that holds the directory."""
    try:
        here = directory.resolve(strict=True)
        mounts = [line.split()[1:3] for line in Path("/proc/mounts").read_text().splitlines()]
    except OSError:
        return False
    holding = [(place, kind) for place, kind in mounts if here.is_relative_to(place)]
    return os.access(here, os.W_OK) and max(holding, key=lambda found: len(found[0]))[1] in ("tmpfs", "ramfs")


@dataclass(frozen=True)
class Flight:
    """What a dead daemon left.

    Attributes:
        path: the file.
        rows: rows of its last `PAST_S` seconds, shape (n,), oldest first.
        shared: its shared atomics.
        metadata: what a run file would have said of itself.
        pid: its process number.
        torn: rows left out because a page of the file is older than its neighbours; only a power cut does that.
        rebooted: whether the machine has started anew since.
        clock_ns: Unix time less its CLOCK_MONOTONIC, ns.
    """

    path: Path
    rows: Rows
    shared: NDArray[np.int64]
    metadata: dict[str, Any]
    pid: int
    torn: int
    rebooted: bool
    clock_ns: int


@contextlib.contextmanager
def dead(path: Path) -> Iterator[Flight | None]:
    """The file of a dead daemon, locked while it is worked on; None: its daemon lives, or it is gone.

    Raises:
        RunFileError: it cannot be opened, or is no flight recorder.
    """
    try:
        file = open_regular(path)
    except FileNotFoundError:
        yield None
        return
    except OSError as error:
        raise RunFileError(f"cannot read {path}: {error.strerror}") from error
    with file:
        yield read(path, file.fileno()) if _locked(file.fileno()) else None


def _locked(descriptor: int) -> bool:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def read(path: Path, descriptor: int) -> Flight:
    """Read a flight recorder.

    Raises:
        RunFileError: it is none, or was made by another version.
    """
    size = os.fstat(descriptor).st_size
    if size < _PAGE:
        raise RunFileError(f"{path} is no flight recorder: {size} bytes")
    with mmap.mmap(descriptor, size, access=mmap.ACCESS_READ) as memory:
        header = np.frombuffer(memory[: HEADER.itemsize], HEADER)[0]
        if header["magic"] != _MAGIC:
            raise RunFileError(f"{path} is no flight recorder")
        layout = _Layout(int(header["words"]), int(header["rows"]))
        fits = 0 < layout.words <= _PAGE and 0 < layout.rows <= _LARGEST_ROWS and layout.rows & (layout.rows - 1) == 0
        if header["row_digest"] != _ROW_DIGEST or not fits or not 0 <= header["head_word"] < layout.words:
            raise RunFileError(f"{path} was made by another version of hapticd, or its header is damaged")
        if layout.size != size:
            raise RunFileError(f"{path} is cut short: {size} bytes of {layout.size}")
        shared = np.frombuffer(memory[_PAGE : _PAGE + 8 * layout.words], np.int64)
        ring = np.frombuffer(memory[layout.rows_at : layout.rows_at + layout.rows * ROW.itemsize], ROW)
        metadata = _newest_metadata(memory, layout)
    rows, torn = _last(ring, int(shared[header["head_word"]]))
    rebooted = bool(header["boot"]) and header["boot"] != _boot()
    return Flight(path, rows, shared, metadata, int(header["pid"]), torn, rebooted, int(header["clock_ns"]))


def _newest_metadata(memory: mmap.mmap, layout: _Layout) -> dict[str, Any]:
    found: list[tuple[int, dict[str, Any]]] = []
    for begin in (layout.slots_at, layout.slots_at + _SLOT_BYTES):
        number, length, check = _SLOT.unpack(memory[begin : begin + _SLOT.size])
        data = memory[begin + _SLOT.size : begin + _SLOT.size + length]
        with contextlib.suppress(ValueError):
            if number and length <= _SLOT_BYTES - _SLOT.size and zlib.crc32(data) == check:
                found.append((number, json.loads(data)))
    return max(found, key=lambda entry: entry[0], default=(0, {}))[1]


def _last(ring: Rows, head: int) -> tuple[Rows, int]:
    """Rows of the last seconds in order, and how many were left out as torn.

    After the death of a process every slot is whole but the one being written. After a power cut a page may be older than
    its neighbours: its rows stand a lap of the ring back and do not fit. As a row may lie across two pages, the rows
    beside such a hole are left out, too.
    """
    size = ring.size
    slots = np.arange(size)
    written = slots < head if head < size else slots != head % size
    slots = slots[written]
    if not slots.size:
        return ring[:0], 0
    time_s = ring["time_s"][slots]
    newest = time_s[np.argmax(ring["tick"][slots])]
    slots = slots[(time_s > newest - PAST_S) & (time_s <= newest)]
    slots = slots[np.argsort(ring["tick"][slots], kind="stable")]
    rows = ring[slots]
    hole = ((np.diff(slots) % size) != 1) | (np.diff(rows["time_s"]) <= 0) | (np.diff(rows["tick"]) <= 0)
    beside = np.zeros(rows.size, bool)
    beside[:-1] |= hole
    beside[1:] |= hole
    if rows.size and slots[-1] != (head - 1) % size:
        beside[-1] = True  # the newest pages are old
    if beside.any():
        beside[0] = True
    between = int(np.sum((np.diff(slots)[hole] - 1) % size))
    return rows[~beside], int(np.count_nonzero(beside)) + between
