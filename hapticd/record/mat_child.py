"""The child that reads a MATLAB file with scipy, under limits: a damaged file ends this process and no other.

``python -I mat_child.py FILE MIB`` writes one line of JSON (names of what follows; what is left out, with its shape), then
each array as ``.npy``. It imports nothing of hapticd. What it cannot read it says on standard error, with exit code 3.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat
from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque
from scipy.sparse import issparse

_SECONDS = 60
_DEEPEST = 32
_MOST = 20_000


def limit(mib: int) -> None:
    """No more memory than so much, twice, above what is in use already; no core file, no endless computing."""
    with Path("/proc/self/statm").open() as file:
        used = int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    most = used + (2 * mib + 64 << 20)
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def flatten(name: str, value: Any, found: dict[str, np.ndarray], left_out: dict[str, str], depth: int = 0) -> None:
    """Arrays by MATLAB's own way of writing where they are: ``a.b``, ``Y(2).Data``, ``c{3}``."""
    if depth > _DEEPEST or len(found) > _MOST:
        raise ValueError("it is nested too deeply, or holds too many variables")
    shape = "x".join(map(str, np.shape(value)))
    if issparse(value):
        left_out[name] = f"a sparse array of {shape}"
    elif isinstance(value, MatlabFunction):
        left_out[name] = "a function"
    elif isinstance(value, MatlabObject | MatlabOpaque) or not isinstance(value, np.ndarray):
        left_out[name] = "an object"
    elif value.dtype.names or value.dtype == object:
        many = value.ravel(order="F")
        if not many.size:
            left_out[name] = f"an empty {'struct' if value.dtype.names else 'cell'} array"
        for number, item in enumerate(many, start=1):
            if not value.dtype.names:
                flatten(f"{name}{{{number}}}", item, found, left_out, depth + 1)
                continue
            at = f"{name}({number})" if many.size > 1 else name
            for field in value.dtype.names:
                flatten(f"{at}.{field}", item[field], found, left_out, depth + 1)
    else:
        found[name] = np.squeeze(value) if value.size else value.ravel()


def main(path: str, mib: int) -> int:
    """Read the file; 0 or 3."""
    limit(mib)
    found: dict[str, np.ndarray] = {}
    left_out: dict[str, str] = {}
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            contents = loadmat(path, struct_as_record=True, chars_as_strings=True)
        for name, value in contents.items():
            if not name.startswith("__"):
                flatten(name, value, found, left_out)
    except MemoryError:
        return 4
    except Exception as error:  # whatever scipy meets in what is no MATLAB file
        print(f"{error}"[:500], file=sys.stderr)
        return 3
    if sum(array.nbytes for array in found.values()) > mib << 20:
        return 4
    out = sys.stdout.buffer
    out.write(json.dumps({"names": list(found), "left_out": left_out}).encode() + b"\n")
    for array in found.values():
        np.lib.format.write_array(out, np.asarray(array), allow_pickle=False)
    out.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2])))
