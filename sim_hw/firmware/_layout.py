"""The test bench's words in the simulation's state, after those of every serial board."""

from __future__ import annotations

from sim_hw.serial_board.layout import BENCH_WORDS

BOARD = BENCH_WORDS
"""Descriptor of the line to the board; −1 while it is off."""
FRAMED = BENCH_WORDS + 1
"""1: bytes are forwarded to the board frame by frame, for frame faults; 0: as received."""
BOARD_LENGTH = BENCH_WORDS + 2
"""Bytes of the frame coming from the board; beyond HELD_BYTES they are not counted."""
READ = BENCH_WORDS + 3
"""Number of processed outputs of the board."""
GLITCH_SHOWN = BENCH_WORDS + 4
"""1 if a SAMPLE came during an injected glitch."""
