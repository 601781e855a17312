"""Signals and figures of recordings, for ``hapticd plot``."""

from hapticd.view._compare import Difference, difference
from hapticd.view._figure import PANELS, run_figure
from hapticd.view.signals import Signals, Spectrum, first_seconds, signals

__all__ = ["PANELS", "Difference", "Signals", "Spectrum", "difference", "first_seconds", "run_figure", "signals"]
