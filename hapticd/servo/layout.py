"""The servo loop's memory as records: one `SERVO`, passed by reference through everything that a tick calls.

A field's comment gives its meaning and unit. `PARAMS` come through the mailbox, `STATE` is the loop's memory, `TICK` is
for the present tick, `SNAPSHOT` is for display. Words shared by two threads are in `hapticd.servo.atomics`.
"""

from __future__ import annotations

import numpy as np

from drivers.interface import EXCHANGE
from hapticd.servo.timing import BUCKETS

# Modes of the loop, shown to users as its state.
OFF = 0
READY = 1
RUNNING = 2
FAULT = 3
STATE_NAMES = ("off", "ready", "running", "fault")

DITHER_NONE, DITHER_POSITION, DITHER_CURRENT = 0, 1, 2
DITHER_TARGETS = {"none": DITHER_NONE, "position": DITHER_POSITION, "current": DITHER_CURRENT}
SINE, TRIANGLE, SQUARE, UNIFORM = 0, 1, 2, 3
DITHER_WAVEFORMS = {"sine": SINE, "triangle": TRIANGLE, "square": SQUARE, "uniform": UNIFORM}
BOTH_SIDES, POSITIVE_SIDE, NEGATIVE_SIDE = 0, 1, -1
SIDES = {"both": BOTH_SIDES, "positive": POSITIVE_SIDE, "negative": NEGATIVE_SIDE}
SKIP, HOLD, FAULT_ON_OVERRUN = 0, 1, 2
OVERRUN_POLICIES = {"skip": SKIP, "hold": HOLD, "fault": FAULT_ON_OVERRUN}

PASSIVITY_OFF, PASSIVITY_OBSERVE, PASSIVITY_CONTROL = 0, 1, 2
PASSIVITY_MODES = {"off": PASSIVITY_OFF, "observe": PASSIVITY_OBSERVE, "control": PASSIVITY_CONTROL}

PARAMS = np.dtype(
    [
        ("period_ns", "f8"),  # ns
        ("request", "i8"),  # mode requested by the supervisor: OFF, READY or RUNNING
        ("ordinal", "i8"),  # of the command that requests it; OFF once it is revoked (`hapticd.servo.authority`)
        ("clear", "i8"),  # ordinal of the newest clear: it clears faults raised before it was sent
        ("force_per_tick", "f8"),  # K Δ, N m or N
        ("bias", "f8"),  # ½ or 0, ticks
        ("damping", "f8"),  # B per count, N m or N for one count/s
        ("velocity_periods", "i8"),  # over which positions are differenced
        ("velocity_keep", "f8"),  # decay of the velocity estimate per period; 0 for the plain difference
        ("passivity", "i8"),  # PASSIVITY_OFF, PASSIVITY_OBSERVE, PASSIVITY_CONTROL
        (
            "passivity_stiffest",
            "f8",
        ),  # α T: largest damping force of its controller per displacement in a period, N m/rad or N/m
        ("side", "i8"),  # on which the spring acts: BOTH_SIDES, POSITIVE_SIDE, NEGATIVE_SIDE
        ("origin", "i8"),  # of the spring, counts
        ("decimation", "i8"),  # counts per coarse tick
        ("invert", "?"),  # the encoder counts backwards
        ("torque_constant", "f8"),  # N m/A or N/A
        ("raw_resolution", "f8"),  # rad or m per count
        ("dither_target", "i8"),  # DITHER_NONE, DITHER_POSITION, DITHER_CURRENT
        ("dither_waveform", "i8"),  # SINE, TRIANGLE, SQUARE, UNIFORM
        ("dither_amplitude", "f8"),  # peak; ticks or A
        ("dither_frequency", "f8"),  # Hz
        ("dither_seed", "i8"),
        ("delay_ns", "f8"),  # T_V, ns
        ("dac_step", "f8"),  # A; 0 for an ideal converter
        ("dac_max_code", "i8"),  # largest positive code
        ("peak_current", "f8"),  # A, on the converter's grid; infinite for none
        ("continuous_current", "f8"),  # A; infinite for none
        ("i2t_limit", "f8"),  # A² s above the continuous current
        ("safety", "?"),  # False: no trips (simulate)
        ("max_speed", "f8"),  # counts/s; infinite for none, as all limits
        ("max_excursion", "f8"),  # counts from the origin
        ("encoder_jump", "f8"),  # counts per period
        ("missed_exchanges", "f8"),  # in a row
        ("soft_step", "f8"),  # step of a soft start or change per period, as a fraction of it; 0 for none
        ("fault", "i8"),  # fault to raise, if it renders; 0 for none
        ("fault_value", "f8"),
        ("fault_limit", "f8"),
        ("abrupt", "?"),  # running begins without a soft start: a release, an excitation
        ("mismatch", "f8"),  # limit of the difference of measured and commanded current, A; infinite for none
        ("mismatch_ticks", "i8"),  # samples in a row for which it may last
        ("mismatch_block", "i8"),  # length of a block of commands, periods; a sample may belong to the last two
        ("current_limit", "f8"),  # largest current of the amplifier, A; infinite for none
        ("follow_ii", "f8"),  # transition of the amplifier's model over a period: of its difference from the command
        ("follow_ir", "f8"),  # by the difference, and by its rate over ω_A
        ("follow_ri", "f8"),  # and of the rate over ω_A by the difference
        ("follow_rr", "f8"),  # and by the rate
        ("overrun_policy", "i8"),  # SKIP, HOLD, FAULT_ON_OVERRUN
        ("overrun_fault_after", "f8"),  # limit of missed periods minus punctual ticks
        ("enable", "?"),  # a person must hold the device's enable input
        ("heartbeat_ns", "f8"),  # longest time without a heartbeat of the supervisor, ns; 0 for no limit
        ("enable_timeout_ns", "f8"),  # ns
        ("excitation_id", "i8"),  # a new one, not 0, starts the table in the excitation buffer
        ("excitation_length", "i8"),  # ticks
    ],
    align=True,
)
"""Parameters, applied whole between two ticks."""

LAW = np.dtype(
    [
        ("force_per_tick", "f8"),  # as in PARAMS, like the others
        ("bias", "f8"),
        ("damping", "f8"),
        ("side", "i8"),
        ("origin", "i8"),
        ("decimation", "i8"),
    ],
    align=True,
)
"""The parameters of the rendered spring; a change of them while it is rendered is a soft change."""

NO_RAMP = -1.0
"""`STATE.held_share` where no spring fades."""

DISABLED, ENABLED_AT_ZERO, ENABLED_WITH_CURRENT = 0, 1, 2

STATE = np.dtype(
    [
        ("mode", "i8"),  # OFF, READY, RUNNING, FAULT
        ("amplifier", "i8"),  # as last commanded: DISABLED, ENABLED_AT_ZERO, ENABLED_WITH_CURRENT
        ("next_tick", "i8"),
        ("replayed_skip", "i8"),  # in virtual time: periods to skip before the next tick, as a recorded loop did
        ("replayed_late_ns", "i8"),  # and its lateness
        ("grid_tick", "i8"),  # first tick of the present time grid
        ("grid_ns", "i8"),  # and its instant, ns
        ("grid_frac", "f8"),  # and the fraction of a ns
        ("sync_ns", "i8"),  # time of the device's last SYNC, ns; 0: never
        ("synced", "?"),  # whether the grid follows the device's clock
        ("start_ns", "i8"),  # origin of time_s, ns
        ("applied", "i8"),  # number of the parameter set in force
        ("cleared", "i8"),  # last PARAMS.clear that was processed
        ("estops", "i8"),  # executed software stops
        ("enable_ns", "i8"),  # time at which the amplifier was commanded to switch on, ns
        ("have_counts", "?"),  # whether there is a sample since running began
        ("counts", "i8"),  # of the last good sample
        ("counts_ns", "i8"),  # and when it came, ns
        ("speed", "f8"),  # counts/s
        ("velocity", "f8"),  # of the coarse position, as the damping estimates it, counts/s
        ("velocity_tick", "i8"),  # tick of that estimate
        ("velocity_period_ns", "f8"),  # servo period since its history began, ns
        ("velocity_samples", "i8"),  # put into its history
        ("observes", "?"),  # whether the passivity observer has the state at the start of the present period
        ("observed_tick", "i8"),  # the tick before it
        ("observed_counts", "i8"),  # the counts there
        ("observed_potential", "f8"),  # and the spring's potential, J,
        ("observed_set", "i8"),  # by this parameter set
        ("moved", "f8"),  # in that period, rad or m
        ("put_out", "f8"),  # work of the current sent, J
        ("generated", "f8"),  # the part of it that the spring had not stored, J
        ("excess", "f8"),  # the part of that still to be dissipated, J
        ("dissipated", "f8"),  # by the controller, J
        ("passivity_current", "f8"),  # that the controller added, A
        ("missed_in_a_row", "i8"),  # exchanges
        ("late_periods", "i8"),  # missed, minus punctual ticks since then; at least 0
        ("i2t", "f8"),  # A² s above the continuous current
        ("force", "f8"),  # of the last rendered tick, N m or N
        ("requested", "f8"),  # current of the last rendered tick, before T_V and the converter, A
        ("current", "f8"),  # last one written, A
        ("seed", "i8"),  # of the random numbers
        ("random", "i8"),  # state of the random numbers
        ("dither_phase", "f8"),  # turns
        ("excitation_id", "i8"),  # of the table that is played
        ("excitation_start", "i8"),  # tick
        ("delayed_head", "i8"),  # commands put into T_V
        ("delayed_tail", "i8"),  # commands taken out
        ("held_share", "f8"),  # of the previous spring in the force, from 1 to 0; NO_RAMP: no soft change
        ("held_offset", "f8"),  # last rendered force minus that of the previous spring, N m or N
        ("softened", "f8"),  # rendered force minus that of the present spring, N m or N
        ("followed", "f8"),  # current of the amplifier's model, A
        ("follow_rate", "f8"),  # and its rate over ω_A, A
        ("current_low", "f8"),  # smallest possible current in this block of periods, A
        ("current_high", "f8"),  # largest possible current in it, A
        ("block_low", "f8"),  # the same in the previous block
        ("block_high", "f8"),
        ("block_ticks", "i8"),  # of this block so far
        ("mismatched", "i8"),  # samples in a row outside that range
        ("dropped", "i8"),  # dropped rows when the last row was recorded
    ],
    align=True,
)
"""State of the loop from tick to tick."""

TICK = np.dtype(
    [
        ("number", "i8"),
        ("ns", "i8"),  # grid instant, ns
        ("frac", "f8"),  # and the fraction of a ns
        ("woke_ns", "i8"),  # start of the tick; in virtual time the grid instant, or that of a replayed tick
        ("late_ns", "i8"),  # after the grid instant
        ("missed", "i8"),  # periods that were skipped before it
        ("fresh", "?"),  # whether there is a new sample of the device
        ("relative", "i8"),  # counts from the origin
        ("position", "i8"),  # coarse ticks from the origin
        ("force", "f8"),  # rendered, N m or N
        ("written", "i8"),  # the driver's return code for the last write
        ("waited_ns", "i8"),  # sleep until delayed commands (T_V)
        ("flags", "i8"),  # FLAG_* bits of its row
    ],
    align=True,
)
"""Values of the present tick."""

SNAPSHOT = np.dtype(
    [
        ("position", "f8"),  # coarse ticks from the origin, with fraction
        ("velocity", "f8"),  # rad/s or m/s
        ("current", "f8"),  # commanded, A
        ("current_measured", "f8"),  # A; NaN if the device has none
        ("force", "f8"),  # N m or N
        ("put_out", "f8"),  # passivity observer, J: work of the current sent,
        ("generated", "f8"),  # the part of it that the spring had not stored,
        ("excess", "f8"),  # the part of that still to be dissipated,
        ("dissipated", "f8"),  # by the passivity controller
        ("passivity_current", "f8"),  # that it adds, A
    ],
    align=True,
)
"""For status, display only."""

DRIVER = np.dtype(
    [
        ("read", "i8"),  # address of the function
        ("write", "i8"),  # address of the function
        ("wait", "i8"),  # address of the function that sleeps until the device's SYNC; 0: the loop has its own clock
        ("state", "i8"),  # address that is passed to all of them
        ("exchange", "i8"),  # address of SERVO.exchange
    ],
    align=True,
)
"""The device behind two C functions."""

COMMAND = np.dtype(
    [
        ("due_ns", "i8"),  # ns
        ("due_frac", "f8"),  # and the fraction of a ns
        ("current", "f8"),  # A
    ],
    align=True,
)
"""A command that waits inside T_V."""

MOST_DELAYED = 32768
"""Largest number of commands delayed by T_V; a power of two: at least one second at 20 kHz."""

SAMPLE = np.dtype([("counts", "i8"), ("tick", "i8")], align=True)
"""A position in the history of the damping: counts, and the tick in which they were read."""

MOST_SAMPLES = 1024
"""Length of that history; a power of two above `MOST_VELOCITY_PERIODS`."""

SERVO = np.dtype(
    [
        ("real_time", "?"),  # the monotonic clock, or virtual time
        ("params", PARAMS),  # in force
        ("law", LAW),  # the spring in force
        ("held_law", LAW),  # and the one before it
        ("state", STATE),
        ("tick", TICK),
        ("snapshot", SNAPSHOT),
        ("exchange", EXCHANGE),
        ("driver", DRIVER),
        ("timespec", ("i8", 2)),  # scratch of the clock
        ("mailbox", (PARAMS, 3)),  # two sets, written alternately, and the loop's copy of one of them
        ("late_histogram", ("i8", BUCKETS)),  # ns, see `hapticd.servo.timing`
        ("exec_histogram", ("i8", BUCKETS)),  # ns
        ("delayed", (COMMAND, MOST_DELAYED)),
        ("samples", (SAMPLE, MOST_SAMPLES)),
    ],
    align=True,
)
"""One servo loop."""

# Reasons to return.
RETURN_STOPPED = 0
RETURN_TICKS = 1
RETURN_RUNAWAY = 2
