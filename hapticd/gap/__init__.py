"""The gap workflow: where simulation and measurement disagree, which missing effect explains it, and with what evidence.

    Recording → Series → base fit → propose → choose → judge → report

    stage      modules                                 types
    Recording  data, checks                            Run, Config → Recording
    Series     series; base_model.problem_of           Sequence[Recording] → Series, in a Problem
    base fit   balance, base_model, nominal            Problem → Fit → LawSet
    propose    candidates, propose                     LawSet → list[Candidate] → list[LawSet], with a law more each
    choose     choose, free_base, sets, law_set        LawSet → Iterator[Round]; the last one's set → list[Named]
    judge      answer, missing, remainder, verdict     LawSet, list[Named] → GapResult
    report     report, figures, model_file, outputs    GapResult → report.html, model.yaml, gap.json

`workflow.find_gap` runs them from Series to judge. Each `Fit` is a maximum of the likelihood that `kernel` computes.
"""

from hapticd.gap.result import GapResult
from hapticd.gap.workflow import find_gap

__all__ = ["GapResult", "find_gap"]
