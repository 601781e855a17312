"""Benchmarks: each compares two things within one run and reports the ratio. ``python -m benchmarks`` runs them all."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the commands have it
