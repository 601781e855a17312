"""Stability theory of the paper: dimensionless numbers, criterion, regions, energy storage, outcomes, describing function.

Symbols follow "Stability of Haptic Rendering" (Diolaiti, Niemeyer, Barbagli, Salisbury); equations are cited by number.
`numbers`, `storage`, `criterion`, `regions` and `outcome` import numpy only, so that a status reply is fast.
"""
