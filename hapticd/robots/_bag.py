"""A joint of a robot out of a bag (ROS 1 ``.bag``; ROS 2 folder, ``.db3`` or ``.mcap``) as a native run.

The rows are the messages that have the position. What is on another topic is joined to them as it was at each instant: the
last value that is not later (`pandas.merge_asof`).
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hapticd.config.nearest import nearest_name
from hapticd.record import RunFileError, import_run
from hapticd.record.mcap import TOPIC
from hapticd.robots._reference import JOINT_STATE, AmbiguousJointError, Reference

if TYPE_CHECKING:
    from hapticd.record import Imported
    from hapticd.record.importing_map import ImportMap

STAMP, LOG_TIME = "stamp", "log_time"
"""Columns of the time, in ns: of the message's header, and of the recorder."""
_SUFFIXES = (".bag", ".db3", ".mcap")


@dataclass
class _Track:
    """One signal as it was read: instants by the header and by the recorder, in ns, and values."""

    topic: str
    has_header: bool = True
    stamp: list[int] = field(default_factory=list)
    log: list[int] = field(default_factory=list)
    values: list[float] = field(default_factory=list)
    without: int = 0


def is_bag(path: Path) -> bool:
    """Whether a path is that of a bag, by its looks."""
    return path.is_dir() or path.suffix.lower() in _SUFFIXES


def import_bag(source: str | Path, mapping: ImportMap, out: str | Path, *, force: bool = False) -> Imported:
    """Read one joint of a bag and write it as a native run.

    Args:
        source: the bag.
        mapping: its columns are signals (`hapticd.robots._reference`); its time ``stamp`` or ``log_time``, in ns.
        out: the run file to write; it appears whole or not at all.
        force: replace a file that exists.

    Raises:
        RunFileError: rosbags is not installed; the bag cannot be read, or has no such topic, joint or field; what
            `import_run` refuses.
    """
    path = Path(source)
    if mapping.time.column not in (STAMP, LOG_TIME) or mapping.time.unit != "ns":
        raise RunFileError(f"{path}: time of a bag is column {STAMP} (of the header) or {LOG_TIME}, with unit: ns")
    signals = (mapping.position, mapping.current, mapping.force, mapping.current_measured)
    references = [Reference.of(str(signal.column)) for signal in signals if signal is not None]
    tracks = _read(path, references)
    table, notes = _joined(path, references, tracks, str(mapping.time.column))
    with tempfile.TemporaryDirectory(prefix="hapticd-bag-") as folder:
        columns = Path(folder) / f"{path.name}.parquet"
        table.to_parquet(columns, index=False)
        try:
            done = import_run(columns, mapping, out, force=force)
        except RunFileError as error:
            raise RunFileError(str(error).replace(str(columns), str(path))) from None
    return replace(done, warnings=(*notes, *done.warnings))


def _read(path: Path, references: list[Reference]) -> dict[Reference, _Track]:
    try:
        reader_of: Any = import_module("rosbags.highlevel").AnyReader
        stores: Any = import_module("rosbags.typesys")
    except ImportError as error:
        raise RunFileError(
            f"{path}: a bag is read by rosbags, which is not installed: pip install 'hapticd[rosbag]' ({error})"
        ) from error
    if not path.exists():
        raise RunFileError(f"cannot read {path}: no such file")
    try:
        with reader_of([path], default_typestore=stores.get_typestore(stores.Stores.LATEST)) as reader:
            kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            if set(kinds) == {TOPIC}:
                raise RunFileError(f"{path} describes itself: leave --map out")
            topics = {reference: _topic_of(path, reference, kinds) for reference in references}
            tracks = {reference: _Track(topic) for reference, topic in topics.items()}
            wanted = [connection for connection in reader.connections if connection.topic in topics.values()]
            for connection, log, raw in reader.messages(connections=wanted):
                message = reader.deserialize(raw, connection.msgtype)
                header = getattr(getattr(message, "header", None), "stamp", None)
                stamp = log if header is None else int(header.sec) * 1_000_000_000 + int(header.nanosec)
                for reference, track in tracks.items():
                    if track.topic == connection.topic:
                        track.has_header = header is not None
                        _keep(track, reference.value(message, connection.msgtype), stamp, log)
    except RunFileError:
        raise
    except AmbiguousJointError as error:
        raise RunFileError(f"{path}: {error}") from None
    except Exception as error:  # a bag is anybody's, and rosbags raises what its parts do
        raise RunFileError(f"{path} is not a readable bag: {type(error).__name__}: {error}") from error
    for reference, track in tracks.items():
        if not track.values:
            raise RunFileError(
                f"{path}: {reference.text}: none of {track.without} messages on {topics[reference]} has it"
            )
    return tracks


def _keep(track: _Track, value: float | None, stamp: int, log: int) -> None:
    if value is None:
        track.without += 1
        return
    track.stamp.append(stamp)
    track.log.append(log)
    track.values.append(value)


def _topic_of(path: Path, reference: Reference, kinds: dict[str, str]) -> str:
    listed = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(kinds.items())) or "nothing"
    head, colon, rest = reference.rest.partition(":")
    if reference.topic is None and colon and f"/{head}" in kinds:
        raise RunFileError(f"{path}: {reference.text}: a topic begins with a slash: write /{head}:{rest}")
    states = [topic for topic, kind in kinds.items() if kind == JOINT_STATE]
    topic = reference.topic if reference.topic is not None else states[0] if len(states) == 1 else None
    if topic is None:
        which = (
            f"{len(states)} topics have JointState: write {states[0]}:{reference.rest}" if states else "no JointState"
        )
        raise RunFileError(f"{path}: {reference.text}: {which}; the bag has {listed}")
    if topic not in kinds:
        near = nearest_name(topic, list(kinds))
        hint = f"did you mean {near}? " if near else ""
        raise RunFileError(f"{path}: {reference.text}: no such topic; {hint}the bag has {listed}")
    if problem := reference.problem(kinds[topic]):
        raise RunFileError(f"{path}: {reference.text}: {problem}")
    return topic


def _joined(
    path: Path, references: list[Reference], tracks: dict[Reference, _Track], time: str
) -> tuple[Any, list[str]]:
    """One table with a row for every position, and what is to be known of it.

    What is on the position's own topic is of the same message; a message without it makes no row.
    """
    import pandas as pd

    first, *others = dict.fromkeys(references)
    table, notes = _frame(tracks[first], first.text, time), []
    read = len(tracks[first].values)
    by_log = f"; with time.column: {LOG_TIME} the recorder's clock stamps every message"
    if len(table) == 1 < read:
        raise RunFileError(f"{path}: all {read} messages have the {time} {table[time].iloc[0]} ns{by_log}")
    if tracks[first].without:
        notes.append(f"{tracks[first].without} messages are without {first.text}")
    if len(table) < read:
        notes.append(f"{read - len(table)} of {read} messages are left out: a later one has the same {time}")
    for reference in others:
        track = tracks[reference]
        is_same = track.topic == tracks[first].topic
        other = _frame(track, reference.text, time).assign(known=lambda frame: frame[time])
        if not is_same and len(other) > 1 and not _overlap(table[time], other[time]):
            raise RunFileError(
                f"{path}: {reference.text} and {first.text} have no time in common; do their clocks agree?"
                + by_log * (time == STAMP)
            )
        table = pd.merge_asof(table, other, on=time, direction="backward", tolerance=0 if is_same else None)
        missing = int(table[reference.text].isna().sum())
        table = table.dropna(subset=[reference.text])
        if missing:
            notes.append(
                f"{missing} messages without {reference.text} are left out"
                if is_same
                else f"{missing} rows before the first {reference.text} are left out"
            )
        if table.empty:
            raise RunFileError(
                f"{path}: no {first.text} comes after the first {reference.text}; do their clocks agree?"
            )
        age = int((table[time] - table.pop("known")).max()) * 1e-9
        if not is_same:
            notes.append(
                f"{reference.text} has {len(other)} values for {len(table)} positions: each row has the last one that is "
                f"not later, {age:.3g} s old at most"
            )
            if time == STAMP and tracks[first].has_header and not track.has_header:
                notes.append(f"{reference.text} has no {STAMP} of its own: its instants are the recorder's")
    return table, notes


def _frame(track: _Track, name: str, time: str) -> Any:
    """Instants and values in the order of the instants; of several at one instant the last."""
    import pandas as pd

    data = pd.DataFrame({STAMP: track.stamp, LOG_TIME: track.log, name: track.values})
    return data[[time, name]].sort_values(time, kind="stable").drop_duplicates(time, keep="last")


def _overlap(one: Any, other: Any) -> bool:
    """Whether two sorted columns of instants have a time in common."""
    return bool(one.iloc[0] <= other.iloc[-1] and other.iloc[0] <= one.iloc[-1])
