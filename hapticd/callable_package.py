"""A package that can be called: ``hapticd.gap(run)`` asks the question, ``hapticd.gap.fit`` is still a module of it.

Python binds a subpackage to its parent's attribute when it is imported, so a function of the same name would be there or
not, depending on what was imported before. The package itself is always there.
"""

from __future__ import annotations

import importlib
import inspect
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any


def make_callable(package: str, function: str) -> None:
    """Make a package callable.

    Args:
        package: its full name; it is being imported.
        function: what is called, ``module:name``; imported at the first call.
    """
    module, name = function.split(":")

    def target() -> Callable[..., Any]:
        found: Callable[..., Any] = getattr(importlib.import_module(module), name)
        return found

    class CallablePackage(ModuleType):
        """See `make_callable`."""

        def __call__(self, *arguments: Any, **options: Any) -> Any:
            return target()(*arguments, **options)

        @property
        def __signature__(self) -> inspect.Signature:
            return inspect.signature(target())

    sys.modules[package].__class__ = CallablePackage
