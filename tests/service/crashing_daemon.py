"""``hapticd run`` that kills itself at one step of a fault: ``STEP {before|after} ARGUMENTS…``."""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hapticd.cli.main import main as hapticd
from hapticd.record import Recorder
from hapticd.service import latch
from hapticd.service.fault_manager import FaultManager
from hapticd.servo import layout

SYSTEM_CALLS = ("ftruncate", "pwrite", "fsync")
STEPS = ("notice", *SYSTEM_CALLS, "rename", "log", "history")


def main(words: Sequence[str]) -> int:
    """Run the daemon; it dies at that step of its first fault."""
    step, when, *arguments = words
    crash = {"before": (kill, None), "after": (None, kill)}[when]
    if step == "notice":
        crash_in(FaultManager, "latch_raised", crash, lambda self: self._rendering.rig.state == layout.FAULT)
    elif step in SYSTEM_CALLS:
        # Those of the latch: nobody else's file is called so.
        crash_in(
            latch.os,
            step,
            crash,
            lambda descriptor, *_: "fault-" in Path(f"/proc/self/fd/{descriptor}").readlink().name,
        )
    elif step == "rename":
        crash_in(Path, "rename", crash, lambda path, _: "fault-" in path.name)
    elif step == "log":
        crash_in(logging.Logger, "error", crash, lambda self, text, *_, **__: text.startswith("fault %s"))
    else:
        crash_in(Recorder, "dump_past", crash, lambda *_: True)
    return hapticd(arguments)


def kill() -> None:
    """As the kernel does, or the user with ``kill -9``."""
    os.kill(os.getpid(), signal.SIGKILL)


def crash_in(owner: Any, name: str, crash: Any, concerns: Callable[..., bool]) -> None:
    """Have a function of the product kill the process before or after it does its work."""
    function = getattr(owner, name)
    before, after = crash

    def call(*arguments: Any, **keywords: Any) -> Any:
        found = concerns(*arguments, **keywords)
        if found and before is not None:
            before()
        result = function(*arguments, **keywords)
        if found and after is not None:
            after()
        return result

    setattr(owner, name, call)
