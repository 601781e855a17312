"""The amplifier's input: the current that a digital-to-analogue converter delivers for a commanded one.

A converter of `bits` bits over ±full scale has the step q = 2·FS/2^bits; its code is rint(i/q), from −2^(bits−1) to
2^(bits−1) − 1 (two's complement: code 0 is zero current, and the positive end is one step below full scale).
It is idempotent, so the servo loop and the plant may both quantise.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types

from hapticd.jit import njit

_f8 = types.float64
_i8 = types.int64


@njit(types.Tuple((_f8, _i8))(_f8, _f8, _i8))
def quantise_current(current: float, step: float, max_code: int) -> tuple[float, int]:
    """Quantise a current to the converter's grid.

    Args:
        current: commanded current [A]; NaN gives code 0.
        step: the converter's step q [A], > 0; 0: ideal converter, which does not change the current.
        max_code: largest positive code, 2^(bits−1) − 1; the most negative code is −max_code − 1.

    Returns:
        The delivered current [A] and its code.
    """
    if step == 0.0:
        return current, 0
    level = np.rint(current / step)
    if level > max_code:
        code = max_code
    elif level < -max_code - 1:
        code = -max_code - 1
    elif math.isnan(level):
        code = 0
    else:
        code = int(level)
    return code * step, code


def converter_grid(bits: int | None, full_scale: float | None) -> tuple[float, int]:
    """Step [A] and largest code of a converter over ±`full_scale` [A]; 0 and 0 for an ideal one, if either is missing."""
    if not bits or not full_scale:
        return 0.0, 0
    return math.ldexp(full_scale, 1 - bits), (1 << (bits - 1)) - 1
