"""The gap workflow: where simulation and measurement disagree, which missing effect explains it, and how sure that is."""

from hapticd.gap.result import GapResult
from hapticd.gap.workflow import find_gap

__all__ = ["GapResult", "find_gap"]
