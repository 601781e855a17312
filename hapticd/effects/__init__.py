"""The catalogue of effects: physics of a device beyond eq. 1, one file per effect, in plain Python.

A file contains everything about its effect (`Effect`): parameters, law, what it acts on, start values of a fit, its part
in the theory, and its page of the documentation. `hapticd.effects.catalogue` collects the files here and
those of other packages by entry points; `hapticd.plant` compiles the terms and simulates the motion.
"""

from hapticd.effects.parameters import log_grid, magnitude, phase, phases, relative, shift
from hapticd.effects.spec import Complaint, Effect, LoopNumbers, Notes, Parameter, Scale, Values

__all__ = [
    "Complaint",
    "Effect",
    "LoopNumbers",
    "Notes",
    "Parameter",
    "Scale",
    "Values",
    "log_grid",
    "magnitude",
    "phase",
    "phases",
    "relative",
    "shift",
]
