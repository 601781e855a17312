"""Word numbers of everything the servo loop shares: parameters, control words, snapshot and private work area.

The loop is compiled, so it shares plain arrays with Python instead of objects. ``P_`` words travel through the mailbox
(float64); ``C_`` words are atomic int64 control words, each written by one side only (named in its comment); ``S_`` words
are the snapshot for people; ``W_``/``V_`` words are the loop's own memory (int64 / float64).
"""

from __future__ import annotations

# States (also the values of P_REQUEST, fault excepted).
OFF = 0
READY = 1
RUNNING = 2
FAULT = 3
STATE_NAMES = ("off", "ready", "running", "fault")

# Parameters, applied whole between two ticks.
P_PERIOD_NS = 0
P_REQUEST = 1
P_CLEAR = 2  # a fault is cleared when this number changes
P_FORCE_PER_TICK = 3  # K Δ
P_BIAS = 4  # 0.5 or 0
P_SIDE = 5  # 0 both, 1 positive, -1 negative
P_ORIGIN = 6  # raw counts
P_DECIMATION = 7
P_INVERT = 8
P_TORQUE_CONSTANT = 9
P_DITHER_TARGET = 10
P_DITHER_WAVEFORM = 11
P_DITHER_AMPLITUDE = 12
P_DITHER_FREQUENCY = 13
P_DITHER_SEED = 14
P_DELAY_NS = 15
P_PEAK_CURRENT = 16  # A, on the DAC's grid
P_CONTINUOUS_CURRENT = 17
P_I2T_LIMIT = 18  # A² s above the continuous current
P_DAC_BITS = 19
P_DAC_FULL_SCALE = 20
P_SAFETY = 21  # 0: no trips (simulate)
P_MAX_SPEED = 22  # counts/s
P_MAX_EXCURSION = 23  # counts from the origin
P_ENCODER_JUMP = 24  # counts per period
P_MISSED_EXCHANGES = 25
P_OVERRUN_POLICY = 26
P_OVERRUN_FAULT_AFTER = 27
P_HEARTBEAT_NS = 28
P_ENABLE_TIMEOUT_NS = 29
P_EXCITATION_ID = 30  # a new non-zero number starts the table in the excitation buffer
P_EXCITATION_LENGTH = 31
P_RAW_RESOLUTION = 32
P_DAC_STEP = 33  # A; a command further than this from what was asked is saturated
PARAMETERS = 40

DITHER_NONE, DITHER_POSITION, DITHER_CURRENT = 0, 1, 2
DITHER_TARGETS = {"none": DITHER_NONE, "position": DITHER_POSITION, "current": DITHER_CURRENT}
SINE, TRIANGLE, SQUARE, UNIFORM = 0, 1, 2, 3
DITHER_WAVEFORMS = {"sine": SINE, "triangle": TRIANGLE, "square": SQUARE, "uniform": UNIFORM}
SKIP, HOLD, FAULT_ON_OVERRUN = 0, 1, 2
OVERRUN_POLICIES = {"skip": SKIP, "hold": HOLD, "fault": FAULT_ON_OVERRUN}

# Control words. Eight words (one cache line) between words of different writers.
C_SEQUENCE = 0  # supervisor: number of the newest parameter set
C_HEARTBEAT_NS = 8  # supervisor: CLOCK_MONOTONIC, ns
C_STOP = 9  # supervisor: leave the loop, by way of zero current
C_ESTOP = 10  # supervisor: number of software stops asked for
C_RING_TAIL = 16  # recorder: rows taken
C_RING_HEAD = 24  # loop from here on: rows written
C_DROPPED = 25
C_STATE = 26
C_APPLIED = 27  # sequence number of the parameter set in force
C_FAULT_CODE = 28
C_FAULT_TICK = 29
C_TICKS = 30
C_MISSED = 31  # missed periods
C_EXCHANGES_MISSED = 32
C_CLAMPED = 33
C_EXCITATION_DONE = 34  # id of the last excitation that ran to its end
C_LATE_MAX_NS = 36
C_EXEC_MAX_NS = 37
C_COUNTS = 39
CONTROL_WORDS = 48

# Snapshot for status, display only.
S_POSITION = 0  # coarse ticks from the origin, with fraction
S_VELOCITY = 1  # rad/s or m/s
S_CURRENT = 2  # A, commanded
S_CURRENT_MEASURED = 3
S_FORCE = 4  # N m or N
S_FAULT_VALUE = 5
S_FAULT_LIMIT = 6
S_I2T = 7  # A² s in excess of the continuous current
SNAPSHOT_WORDS = 16

# The loop's own memory, int64 …
W_TICK = 1
W_GRID_TICK = 2  # tick at which the present time grid starts
W_GRID_NS = 3
W_COUNTS = 4
W_HAVE_COUNTS = 5
W_COUNTS_NS = 6
W_MISSED_IN_A_ROW = 7
W_OVERRUNS_IN_A_ROW = 8
W_RANDOM = 9
W_SEED = 10
W_FIFO_HEAD = 11
W_FIFO_TAIL = 12
W_ENABLED = 13  # one of the three words below
W_STATE = 14
W_CLEAR = 15
W_ESTOP = 16
W_EXCITATION_ID = 17
W_EXCITATION_START = 18
W_REQUEST_NS = 19  # when the enable request began
W_START_NS = 20  # origin of time_s
W_APPLIED = 21
WORK_INTS = 32

DISABLED, ENABLED_AT_ZERO, ENABLED_WITH_CURRENT = 0, 1, 2

# … and float64.
V_GRID_FRAC = 0
V_DITHER_PHASE = 1  # turns
V_I2T = 2
V_CURRENT = 3  # last current written, A
V_REQUESTED = 4  # current of the last rendered tick, before T_V and the DAC, A
V_FORCE = 5  # force of the last rendered tick
V_SPEED = 6  # counts/s
WORK_FLOATS = 16

FIFO_LENGTH = 32768
"""Commands that can wait inside T_V; a power of two. One second at 20 kHz fits."""

# Reasons to return.
RETURN_STOPPED = 0
RETURN_TICKS = 1
RETURN_RUNAWAY = 2
