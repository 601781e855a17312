"""The guest's disk: Debian, this source tree and its wheel, and what the guest would take too long to compile itself."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
GUEST = ROOT / "tests/system/guest"
SERVICE = "system-test.service"
SIZE = "5G"
COMPILED_FOR = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "NUMBA_CACHE_DIR": "/var/cache/hapticd"}
"""Host and guest are different CPUs to Numba, which keeps compiled code apart by CPU: both shall say the same."""
STEP_S = 900.0
"""No step of the preparation takes longer; the first image is another matter."""


@dataclass(frozen=True)
class Disk:
    """What qemu boots."""

    image: Path
    kernel: Path
    initrd: Path


def build(cache: Path, folder: Path, only: list[str]) -> Disk:
    """The disk as ``folder/disk.img``, with a root file system from the cache.

    Raises:
        subprocess.CalledProcessError: debootstrap, pip or mke2fs failed.
    """
    print("system test: root file system …", flush=True)
    made = subprocess.run([GUEST.parent / "image.sh", cache], stdout=subprocess.PIPE, text=True, check=True)
    base = Path(made.stdout.strip())
    root = folder / "root"
    shutil.rmtree(root, ignore_errors=True)
    try:
        _run("cp", "-a", "--reflink=auto", base, root)
        _put_source(root, only)
        print("system test: compile cache …", flush=True)
        _put_compiled(root, cache / "compiled")
        _put_settings(root)
        image = folder / "disk.img"
        image.unlink(missing_ok=True)
        _run("mke2fs", "-q", "-t", "ext4", "-d", root, image, SIZE)
    finally:
        shutil.rmtree(root, ignore_errors=True)
    return Disk(image, max((base / "boot").glob("vmlinuz-*")), max((base / "boot").glob("initrd.img-*")))


def _run(*command: str | Path, **options: object) -> None:
    subprocess.run(command, check=True, timeout=STEP_S, stdin=subprocess.DEVNULL, **options)  # type: ignore[call-overload]


def _put_source(root: Path, only: list[str]) -> None:
    """The source as a newcomer has it, in ``lab``'s home, and the wheel in ``dist``."""
    source = root / "home/lab/hapticd"
    source.mkdir()
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, stdout=subprocess.PIPE, check=True, timeout=STEP_S)
    subprocess.run(["tar", "-x", "-C", source], input=archive.stdout, check=True, timeout=STEP_S)
    python = ROOT / ".venv/bin/python"
    _run(python, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", source / "dist", source)
    shutil.rmtree(source / "build", ignore_errors=True)
    (source / "tests/system/guest/only.json").write_text(json.dumps(only))
    _run("chroot", root, "chown", "-R", "lab:lab", "/home/lab")


def _put_compiled(root: Path, kept: Path) -> None:
    """Fill the compile cache at this machine's speed, in the guest's own Python; then hapticd is taken away again.

    The cache is keyed by the digest of the sources, so one that is kept from an earlier run serves as far as it fits.
    """
    target = root / "var/cache/hapticd"
    if kept.exists():
        _run("cp", "-a", kept, target)
    (wheel,) = (root / "home/lab/hapticd/dist").glob("hapticd-*.whl")
    python = [
        "chroot",
        root,
        "env",
        *(f"{key}={value}" for key, value in COMPILED_FOR.items()),
        "/opt/hapticd/bin/python",
    ]
    _run(*python, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", f"/home/lab/hapticd/dist/{wheel.name}")
    _run(*python, "-m", "hapticd.service.precompile", stdout=subprocess.DEVNULL)
    _run(*python, "-c", "import sim_hw.canopen.device, sim_hw.canopen.transport, sim_hw.canopen.command, sim_hw.script")
    _run(*python, "-m", "pip", "uninstall", "--quiet", "--yes", "--root-user-action=ignore", "hapticd")
    folders = sorted(target.glob("hapticd-*"), key=lambda folder: folder.stat().st_atime)
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    for folder in folders[-4:]:
        _run("cp", "-a", folder, kept)


def _put_settings(root: Path) -> None:
    """pip without an index, Numba's CPU for everything that systemd or sudo starts, and the checks as a service."""
    (root / "etc/pip.conf").write_text("[global]\nno-index = true\ndisable-pip-version-check = true\n")
    numba = {key: value for key, value in COMPILED_FOR.items() if key != "NUMBA_CACHE_DIR"}
    words = " ".join(f'"{key}={value}"' for key, value in numba.items())
    drop_in = root / "etc/systemd/system.conf.d"
    drop_in.mkdir(exist_ok=True)
    (drop_in / "numba.conf").write_text(f"[Manager]\nDefaultEnvironment={words}\n")
    (root / "etc/sudoers.d/keep").write_text(f'Defaults env_keep += "WHEEL {" ".join(numba)}"\n')
    units = root / "etc/systemd/system"
    shutil.copy(GUEST / SERVICE, units)
    (units / "multi-user.target.wants").mkdir(exist_ok=True)
    (units / "multi-user.target.wants" / SERVICE).symlink_to(f"/etc/systemd/system/{SERVICE}")
