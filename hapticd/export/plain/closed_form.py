"""What moves in closed form: a mass against constant torques and viscous friction, and a current loop."""

from __future__ import annotations

import math


def glide(speed: float, a: float, rate: float, span: float) -> tuple[float, float, float]:
    """Way, end speed and time taken of speed′ = a − rate·speed, to the first stop or the end of a time."""
    z = -rate * span
    if z > -1e-3:
        e, f, g = (
            1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0)),
            1.0 + z / 2.0 * (1.0 + z / 3.0),
            0.5 + z / 6.0 + z * z / 24.0,
        )
    else:
        e, f = math.exp(z), math.expm1(z) / z
        g = (f - 1.0) / z
    end = speed * e + a * span * f
    if end > 0.0 or a >= 0.0:
        return span * (speed * f + a * span * g), end, span
    w = -rate * speed / a
    if w < 1e-5:
        return speed * speed / (-2.0 * a), 0.0, min(speed / -a, span)
    return speed / rate * (1.0 - math.log1p(w) / w), 0.0, min(math.log1p(w) / rate, span)


def swing(off: float, rate: float, natural: float, ratio: float, span: float) -> tuple[float, float]:
    """Where z″ = −natural² z − 2 ratio natural z′ is after a time, and z′."""
    a = ratio * natural
    q2 = a * a - natural * natural
    if abs(q2) < 1e-9 * natural * natural:
        e = math.exp(-a * span)
        return e * (off + (rate + a * off) * span), e * (rate - a * (rate + a * off) * span)
    if q2 < 0.0:
        q, e = math.sqrt(-q2), math.exp(-a * span)
        c, s = e * math.cos(q * span), e * math.sin(q * span) / q
    else:
        q = math.sqrt(q2)
        slow, fast = math.exp(-natural * natural / (a + q) * span), math.exp(-(a + q) * span)
        c, s = 0.5 * (slow + fast), 0.5 * (slow - fast) / q
    return off * c + (rate + a * off) * s, rate * c - (a * rate + natural * natural * off) * s
