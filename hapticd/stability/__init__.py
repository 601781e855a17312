"""The paper's science: dimensionless numbers, criterion, regions, energy storage, outcomes, describing function.

Symbols follow "Stability of Haptic Rendering" (Diolaiti, Niemeyer, Barbagli, Salisbury); equations are cited by number.
`numbers`, `storage`, `criterion`, `regions` and `outcome` need numpy alone, so that a status reply stays fast.
"""
