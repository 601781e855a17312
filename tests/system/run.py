"""The system test: builds a guest image, boots it under qemu's software emulation, and prints what the guest's checks found.

``python tests/system/run.py`` needs root (debootstrap, chroot) and network for the first image; later runs take it from
the cache. The guest itself has no network. docs/how-to/system-test.md
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import guest_disk

CACHE = Path(os.environ.get("HAPTICD_SYSTEM_TEST_CACHE", "/var/cache/hapticd-system-test"))
LIMIT_MIN = 28.0
PROGRAMS = {"qemu-system-x86_64": "qemu-system-x86", "debootstrap": "debootstrap", "mke2fs": "e2fsprogs"}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--keep", type=Path, help="folder that takes disk, console and results")
    parser.add_argument("--only", action="append", default=[], help="only this check, by name; repeatable")
    parser.add_argument("--limit", type=float, default=LIMIT_MIN, help="minutes for the guest (default: %(default)g)")
    parser.add_argument(
        "--if-possible", action="store_true", help="say so and end well where root or a program is missing"
    )
    options = parser.parse_args()
    if (missing := lacking()) is not None:
        print(f"system test: not run: {missing}")
        return 0 if options.if_possible else 2
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that what follows is cleaned up
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hapticd-system-") as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        disk = guest_disk.build(CACHE, folder, options.only)
        print(f"system test: disk ready after {time.monotonic() - begin:.0f} s", flush=True)
        results = boot(folder, disk, 60.0 * options.limit)
        failed = report(results, folder / "console.log")
    print(f"system test: {time.monotonic() - begin:.0f} s in all")
    return int(failed)


def lacking() -> str | None:
    """What this machine lacks, in words; None when it can run the test."""
    if os.geteuid() != 0:
        return "it needs root for debootstrap and chroot"
    for program, package in PROGRAMS.items():
        if shutil.which(program) is None:
            return f"it needs {program} (apt-get install {package})"
    return None


def boot(folder: Path, disk: guest_disk.Disk, limit_s: float) -> list[dict[str, object]]:
    """Boot the guest, show its checks as they end, and return them.

    Its clock counts instructions, 1 ns each, and jumps over idle time: a busy host makes the guest slower in our time and
    not in its own. A disk that answers in our time would not fit to that; an NVDIMM is memory and answers at once.
    """
    results = folder / "results.jsonl"
    results.write_text("")
    command = [
        "qemu-system-x86_64", "-machine", "q35,nvdimm=on", "-cpu", "max", "-smp", "1", "-m", "3G,slots=2,maxmem=16G",
        "-accel", "tcg", "-icount", "shift=0,sleep=off", "-rtc", "clock=vm",
        "-nodefaults", "-display", "none", "-no-reboot", "-nic", "none",
        "-kernel", str(disk.kernel), "-initrd", str(disk.initrd),
        "-append", "root=/dev/pmem0 rw console=ttyS0 systemd.show_status=0 quiet mitigations=off",
        "-object", f"memory-backend-file,id=disk,share=on,mem-path={disk.image},size={disk.image.stat().st_size}",
        "-device", "nvdimm,memdev=disk",
        "-serial", f"file:{folder / 'console.log'}",
        "-serial", f"file:{results}",
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as guest:
        deadline = time.monotonic() + limit_s
        shown = 0
        try:
            while guest.poll() is None and time.monotonic() < deadline:
                time.sleep(1.0)
                shown = show(results, shown)
            if guest.poll() is None:
                print(f"system test: the guest is ended after {limit_s / 60:g} minutes", flush=True)
        finally:
            guest.kill()
    show(results, shown)
    return read(results)


def read(results: Path) -> list[dict[str, object]]:
    lines = results.read_text(errors="replace").splitlines()
    return [json.loads(line) for line in lines if line.startswith("{") and line.endswith("}")]


def show(results: Path, shown: int) -> int:
    found = read(results)
    for one in found[shown:]:
        if one["name"] != "end":
            print(f"  {one['name']}: {'ok' if one['ok'] else 'FAILED'}", flush=True)
    return len(found)


def report(results: list[dict[str, object]], console: Path) -> bool:
    """Print the table; True when something failed or the guest did not get to the end."""
    checks = [one for one in results if one["name"] != "end"]
    width = max((len(str(one["name"])) for one in checks), default=5)
    print(f"\n{'check':{width}}  {'':6}  {'guest s':>7}  found")
    for one in checks:
        print(f"{one['name']:{width}}  {'ok' if one['ok'] else 'FAILED':6}  {one['seconds']:>7}  {one['detail']}")
    ended = len(checks) < len(results)
    failed = sum(not one["ok"] for one in checks)
    if not ended:
        print("\nthe guest did not get to the end; its console's last lines:")
        print("\n".join(console.read_text(errors="replace").splitlines()[-40:]))
    print(
        f"\nsystem test: {len(checks) - failed} checks passed, {failed} failed{'' if ended else ', and the rest not run'}"
    )
    return not (ended and checks) or failed > 0


if __name__ == "__main__":
    sys.exit(main())
