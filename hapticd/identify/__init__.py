"""Identification of a device: inertia, friction, bias, delay and encoder sign from recordings, with intervals."""

from hapticd.identify.result import Identified
from hapticd.identify.workflow import identified_model, identify, load_any, readable

__all__ = ["Identified", "identified_model", "identify", "load_any", "readable"]
