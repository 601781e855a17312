"""Whether a run file is as it was written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from hapticd.record.errors import RunFileError
from hapticd.record.reader import damage_text, native_stream
from hapticd.record.stream import CHECKED_VERSION, Damage


@dataclass(frozen=True)
class Verdict:
    """What the checksums of a run file say.

    Attributes:
        path: the file.
        version: of its format; below 2 there are no checksums.
        rows: rows that can be read.
        truncated: the recording was not ended properly; its rows end with the last whole batch.
        damage: rows that are lost though the file goes on after them.
        metadata_damaged: config, units or names are not what was written.
        damage_text: what is damaged, a sentence each.
    """

    path: Path
    version: int
    rows: int
    truncated: bool
    damage: tuple[Damage, ...]
    metadata_damaged: bool
    damage_text: tuple[str, ...]

    @property
    def checked(self) -> bool:
        """Whether there are checksums."""
        return self.version >= CHECKED_VERSION

    @property
    def intact(self) -> bool:
        """Whether nothing contradicts what was written."""
        return not self.damage and not self.metadata_damaged


def verify(path: str | Path) -> Verdict:
    """Read a native run file and compare every checksum.

    Raises:
        RunFileError: it cannot be read, or is no native run file.
    """
    path = Path(path)
    if path.suffix.lower() in (".csv", ".parquet"):
        raise RunFileError(f"{path} has no checksums; only native run files (.arrow) have")
    stream = native_stream(path)
    rows = sum(batch.num_rows for batch in stream.batches)
    text = tuple(damage_text(stream))
    return Verdict(path, stream.version, rows, not stream.whole, tuple(stream.damage), stream.metadata_damaged, text)
