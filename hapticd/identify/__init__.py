"""Who is this device? Inertia, friction, bias, delay and the encoder's sign from recordings, with intervals."""

from hapticd.identify.result import Identified
from hapticd.identify.workflow import identified_model, identify, load_any, readable

__all__ = ["Identified", "identified_model", "identify", "load_any", "readable"]
