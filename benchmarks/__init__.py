"""Benchmarks: each compares two things within one run and reports the ratio. ``python -m benchmarks`` runs them all."""
