"""Loaders under hostile input: valid files are mutated or forged, and each must end in a result or in a clear error.

``cases`` makes the inputs, ``loaders`` names what reads them and what it may raise, ``isolation`` runs them within bounded
time and memory. The command is ``python -m benchmarks.hostile_input``; a small part of it runs in ``tests/hostile``.
"""
