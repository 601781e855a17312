"""The catalogue of effects: physics that a device may have beyond eq. 1, one file an effect, in plain Python.

A file says all that is particular to its effect (`Effect`): parameters, law, what it acts on, where a fit may start, what
it does to the theory, its words and its page of the documentation. `hapticd.effects.catalogue` collects the files here and
those that others bring by entry points; `hapticd.plant` compiles the terms and puts them together into motion.
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
