"""The model and its loop's period; an export puts its own here."""

from __future__ import annotations

from hapticd.export.plain.numbers import Numbers

MODEL = Numbers(inertia=1.0, torque_constant=1.0)
PERIOD_S = 1e-3
