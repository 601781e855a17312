"""Blind benchmark of the gap workflow: recordings with a hidden effect, made by physics that is not hapticd's own.

``physics`` integrates the laws in small steps and shares no code with ``hapticd``; ``python -m benchmarks.gap`` draws the
cases, hides the truth, runs the workflow and the peer on what is left, and scores them afterwards.
"""
