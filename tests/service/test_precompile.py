"""The compile cache is filled by importing, and by asking for what waits: every module that compiles must be imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
DAEMON_ROOMS = ("drivers", "hapticd/plant", "hapticd/record", "hapticd/servo", "hapticd/service", "hapticd/stability")


def compiling_modules() -> set[str]:
    found = set()
    for room in DAEMON_ROOMS:
        for path in (ROOT / room).rglob("*.py"):
            if "from hapticd.jit import" in path.read_text():
                found.add(".".join(path.relative_to(ROOT).with_suffix("").parts))
    return found


def test_every_module_that_compiles_is_imported() -> None:
    script = (
        "import sys; from hapticd.service import precompile; precompile.main(); print(*sys.modules)\n"
        "from hapticd.plant.exact import phi_functions; assert phi_functions.overloads, 'it waits to be called'"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    *progress, modules = done.stdout.splitlines()
    expected = compiling_modules()
    assert len(expected) > 30
    assert expected <= set(modules.split())
    assert [line.split(":")[0] for line in progress] == [f"compiling {number}/5" for number in range(1, 6)]


def test_install_fills_the_cache_that_the_unit_uses() -> None:
    unit = (ROOT / "systemd/hapticd.service").read_text().splitlines()
    assert "CacheDirectory=hapticd" in unit
    assert "User=hapticd" in unit
    script = (ROOT / "systemd/install.sh").read_text()
    assert "cache=/var/cache/hapticd\n" in script
    assert (
        'runuser -u hapticd -- env NUMBA_CACHE_DIR="$cache" "$prefix/bin/python" -m hapticd.service.precompile'
        in script
    )
