"""``python -m hapticd.service.precompile``: fill the compile cache, so that the daemon's first start is quick.

Importing a module compiles its functions with a signature; functions that are compiled on demand follow.
``systemd/install.sh`` runs it as the daemon's user on the daemon's cache; cached functions are not compiled again.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator

_PACKAGES = (
    ("hapticd.plant", "the plant"),
    ("drivers", "the drivers"),
    ("hapticd.stability", "the theory"),
    ("hapticd.servo", "the servo loop"),
    ("hapticd.service", "the daemon"),
)


def _modules(package: str) -> Iterator[str]:
    yield package
    for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
        if not module.name.endswith("__main__"):
            yield module.name


def main() -> None:
    """Compile package by package, and print its name."""
    from drivers.registry import discover
    from hapticd.jit import compile_all

    for number, (package, what) in enumerate(_PACKAGES, start=1):
        print(f"compiling {number}/{len(_PACKAGES)}: {what}", flush=True)
        for name in _modules(package):
            importlib.import_module(name)
        compile_all()
    for driver in discover():
        if driver.error is not None:
            print(f"driver {driver.name} cannot be loaded: {driver.error}", flush=True)


if __name__ == "__main__":
    main()
