"""The page of memory shared with an emulated board; its C declaration is ``firmware/serial_dac/boards/bench.h``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

COUNT: Final = 0
"""To the board: the encoder's counter, modulo 2³²."""
CAUSES: Final = 1
"""To the board: present causes of faults, as bits of the status byte; bit 0: the enable input is closed."""
WRITTEN: Final = 2
"""From the board: number of outputs."""
OUTPUTS: Final = 4
"""First word of the ring of outputs."""
RING: Final = 128
TIME_US, CODE, ENABLED, OUTPUT_WORDS = 0, 1, 2, 4
PAGE_WORDS: Final = OUTPUTS + RING * OUTPUT_WORDS

MEMORY_BYTES: Final = 16 << 20
"""Size of the file: all of the memory of QEMU's board. It is sparse."""


def new_page(path: Path) -> NDArray[Any]:
    """Create the file and map its page, shape (PAGE_WORDS,) uint32, all zero.

    Raises:
        OSError: the file cannot be created.
    """
    with path.open("wb") as file:
        file.truncate(MEMORY_BYTES)
    return np.memmap(path, np.uint32, "r+", shape=(PAGE_WORDS,))
