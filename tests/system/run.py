"""The system test: builds a guest image, boots it under qemu's software emulation, and prints what the guest's checks found.

``python tests/system/run.py`` needs root (debootstrap, chroot) and network for the first image; later runs take it from
the cache. The guest itself has no network. ``--keep`` leaves disk, console and results in a folder.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
CACHE = Path(os.environ.get("HAPTICD_SYSTEM_TEST_CACHE", "/var/cache/hapticd-system-test"))
LIMIT_S = 28 * 60.0
SERVICE = "hapticd-system-test.service"


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--keep", type=Path, help="folder that takes disk, console and results")
    arguments.add_argument("--only", action="append", default=[], help="only this check, by name; repeatable")
    options = arguments.parse_args()
    if (missing := lacking()) is not None:
        print(f"system test: not run: {missing}")
        return 0
    begin = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="hapticd-system-") as scratch:
        folder = options.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        disk, kernel, initrd = build_disk(folder, options.only)
        print(f"system test: image ready after {time.monotonic() - begin:.0f} s", flush=True)
        results = boot(folder, disk, kernel, initrd)
        failed = report(results, folder / "console.log")
    print(f"system test: {time.monotonic() - begin:.0f} s in all")
    return int(failed)


def lacking() -> str | None:
    """What this machine lacks, in words; None when it can run the test."""
    if os.geteuid() != 0:
        return "it needs root for debootstrap and chroot"
    for program, package in (
        ("qemu-system-x86_64", "qemu-system-x86"),
        ("debootstrap", "debootstrap"),
        ("mke2fs", "e2fsprogs"),
    ):
        if shutil.which(program) is None:
            return f"it needs {program} (apt-get install {package})"
    return None


def build_disk(folder: Path, only: list[str]) -> tuple[Path, Path, Path]:
    """The guest's disk with this source tree and its wheel, and the kernel to boot it with."""
    print("system test: root file system …", flush=True)
    made = subprocess.run([ROOT / "tests/system/image.sh", CACHE], stdout=subprocess.PIPE, text=True, check=True)
    base = Path(made.stdout.strip())
    kernel = max((base / "boot").glob("vmlinuz-*"))
    initrd = max((base / "boot").glob("initrd.img-*"))
    root = folder / "root"
    shutil.rmtree(root, ignore_errors=True)
    subprocess.run(["cp", "-a", "--reflink=auto", base, root], check=True)
    source = root / "root" / "hapticd"
    source.mkdir(parents=True)
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE, check=True)
    subprocess.run(["tar", "-x", "-C", source], input=archive.stdout, check=True)
    subprocess.run(
        [ROOT / ".venv/bin/python", "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", source / "dist", source],
        check=True,
    )
    (source / "tests/system/guest/only.json").write_text(json.dumps(only))
    units = root / "etc/systemd/system"
    shutil.copy(ROOT / "tests/system/guest" / SERVICE, units)
    (units / "multi-user.target.wants").mkdir(exist_ok=True)
    (units / "multi-user.target.wants" / SERVICE).symlink_to(f"/etc/systemd/system/{SERVICE}")
    disk = folder / "disk.img"
    disk.unlink(missing_ok=True)
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", root, disk, "6G"], check=True)
    shutil.rmtree(root)
    return disk, kernel, initrd


def boot(folder: Path, disk: Path, kernel: Path, initrd: Path) -> list[dict[str, object]]:
    """Boot the guest, show its checks as they end, and return them."""
    results = folder / "results.jsonl"
    results.write_text("")
    command = [
        "qemu-system-x86_64", "-machine", "q35", "-cpu", "max", "-smp", str(min(2, os.cpu_count() or 1)), "-m", "3072",
        "-accel", "tcg,thread=multi", "-nodefaults", "-display", "none", "-no-reboot", "-nic", "none",
        "-kernel", str(kernel), "-initrd", str(initrd),
        "-append", "root=/dev/vda rw console=ttyS0 systemd.show_status=0 quiet mitigations=off",
        "-drive", f"file={disk},format=raw,if=virtio,cache=unsafe",
        "-serial", f"file:{folder / 'console.log'}",
        "-serial", f"file:{results}",
    ]  # fmt: skip
    with subprocess.Popen(command) as guest:
        deadline = time.monotonic() + LIMIT_S
        shown = 0
        try:
            while guest.poll() is None and time.monotonic() < deadline:
                time.sleep(1.0)
                shown = show(results, shown)
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
        print(f"  {one['name']}: {'ok' if one['ok'] else 'FAILED'} ({one['seconds']} s)", flush=True)
    return len(found)


def report(results: list[dict[str, object]], console: Path) -> bool:
    """Print the table; True when something failed or the guest did not get to the end."""
    width = max((len(str(one["name"])) for one in results), default=4)
    print(f"\n{'check':{width}}  {'':6}  {'s':>6}  found")
    for one in results:
        print(f"{one['name']:{width}}  {'ok' if one['ok'] else 'FAILED':6}  {one['seconds']:>6}  {one['detail']}")
    ended = any(one["name"] == "end" for one in results)
    if not ended:
        print(f"\nthe guest did not get to the end; its console's last lines ({console}):")
        print("\n".join(console.read_text(errors="replace").splitlines()[-30:]))
    return not ended or not all(one["ok"] for one in results)


if __name__ == "__main__":
    sys.exit(main())
