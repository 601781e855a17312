"""The gap workflow: where simulation and measurement disagree, which missing effect explains it, and how sure that is."""

from hapticd.callable_package import make_callable
from hapticd.gap.result import GapResult
from hapticd.gap.workflow import find_gap

__all__ = ["GapResult", "find_gap"]

make_callable(__name__, "hapticd.gap.call:gap")
