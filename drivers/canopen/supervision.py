"""Processing of received frames and the frames to send: the compiled part, independent of the transport.

Every frame goes through :func:`take_frame`; a tick ends in :func:`verdict` and :func:`command`. The compiled exchange on a
descriptor (``cyclic.py``) and the one through python-can (``callback.py``) both call these.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.canopen import layout as w
from drivers.canopen._others import foreign_answer, foreign_request, lose, note, take_sample, too_many_samples
from drivers.canopen._read_back import heard, other_mode, remember
from drivers.canopen._sync import begin_sample, take_sync
from drivers.canopen.state_machine import (
    DISABLE_VOLTAGE,
    ENABLE_OPERATION,
    ENABLED,
    FAULT_BIT,
    FAULT_RESET,
    QUICK_STOP,
    next_controlword,
    state_of,
)
from drivers.interface import (
    DEVICE_FAULT,
    ERROR,
    LOST,
    MISSED,
    OK,
    STATUS_ENABLED,
    STATUS_HELD,
    X_COUNTS,
    X_CURRENT,
    X_CURRENT_MEASURED,
    X_DEVICE_CODE,
    X_ENABLE,
    X_STATUS,
)
from hapticd.jit import njit

_GENERIC_ERROR = 0x1000
_ERROR_CODE_OBJECT = 0x603F
_SDO_UPLOADED_2 = 0x4B
_SDO_ABORTED = 0x80
_RAW_MAX = 32767.0


@njit("int64(int64)", counted=False)
def _signed8(value: int) -> int:
    return ((value & 0xFF) ^ 0x80) - 0x80


@njit("int64(int64)", counted=False)
def _signed16(value: int) -> int:
    return ((value & 0xFFFF) ^ 0x8000) - 0x8000


@njit("int64(int64)", counted=False)
def _signed32(value: int) -> int:
    return ((value & 0xFFFFFFFF) ^ 0x80000000) - 0x80000000


@njit("int64(int64[::1])", counted=False)
def back_bytes(s: NDArray[Any]) -> int:
    """Bytes of TPDO 2: demand, mode and inputs, as far as mapped; 0: there is none."""
    demand, mode, inputs = s[w.READ_BACK] == 1, s[w.MODE_WANTED] != 0, s[w.HELD_MASK] != 0
    return (2 if demand else 0) + (1 if mode else 0) + (4 if inputs else 0)


@njit("void(int64[::1], int64)", counted=False)
def _take_answer(s: NDArray[Any], data: int) -> None:
    """An SDO reply of our drive: to the own request for 0x603F, or to another client's request."""
    about = (data >> 8) & 0xFFFFFF
    if s[w.ERROR_CODE_ASKED] == 1 and about == _ERROR_CODE_OBJECT and data & 0xFF in (_SDO_UPLOADED_2, _SDO_ABORTED):
        if data & 0xFF == _SDO_UPLOADED_2:
            s[w.ERROR_CODE] = (data >> 32) & 0xFFFF
    else:
        foreign_answer(s, data)


@njit("void(int64[::1], int64, int64)", counted=False)
def _take_guard(s: NDArray[Any], length: int, data: int) -> None:
    """Boot-up, guarding reply or heartbeat of our node (CiA 301, 7.2.8.3)."""
    if length != 1:
        s[w.IGNORED] += 1
    elif data & 0xFF == 0:
        lose(s, w.LOST_REBOOTED, 0)
    elif data & 0x7F != w.NMT_OPERATIONAL:
        lose(s, w.LOST_STATE, data & 0x7F)
    elif s[w.GUARD_OPEN] == 1:
        toggle = data & 0x80
        if s[w.GUARD_TOGGLE] < 0 or toggle == s[w.GUARD_TOGGLE]:
            s[w.GUARD_OPEN] = 0
            s[w.GUARD_MISSED] = 0
        else:
            s[w.GUARD_OPEN] = 2
        s[w.GUARD_TOGGLE] = toggle ^ 0x80
    else:
        s[w.IGNORED] += 1


@njit("void(int64[::1], int64, int64)", counted=False)
def _take_back(s: NDArray[Any], length: int, data: int) -> None:
    """TPDO 2: demand and mode of the drive, and its inputs."""
    if length != back_bytes(s):
        note(s, w.EVENT_LENGTH_2, length)
        return
    if s[w.READ_BACK] == 1:
        s[w.DEMAND] = _signed16(data)
        s[w.MODE] = _signed8(data >> 16) if s[w.MODE_WANTED] != 0 else 0
        s[w.DEMAND_FRESH] = 1
    s[w.HELD] = 1 if data & s[w.HELD_MASK] != 0 else 0
    s[w.HELD_FRESH] = 1


@njit("void(int64[::1], int64, int64)", counted=False)
def take_frame(s: NDArray[Any], low: int, data: int) -> None:
    """Process one frame from the bus.

    Args:
        s: the exchange's memory. low, data: the two words of a ``struct can_frame``.
    """
    identifier = low & 0xFFFFFFFF
    length = (low >> 32) & 0xFF
    node = s[w.NODE]
    cob = identifier & 0x7FF
    if identifier & w.ERROR_FRAME:
        if identifier & w.ERROR_BUS_OFF:
            lose(s, w.LOST_BUS_OFF, 0)
        s[w.IGNORED] += 1
    elif identifier & w.EXTENDED or identifier & 0x1FFFF800 or length > 8:
        s[w.IGNORED] += 1
    elif identifier & w.REMOTE:
        if cob == w.GUARD + node:
            note(s, w.EVENT_MASTER, identifier)
        s[w.IGNORED] += 1
    elif cob == w.TPDO1 + node:
        if length == w.TPDO1_BYTES:
            s[w.STATUSWORD] = data & 0xFFFF
            s[w.POSITION] = _signed32(data >> 16)
            s[w.ACTUAL] = _signed16(data >> 48)
            take_sample(s, data)
        else:
            note(s, w.EVENT_LENGTH, length)
    elif cob == w.TPDO2 + node and back_bytes(s) != 0:
        _take_back(s, length, data)
    elif cob == w.EMCY_BASE + node:
        if length == 8:
            s[w.EMCY] = data & 0xFFFF
            s[w.EMCY_EVENT] = 1 if s[w.EMCY] != 0 else 0
        else:
            s[w.IGNORED] += 1
    elif cob == w.GUARD + node:
        _take_guard(s, length, data)
    elif cob == w.SYNC and s[w.FOLLOWS] == 1:
        take_sync(s)
    elif cob == w.SYNC or cob == w.NMT or cob == w.RPDO1 + node:
        note(s, w.EVENT_MASTER, identifier)
    elif cob == w.SDO_REPLY + node and length == 8:
        _take_answer(s, data)
    elif cob == w.SDO_REQUEST + node and length == 8:
        foreign_request(s, data)
    else:
        s[w.IGNORED] += 1


@njit("boolean(int64[::1])", counted=False)
def may_sync(s: NDArray[Any]) -> bool:
    """After all frames were read: whether SYNC may be sent, so that no pending frame can be taken for its reply.

    After a SYNC without a reply this tick listens first: otherwise a drive that is one period late would reply to every
    SYNC with the previous sample, a hidden delay of τ_D = 1.
    """
    s[w.STOPPED] = 0
    begin_sample(s)
    may = s[w.OWED] == 0
    s[w.OWED] = 1 if may else 0
    return bool(may)


@njit("boolean(int64[::1])", counted=False)
def answered(s: NDArray[Any]) -> bool:
    """Whether the wait is over: TPDO 1 and, if needed, the inputs have come; or an event ends the tick."""
    sampled = s[w.FRESH] > 0 and (s[w.HELD_MASK] == 0 or s[w.HELD_FRESH] == 1)
    return bool(sampled or s[w.REASON] != 0 or s[w.EVENT] != 0)


@njit("int64(int64[::1], int64[::1])", counted=False)
def _fault(s: NDArray[Any], x: NDArray[Any]) -> int:
    code = s[w.EMCY] if s[w.EMCY] != 0 else s[w.ERROR_CODE]
    x[X_DEVICE_CODE] = code if code != 0 else _GENERIC_ERROR
    s[w.FAULT_REPORTED] = 1
    s[w.STOPPED] = 1
    s[w.RESETTING_NS] = 0
    return DEVICE_FAULT


@njit("int64(int64[::1], int64[::1], int64)", counted=False)
def verdict(s: NDArray[Any], x: NDArray[Any], now_ns: int) -> int:
    """Finish a read: set the exchange's out words, and return its code.

    A fault of the drive is reported when it occurs and while the amplifier is requested. After the loop has disabled the
    amplifier it is no longer reported, and it is reset when the amplifier is requested again.
    """
    xf = x.view(np.float64)
    f = s.view(np.float64)
    if s[w.REASON] != 0:
        s[w.STOPPED] = 1
        x[X_STATUS] = 0
        return LOST
    if too_many_samples(s, now_ns):
        note(s, w.EVENT_SURPLUS, s[w.UNASKED])
    if s[w.EVENT] != 0:
        s[w.EVENT_TOLD] = s[w.EVENT]
        s[w.EVENT] = 0
        s[w.STOPPED] = 1
        return ERROR
    emcy = s[w.EMCY_EVENT] == 1
    s[w.EMCY_EVENT] = 0
    fresh = s[w.FRESH]
    s[w.FRESH] = 0
    if fresh > 0:
        s[w.OWED] = 0
        s[w.SAMPLED] = 1
        s[w.STALE] += fresh - 1
        position = s[w.POSITION]
        if s[w.BEGUN] == 0:
            s[w.BEGUN] = 1
            s[w.COUNTS] = position
        else:
            s[w.COUNTS] += _signed32(position - s[w.LAST_POSITION])
        s[w.LAST_POSITION] = position
        x[X_COUNTS] = s[w.COUNTS]
        xf[X_CURRENT_MEASURED] = s[w.ACTUAL] * f[w.AMPERE_PER_ACTUAL]
        x[X_STATUS] = STATUS_ENABLED if state_of(s[w.STATUSWORD]) == ENABLED else 0
        if s[w.HELD] == 1 and s[w.HELD_MASK] != 0:
            x[X_STATUS] |= STATUS_HELD
        if s[w.STATUSWORD] & FAULT_BIT == 0:
            s[w.FAULT_REPORTED] = 0
            s[w.ERROR_CODE_ASKED] = 0
            s[w.ERROR_CODE] = 0
    if emcy and s[w.RESETTING_NS] == 0:
        return _fault(s, x)
    if fresh == 0 or (s[w.HELD_MASK] != 0 and s[w.HELD_FRESH] == 0):
        return MISSED
    if s[w.STATUSWORD] & FAULT_BIT:
        if s[w.RESETTING_NS] != 0:
            if now_ns - s[w.RESETTING_NS] > w.FAULT_RESET_NS:
                return _fault(s, x)
        elif s[w.FAULT_REPORTED] == 0 or s[w.WANTED] == 1:
            return _fault(s, x)
    return OK


@njit("boolean(int64[::1], int64)", counted=False)
def _stuck(s: NDArray[Any], now_ns: int) -> bool:
    """Whether a transition of the state machine towards Operation enabled takes too long."""
    state = state_of(s[w.STATUSWORD])
    if state != s[w.STATE_SEEN] or state == ENABLED:
        s[w.STATE_SEEN] = state
        s[w.STATE_NS] = now_ns
    return bool(now_ns - s[w.STATE_NS] > w.TRANSITION_NS)


@njit("int64(int64[::1], int64[::1], int64)", counted=False)
def command(s: NDArray[Any], x: NDArray[Any], now_ns: int) -> int:
    """Write RPDO 1 into OUT: controlword and target. Returns OK, ERROR (a missing transition) or LOST.

    The target is not zero in Operation enabled only.
    """
    f = s.view(np.float64)
    enable = x[X_ENABLE] == 1
    statusword = s[w.STATUSWORD]
    if enable and s[w.WANTED] == 0:
        s[w.STATE_SEEN] = -1
        s[w.EVENT_TOLD] = 0
        if statusword & FAULT_BIT and s[w.STOPPED] == 0:
            s[w.RESETTING_NS] = now_ns
    if not enable or statusword & FAULT_BIT == 0:
        s[w.RESETTING_NS] = 0
    s[w.WANTED] = 1 if enable else 0

    if other_mode(s):
        lose(s, w.LOST_MODE, s[w.MODE])
    result = int(heard(s))
    if result == LOST:
        lose(s, w.LOST_DEAF, s[w.UNHEARD] if s[w.DEMAND_SEEN] == 1 else -s[w.UNHEARD])
    target = 0
    if not enable:
        word = DISABLE_VOLTAGE
    elif s[w.STOPPED] == 1 or s[w.REASON] != 0:
        word = QUICK_STOP
    elif s[w.RESETTING_NS] != 0:
        word = FAULT_RESET
    else:
        word = next_controlword(statusword)
        if _stuck(s, now_ns):
            s[w.EVENT_TOLD] = w.EVENT_TRANSITION
            s[w.DETAIL] = statusword
            word = QUICK_STOP
            result = ERROR
        elif word == ENABLE_OPERATION and state_of(statusword) == ENABLED:
            raw = np.rint(x.view(np.float64)[X_CURRENT] * f[w.COMMAND_PER_AMPERE])
            target = int(min(max(raw, -_RAW_MAX), _RAW_MAX))
    remember(s, target)
    s[w.CONTROLWORD] = word
    s[w.OUT] = (w.RPDO1 + s[w.NODE]) | w.RPDO1_BYTES << 32
    s[w.OUT + 1] = word | (target & 0xFFFF) << 16
    return LOST if s[w.REASON] != 0 else result


@njit("boolean(int64[::1], int64, float64)", counted=False)
def sign_of_life(s: NDArray[Any], now_ns: int, period_ns: float) -> bool:
    """Whether the guarding message for the drive's watchdog is due before the next tick; it is then in OUT.

    The loop sends it, so that the drive detects a loop that hangs.
    """
    if s[w.REASON] != 0 or now_ns + period_ns <= s[w.GUARD_SENT_NS] + s[w.GUARD_NS]:
        return False
    if s[w.GUARD_ANSWERED] == 1:
        if s[w.GUARD_OPEN] != 0:
            if s[w.GUARD_OPEN] == 1:
                s[w.GUARD_TOGGLE] = -1
            s[w.GUARD_MISSED] += 1
            if s[w.GUARD_MISSED] >= w.GUARD_TRIES:
                lose(s, w.LOST_GUARD, s[w.GUARD_MISSED])
                return False
        s[w.GUARD_OPEN] = 1
    s[w.GUARD_SENT_NS] = now_ns
    s[w.OUT] = s[w.GUARD_LOW]
    s[w.OUT + 1] = s[w.GUARD_DATA]
    return True


@njit("boolean(int64[::1])", counted=False)
def asks_error_code(s: NDArray[Any]) -> bool:
    """Whether there is a fault without an EMCY: the SDO request for 0x603F is then in OUT, once."""
    if s[w.STATUSWORD] & FAULT_BIT == 0 or s[w.EMCY] != 0 or s[w.ERROR_CODE_ASKED] == 1 or s[w.REASON] != 0:
        return False
    s[w.ERROR_CODE_ASKED] = 1
    s[w.OUT] = (w.SDO_REQUEST + s[w.NODE]) | 8 << 32
    s[w.OUT + 1] = 0x40 | _ERROR_CODE_OBJECT << 8
    return True
