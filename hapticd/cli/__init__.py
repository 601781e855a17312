"""The command line: one thin module a command group, every heavy import inside the command that needs it.

Linear algebra has one thread, which is decided before numpy is loaded: the matrices are small, our own threads run beside
each other already, and sums come out the same whatever the number of processors.
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
