"""Random and mutated CAN frames into the drive's frame decoder, judged by an oracle that shares no code with it.

``python -m tests.drivers.fuzz canopen``. CAN carries its own CRC in the controller, so what reaches the decoder is taken at
its word: a frame must change exactly what CiA 301 says it changes, and every other one nothing.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from drivers.canopen import layout as w
from drivers.canopen.supervision import take_frame
from hapticd.jit import njit
from tests.drivers.fuzz import Advance, FuzzReport

_BLOCK = 20_000
_NODE = 5
_SAMPLE, _EMCY, _LOST, _EVENT, _ERROR_CODE = 1, 2, 4, 8, 16
_WIRE: Final = np.dtype([("id", "<u4"), ("length", "u1"), ("pad", "u1", 3), ("data", "u1", 8)])

# identifier, length, data of what a drive and its neighbours send.
_GENUINE: Final = (
    (0x185, 8, "37 02 d2 04 00 00 0a 00"),
    (0x185, 8, "50 02 ff ff ff 7f 00 80"),
    (0x085, 8, "10 23 01 00 00 00 00 00"),
    (0x085, 8, "00 00 00 00 00 00 00 00"),
    (0x705, 1, "85"),
    (0x705, 1, "05"),
    (0x705, 1, "00"),
    (0x705, 1, "7f"),
    (0x705 | w.REMOTE, 0, ""),
    (0x000, 2, "01 05"),
    (0x080, 0, ""),
    (0x205, 4, "0f 00 64 00"),
    (0x585, 8, "4b 3f 60 00 10 23 00 00"),
    (0x605, 8, "40 41 60 00 00 00 00 00"),
    (0x605, 8, "2f 60 60 00 03 00 00 00"),
    (0x605, 8, "c2 60 60 00 01 00 00 00"),
    (0x585, 8, "60 72 60 00 00 00 00 00"),
    (0x585, 8, "a4 72 60 00 7f 00 00 00"),
    (0x585, 8, "30 00 00 00 00 00 00 00"),
    (0x585, 8, "80 60 60 00 30 00 09 06"),
    (0x186, 8, "37 02 d2 04 00 00 0a 00"),
    (0x040 | w.ERROR_FRAME, 8, ""),
    (0x185 | w.EXTENDED, 8, "37 02 d2 04 00 00 0a 00"),
)


@njit("void(int64[::1], int64[:,::1], int64[:,::1])")
def _feed(s: NDArray[Any], frames: NDArray[Any], seen: NDArray[Any]) -> None:
    """Give each frame of (n, 2) to the decoder; ``seen`` (n, 5): effects, statusword, position, actual, code."""
    for k in range(len(frames)):
        s[w.FRESH] = 0
        s[w.EMCY] = -1
        s[w.EMCY_EVENT] = 0
        s[w.REASON] = 0
        s[w.EVENT] = 0
        s[w.ERROR_CODE] = -1
        take_frame(s, frames[k, 0], frames[k, 1])
        effects = 0
        if s[w.FRESH] != 0:
            effects |= _SAMPLE
        if s[w.EMCY] >= 0:
            effects |= _EMCY
        if s[w.REASON] != 0:
            effects |= _LOST
        if s[w.EVENT] != 0:
            effects |= _EVENT
        if s[w.ERROR_CODE] >= 0:
            effects |= _ERROR_CODE
        seen[k, 0] = effects
        seen[k, 1] = s[w.STATUSWORD]
        seen[k, 2] = s[w.POSITION]
        seen[k, 3] = s[w.ACTUAL]
        seen[k, 4] = s[w.EMCY] if s[w.EMCY] >= 0 else s[w.ERROR_CODE]


def expected_effects(frames: NDArray[Any]) -> NDArray[np.int64]:
    """What each frame may change, from its fields as ``struct can_frame`` names them. Shape (n,)."""
    identifier, length, data = frames["id"].astype(np.int64), frames["length"], frames["data"]
    error = identifier & 0x20000000 != 0
    plain = (identifier & 0x80000000 == 0) & ~error & (length <= 8)
    remote = identifier & 0x40000000 != 0
    number = identifier & 0x1FFFFFFF
    data_frame = plain & ~remote
    ours = data_frame & (number == 0x180 + _NODE)
    guard = data_frame & (number == 0x700 + _NODE) & (length == 1)
    master = data_frame & np.isin(number, (0x000, 0x080, 0x200 + _NODE))
    master |= plain & remote & (number == 0x700 + _NODE)
    reply = data_frame & (number == 0x580 + _NODE) & (length == 8)
    written = reply & (
        np.isin(data[:, 0], (0x60, 0xA0, 0xA4)) | (np.isin(data[:, 0], (0x20, 0x30)) & (data[:, 1:] == 0).all(axis=1))
    )
    written |= data_frame & (number == 0x600 + _NODE) & (length == 8) & np.isin(data[:, 0] >> 5, (0, 1, 6))
    reply &= (data[:, :4] == (0x4B, 0x3F, 0x60, 0x00)).all(axis=1)
    effects = np.zeros(len(frames), np.int64)
    effects[ours & (length == 8)] |= _SAMPLE
    effects[data_frame & (number == 0x080 + _NODE) & (length == 8)] |= _EMCY
    effects[(error & (identifier & 0x40 != 0)) | (guard & ((data[:, 0] == 0) | (data[:, 0] & 0x7F != 5)))] |= _LOST
    effects[written] |= _LOST
    effects[(ours & (length != 8)) | master] |= _EVENT
    effects[reply] |= _ERROR_CODE
    return effects


def fuzz(count: int, seed: int, advance: Advance) -> FuzzReport:
    """Give ``count`` frames to the decoder.

    Args:
        count: number of frames. seed: of the random generator. advance: called with the number done.
    """
    random = np.random.default_rng(seed)
    report = FuzzReport(rejected={"not for this driver": 0, "another master": 0, "a lost node": 0})
    block = np.zeros(w.WORDS, np.int64)
    block[w.NODE], block[w.ERROR_CODE_ASKED], block[w.GUARD_OPEN] = _NODE, 1, 1
    while report.inputs < count:
        frames = _frames(random, min(_BLOCK, count - report.inputs))
        seen = np.zeros((len(frames), 5), np.int64)
        _feed(block, frames.view(np.int64).reshape(-1, 2), seen)
        _judge(report, frames, seen)
        report.inputs += len(frames)
        advance(report.inputs)
    return report


def _frames(random: np.random.Generator, count: int) -> NDArray[Any]:
    """A third random bytes, a third genuine, a third genuine with one to three bits flipped."""
    genuine = np.zeros(len(_GENUINE), _WIRE)
    for row, (identifier, length, data) in zip(genuine, _GENUINE, strict=True):
        row["id"], row["length"] = identifier, length
        row["data"][: len(bytes.fromhex(data))] = np.frombuffer(bytes.fromhex(data), np.uint8)
    frames = genuine[random.integers(len(genuine), size=count)]
    raw = frames.view(np.uint8).reshape(count, _WIRE.itemsize)
    third = count // 3
    raw[:third] = random.integers(256, size=(third, _WIRE.itemsize))
    for _ in range(3):
        rows = np.arange(third, 2 * third)[random.random(third) < 0.6]
        raw[rows, random.integers(_WIRE.itemsize, size=len(rows))] ^= np.uint8(1) << random.integers(
            8, size=len(rows), dtype=np.uint8
        )
    return frames


def _judge(report: FuzzReport, frames: NDArray[Any], seen: NDArray[np.int64]) -> None:
    effects = expected_effects(frames)
    data = frames["data"]
    sample = effects & _SAMPLE != 0
    statusword = np.ascontiguousarray(data[:, 0:2]).view("<u2")[:, 0]
    position = np.ascontiguousarray(data[:, 2:6]).view("<i4")[:, 0]
    actual = np.ascontiguousarray(data[:, 6:8]).view("<i2")[:, 0]
    told = np.where(effects & _EMCY != 0, statusword, np.ascontiguousarray(data[:, 4:6]).view("<u2")[:, 0])
    coded = effects & (_EMCY | _ERROR_CODE) != 0
    wrong = seen[:, 0] != effects
    wrong |= sample & ((seen[:, 1] != statusword) | (seen[:, 2] != position) | (seen[:, 3] != actual))
    wrong |= coded & (seen[:, 4] != told)
    report.accepted += int((sample & ~wrong).sum())
    report.rejected["not for this driver"] += int((effects == 0).sum())
    report.rejected["another master"] += int((effects & _EVENT != 0).sum())
    report.rejected["a lost node"] += int((effects & _LOST != 0).sum())
    report.wrong += int(wrong.sum())
    for row in np.flatnonzero(wrong)[: 5 - len(report.violations)]:
        report.violations.append(
            f"frame {frames[row].tobytes().hex(' ')}: effects {seen[row, 0]:#x}, expected {effects[row]:#x}"
        )
