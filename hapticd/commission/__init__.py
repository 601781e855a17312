"""A rig's first day: `hapticd commission` takes it step by step from the machine's doctor to its largest stiffness.

`steps.py` is the list; each step is a function of the `Rig` (`rig.py`) that returns a `Result` (`step.py`). The first steps
hold the driver themselves (`bench.py`), before anything is trusted to a daemon; the later ones ask a daemon of their own.
`run.py` decides what runs, keeps the state and says why a step does not; `certificate.py` and `page.py` are what is left.
"""
