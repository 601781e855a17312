"""Memory layout of one drive's exchange, shared by the compiled functions and by Python, one writer each.

Eight-byte words; those marked ``f64`` are in the floating-point view of the same memory.
"""

from __future__ import annotations

from typing import Final

from drivers.libc import SCRATCH as LIBC_SCRATCH

# Set during bring-up.
DESCRIPTOR: Final = 0
NODE: Final = 1
REPLY_NS: Final = 2
"""Longest time of TPDO 1 after SYNC; 0: four fifths of a servo period."""
GUARD_NS: Final = 3
"""Interval between two guarding messages to the drive, watchdog/4."""
GUARD_LOW: Final = 4
"""First word of the guarding message: a remote frame (node guarding) or a heartbeat."""
GUARD_DATA: Final = 5
GUARD_ANSWERED: Final = 6
"""1: the drive replies to each guarding message (node guarding)."""
COMMAND_PER_AMPERE: Final = 7
"""f64: raw target per A."""
AMPERE_PER_ACTUAL: Final = 8
"""f64: A per raw actual current (or torque)."""
READ_BACK: Final = 9
"""1: TPDO 2 contains the demand on every SYNC."""
AMPERE_PER_DEMAND: Final = 10
"""f64: A per raw demand."""
MODE_WANTED: Final = 11
"""Mode of operation set by bring-up, if TPDO 2 contains the present one after the demand; 0: it does not."""
HELD_MASK: Final = 12
"""Bit of TPDO 2's data that is 1 while the enable input is held; 0: none is required."""
FOLLOWS: Final = 13
"""1: SYNC comes from a producer on the bus, and the loop follows it."""

# Last data of the drive.
STATUSWORD: Final = 16
POSITION: Final = 17
"""Signed 32-bit position as in the last TPDO 1."""
ACTUAL: Final = 18
FRESH: Final = 19
"""TPDO 1 since the last SYNC."""
EMCY: Final = 20
"""Error code of the last EMCY, 0 after an error reset."""
EMCY_EVENT: Final = 21
ERROR_CODE: Final = 22
"""Value of 0x603F, requested after a fault without an EMCY."""
ERROR_CODE_ASKED: Final = 23

# The exchange's own memory.
COUNTS: Final = 24
LAST_POSITION: Final = 25
BEGUN: Final = 26
OWED: Final = 27
"""1: the last SYNC has no reply yet. TPDOs have no number, so the next tick listens before it sends a SYNC."""
WANTED: Final = 29
"""Enable as requested by the last write."""
CONTROLWORD: Final = 30
STATE_SEEN: Final = 31
STATE_NS: Final = 32
"""Time since which the state machine has been in STATE_SEEN although it should change."""
RESETTING_NS: Final = 33
"""Instant of the fault reset's edge; 0: none in progress."""
FAULT_REPORTED: Final = 34
STOPPED: Final = 35
"""1: this tick ended in a fault; the command is quick stop."""
GUARD_SENT_NS: Final = 36
GUARD_OPEN: Final = 37
"""1: a guarding reply is outstanding; 2: a reply had the wrong toggle bit and is not counted."""
GUARD_TOGGLE: Final = 38
"""Toggle bit expected next (0 or 0x80); -1: any."""
GUARD_MISSED: Final = 39
REASON: Final = 40
"""Why the drive is permanently lost: LOST_*."""
EVENT: Final = 41
"""Temporary error: EVENT_*."""
EVENT_TOLD: Final = 42
"""The last EVENT that ended an exchange, for the error text."""
DETAIL: Final = 43
"""Number for REASON or EVENT: errno, identifier, length, NMT state."""

STALE: Final = 44
"""TPDO 1 that came too late for their SYNC."""
IGNORED: Final = 45
"""Frames for other nodes."""

DEMAND: Final = 46
"""Demand in the last TPDO 2, raw."""
DEMAND_FRESH: Final = 47
"""Whether a TPDO 2 came since the demand was last checked."""
UNHEARD: Final = 48
"""Samples in a row whose demand was not one of the latest commands, in Operation enabled."""
COMMANDED: Final = 49
"""f64: the latest COMMANDS_KEPT commands in A, rounded to the target's steps."""
COMMANDS_KEPT: Final = 3
"""The demand of a SYNC is the previous command, or an earlier one if the drive was late or a TPDO 2 was lost."""
NODE_STOPPED: Final = COMMANDED + COMMANDS_KEPT
"""1: the node was stopped by NMT, because it does not follow its commands."""
DEMAND_SEEN: Final = NODE_STOPPED + 1
"""1: the demand checked last was new."""
SAMPLED: Final = DEMAND_SEEN + 1
"""1: a TPDO 1 has come since the demand was last checked."""

MODE: Final = SAMPLED + 1
"""Mode of operation in the last TPDO 2; MODE_WANTED before the first."""
DUE: Final = MODE + 1
"""SYNCs without their TPDO 1; reset to 0 when every SYNC within SURPLUS_NS had a reply."""
UNANSWERED_NS: Final = DUE + 1
"""Time at which a tick last ended without a TPDO 1."""
SAMPLE: Final = UNANSWERED_NS + 1
"""The eight bytes of the last TPDO 1."""
UNASKED: Final = SAMPLE + 1
"""Total number of TPDO 1 without a SYNC."""
SURPLUS: Final = UNASKED + 1
"""The same within SURPLUS_NS, weighted: REPEATED for one equal to that before it, CHANGED for a different one."""
SURPLUS_SINCE_NS: Final = SURPLUS + 1
SDO_SEEN: Final = SURPLUS_SINCE_NS + 1
"""SDO frames to and from our drive of another client's read requests."""
HELD: Final = SDO_SEEN + 1
"""Whether the enable input was held in the last TPDO 2."""
HELD_FRESH: Final = HELD + 1
"""Whether a TPDO 2 came since the last SYNC; if an enable is required, a sample is incomplete without it."""
SYNCS: Final = HELD_FRESH + 1
"""SYNC since the loop last waited for one."""
SYNC_SURPLUS: Final = SYNCS + 1
"""SYNC more than half a period too early, within SURPLUS_NS."""
SYNC_SURPLUS_SINCE_NS: Final = SYNC_SURPLUS + 1

SCRATCH: Final = SYNC_SURPLUS_SINCE_NS + 1
FRAME: Final = SCRATCH + LIBC_SCRATCH
"""Two words: the frame just received. The words after them: the frame to send."""
OUT: Final = FRAME + 2
WORDS: Final = OUT + 2

LOST_CLOSED: Final = 1
LOST_SOCKET: Final = 2
LOST_BUS_OFF: Final = 3
LOST_REBOOTED: Final = 4
LOST_GUARD: Final = 5
LOST_STATE: Final = 6
LOST_DEAF: Final = 7
LOST_WRITTEN: Final = 8
LOST_MODE: Final = 9

EVENT_MASTER: Final = 1
EVENT_LENGTH: Final = 2
EVENT_TRANSITION: Final = 3
EVENT_LENGTH_2: Final = 4
EVENT_SURPLUS: Final = 5
EVENT_SYNCS: Final = 6

# struct can_frame (linux/can.h) as two little-endian words.
EXTENDED: Final = 0x80000000
REMOTE: Final = 0x40000000
ERROR_FRAME: Final = 0x20000000
ERROR_BUS_OFF: Final = 0x40
FRAME_BYTES: Final = 16

# Function codes of the predefined connection set (CiA 301, 7.3.3).
NMT: Final = 0x000
SYNC: Final = 0x080
EMCY_BASE: Final = 0x080
TPDO1: Final = 0x180
TPDO2: Final = 0x280
RPDO1: Final = 0x200
SDO_REPLY: Final = 0x580
SDO_REQUEST: Final = 0x600
GUARD: Final = 0x700
NMT_OPERATIONAL: Final = 5

TPDO1_BYTES: Final = 8
RPDO1_BYTES: Final = 4
UNHEARD_LIMIT: Final = 3
"""Samples in a row without one of the commands after which the drive is stopped by NMT."""
REPEATED: Final = 1
CHANGED: Final = 3
SURPLUS_LIMIT: Final = 6
"""Six equal TPDO 1, or two different ones, mean another sender."""
SURPLUS_NS: Final = 1_000_000_000
GUARD_TRIES: Final = 4
"""Life time factor: largest number of missing guarding messages (0x100D)."""
TRANSITION_NS: Final = 500_000_000
"""Longest time of one transition of the state machine."""
FAULT_RESET_NS: Final = 200_000_000
