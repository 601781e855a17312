"""Figures of the theory, one file per subject; each draws given results and computes nothing."""
