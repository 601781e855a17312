"""The plant and the filter are compiled, or loaded, when they are called; what they are given is cast to their signature."""

from __future__ import annotations

import subprocess
import sys

import pytest

LOADED = """
from numba.core.caching import CompileResultCacheImpl
rebuilt, rebuild = [], CompileResultCacheImpl.rebuild
def counted(cache, *given):
    rebuilt.append(cache.filename_base)
    return rebuild(cache, *given)
CompileResultCacheImpl.rebuild = counted
import hapticd.gap
from hapticd import jit
from hapticd.plant.exact import phi_functions
{ask}
print(len(rebuilt), len(phi_functions.overloads))
"""


def loaded(ask: str) -> list[int]:
    """How many functions were loaded when it was asked, and how many versions there are of the one that was called."""
    script = LOADED.format(ask=ask)
    done = subprocess.run([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True, check=True)
    return [int(word) for word in done.stdout.split()]


def test_an_import_loads_nothing_and_a_call_what_it_needs() -> None:
    import hapticd.gap  # noqa: F401 - and now all of it is in the cache
    from hapticd.jit import compile_all

    compile_all()
    assert loaded("") == [0, 0]
    assert loaded("phi_functions(-0.5)") == [1, 1]
    assert loaded("phi_functions(-1); phi_functions(-0.5)") == [1, 1], "an integer is no other signature"
    everything, versions = loaded("jit.compile_all()")
    assert everything > 90
    assert versions == 1


def test_a_call_from_python_is_cast_to_the_signature() -> None:
    from hapticd.plant.exact import phi_functions

    assert phi_functions(-1) == phi_functions(-1.0)
    with pytest.raises(TypeError):
        phi_functions("one")


def test_the_first_call_is_not_given_what_the_signature_does_not_admit() -> None:
    script = (
        "import numpy; from hapticd.plant.numeric import edited_base\nedited_base(numpy.zeros(300, dtype=numpy.int64))"
    )
    done = subprocess.run([sys.executable, "-c", script], stderr=subprocess.PIPE, text=True, check=False)
    assert "TypeError: No matching definition for argument type(s) array(int64, 1d, C)" in done.stderr
