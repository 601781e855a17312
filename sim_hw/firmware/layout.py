"""The bench's own words in the simulation's state, beside those of every serial board."""

from __future__ import annotations

from sim_hw.serial_board.layout import BENCH_WORDS

BOARD = BENCH_WORDS
"""Descriptor of the line to the board; −1 while it is off."""
FRAMED = BENCH_WORDS + 1
"""1: bytes go on to the board frame by frame, because a fault may hit one; 0: as they come."""
BOARD_LENGTH = BENCH_WORDS + 2
"""Bytes of the frame coming from the board; beyond HELD_BYTES they are not counted."""
READ = BENCH_WORDS + 3
"""Outputs of the board that were taken."""
GLITCH_SHOWN = BENCH_WORDS + 4
"""1 when a SAMPLE came while an injected glitch was to be seen."""
