"""``python -m tests.old_processor [PYTEST ARGUMENT…]``: the gap's tests as they compute on an old x86-64.

Another processor rounds and sums otherwise in the last bit, and a search that stands between two ways takes the other one.
All that computes chooses its instructions by the processor: Numba's compiler, OpenBLAS, numpy's loops, the C library's
functions. Here each of them does without wide vectors and fused products. Numba keeps code for either set side by side.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
ENVIRONMENT = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_ENABLE_CPU_FEATURES": "X86_V2",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F",
}
TESTS = ("tests/gap", "-m", "not realtime", "-n", "3", "--dist", "worksteal")
# A variable that one of them has stopped reading would make this the same run once more.
OBEYED = """
import scipy.linalg, threadpoolctl
from numba.core.registry import cpu_target
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__
blas = {each["architecture"] for each in threadpoolctl.threadpool_info() if each["internal_api"] == "openblas"}
wide = [each for each in __cpu_dispatch__ if __cpu_features__[each]]
numba = cpu_target.target_context.codegen().magic_tuple()[1:]
assert blas <= {"Prescott", "Katmai", "Generic"} and not wide and numba == ("generic", ""), (blas, wide, numba)
"""
COMPILED = "import hapticd.gap, hapticd.jit; hapticd.jit.compile_all()"


def main() -> int:
    """Run it; pytest's exit code."""
    environment = os.environ | ENVIRONMENT
    for program in (OBEYED, COMPILED):
        subprocess.run([sys.executable, "-c", program], cwd=ROOT, env=environment, check=True)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(sys.argv[1:] or TESTS)]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
