"""Memory of the compiled exchange: one block of int64 words, followed by the byte buffers."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from drivers.libc import SCRATCH
from drivers.serial_dac import budget
from drivers.serial_dac.framing import DECODER_SIZE, PAYLOAD_SIZE

S_DESCRIPTOR: Final = 0
S_LOST: Final = 1
"""Not 0: the session has ended (GONE, RESTARTED); the exchange no longer uses the descriptor."""
S_SEQ: Final = 2
"""seq of the last SAMPLE."""
S_COMMAND_SEQ: Final = 3
"""seq of the last COMMAND that was sent completely."""
S_UNPROVEN: Final = 4
"""1: the last reply did not prove the last COMMAND; the next write reports it."""
S_TORN: Final = 5
"""Not 0: a frame was sent in part; this byte makes it invalid, and a delimiter ends it, before the next."""
S_COUNTS: Final = 6
"""Unwrapped encoder position."""
S_COUNTER_BITS: Final = 7
S_DAC_BITS: Final = 8
S_TIMEOUT_NS: Final = 9
"""Reply time-out of the options; 0: four fifths of a period, or S_REPLY_NS if that is longer."""
S_REPLY_NS: Final = 10
S_COMMAND_NS: Final = 11
"""Transmission time of a COMMAND: the wait for a reply ends this long before the end of the period."""
S_STALE: Final = 12
"""Number of replies with another seq."""
S_BAD_FRAMES: Final = 13
S_POSITION: Final = 14
"""Scratch: position in the chunk."""
S_INPUTS: Final = 15
"""1: samples contain the inputs, and the board switches the output off when the enable input opens."""
S_CLOCK: Final = 16
_WORDS = S_CLOCK + SCRATCH

GONE: Final = 1
"""The port is lost or closed."""
RESTARTED: Final = 2
"""The board is UNCONFIGURED: it has restarted during this session, and lost its count."""

TX_SIZE: Final = 24
CHUNK_SIZE: Final = 512
DECODER_AT: Final = 8 * _WORDS
PAYLOAD_AT: Final = DECODER_AT + DECODER_SIZE
REQUEST_AT: Final = PAYLOAD_AT + PAYLOAD_SIZE
TX_AT: Final = REQUEST_AT + PAYLOAD_SIZE
CHUNK_AT: Final = TX_AT + TX_SIZE
STATE_WORDS: Final = -(-(CHUNK_AT + CHUNK_SIZE) // 8)

assert TX_SIZE >= 2 + budget.COMMAND_BYTES


def new_state(descriptor: int, baud: int, reply_timeout_s: float | None, more: int = 0) -> NDArray[np.int64]:
    """Initial state of an exchange, with ``more`` bytes per reply, shape (STATE_WORDS,)."""
    state = np.zeros(STATE_WORDS, np.int64)
    state[S_DESCRIPTOR] = descriptor
    state[S_TIMEOUT_NS] = round((reply_timeout_s or 0.0) * 1e9)
    line_s = budget.wire_s(budget.SAMPLE_BYTES + budget.REPLY_BYTES + more, baud)
    state[S_REPLY_NS] = round(budget.REPLY_MARGIN * line_s * 1e9)
    state[S_COMMAND_NS] = round(budget.wire_s(budget.COMMAND_BYTES, baud) * 1e9)
    return state
