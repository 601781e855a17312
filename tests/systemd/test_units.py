"""What goes onto a machine with systemd, judged by systemd's own tools on a tree laid out as the installer lays it out."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from hapticd.cli import man

SOURCE = Path(__file__).parents[2] / "systemd"
DEBIANS_UNITS = Path("/usr/lib/systemd/system")
PROGRAMS = ("opt/hapticd/bin/hapticd", "usr/bin/kill", "usr/sbin/ip")
"""What the units call: ours, and those of Debian's packages procps and iproute2. Empty here: nothing is run."""
INSTANCES = (
    "hapticd.service",
    "hapticd@left.service",
    "hapticd-can0.service",
    "hapticd-metrics@hapticd.service",
    "hapticd-metrics@hapticd.timer",
    "hapticd-scope.service",
)


def tool(name: str) -> str:
    found = shutil.which(name)
    if not found:
        pytest.skip(f"{name} is not here; Debian's package systemd has it (udevadm: the package udev)")
    return found


def run(*command: str | Path) -> tuple[int, str]:
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    return done.returncode, done.stdout


def verify(root: Path, *units: str) -> tuple[int, str]:
    # Without the units that ours depend on, which are Debian's, and without manual pages, which have a test of their own.
    return run(tool("systemd-analyze"), "verify", "--man=no", "--recursive-errors=no", f"--root={root}", *units)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A machine's tree with our units installed and the programs that they name."""
    if not (DEBIANS_UNITS / "sysinit.target").exists():
        pytest.skip(f"{DEBIANS_UNITS} holds no units; Debian's package systemd has them")
    shutil.copytree(DEBIANS_UNITS, tmp_path / DEBIANS_UNITS.relative_to("/"), symlinks=True)
    for link in ("bin", "sbin", "lib"):
        (tmp_path / link).symlink_to(f"usr/{link}")
    for program in PROGRAMS:
        path = tmp_path / program
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("#!/bin/sh\n")
        path.chmod(0o755)
    installed = tmp_path / "usr/local/lib/systemd/system"
    installed.mkdir(parents=True)
    for unit in (*SOURCE.glob("*.service"), *SOURCE.glob("*.timer")):
        shutil.copy(unit, installed)
    return tmp_path


def test_every_unit_is_looked_at() -> None:
    templates = {re.sub(r"@\w+", "@", unit) for unit in INSTANCES}
    assert templates == {path.name for path in SOURCE.iterdir() if path.suffix in (".service", ".timer")}


@pytest.mark.parametrize("unit", INSTANCES)
def test_systemd_finds_nothing_wrong(root: Path, unit: str) -> None:
    assert verify(root, unit) == (0, "")


@pytest.mark.parametrize(
    ("right", "wrong", "complaint"),
    [("WatchdogSec", "WatchdogSeconds", "Unknown key"), ("/opt/hapticd/bin", "/opt/haptic/bin", "not executable")],
)
def test_systemd_would_find_it(root: Path, right: str, wrong: str, complaint: str) -> None:
    unit = root / "usr/local/lib/systemd/system/hapticd.service"
    unit.write_text(unit.read_text().replace(right, wrong))
    assert complaint in verify(root, "hapticd.service")[1]


@pytest.mark.parametrize("unit", sorted(path.name for path in SOURCE.glob("*.service")))
def test_exposure_is_at_most_3(unit: str) -> None:
    code, said = run(
        tool("systemd-analyze"), "security", "--offline=true", "--threshold=30", "--no-pager", SOURCE / unit
    )
    assert code == 0, said.splitlines()[-1]


def test_the_manual_pages_that_units_name_are_made(tmp_path: Path) -> None:
    man.main(tmp_path)
    for unit in (*SOURCE.glob("*.service"), *SOURCE.glob("*.timer")):
        pages = re.findall(r"man:([\w-]+)\((\d)\)", unit.read_text())
        assert pages
        for name, section in pages:
            assert (tmp_path / f"{name}.{section}").exists(), f"{unit.name} names {name}({section})"


def test_user_group_and_folders(tmp_path: Path) -> None:
    """The user first: the folders belong to it."""
    sysusers, tmpfiles = tool("systemd-sysusers"), tool("systemd-tmpfiles")
    if os.geteuid() != 0:
        pytest.skip("only root can make users and folders that belong to them, even in a tree of its own")
    (tmp_path / "etc").mkdir()
    code, said = run(sysusers, f"--root={tmp_path}", SOURCE / "hapticd.sysusers")
    assert code == 0, said
    users = {line.split(":")[0]: line.split(":") for line in (tmp_path / "etc/passwd").read_text().splitlines()}
    groups = {line.split(":")[0]: line.split(":") for line in (tmp_path / "etc/group").read_text().splitlines()}
    assert users["hapticd"][6].endswith("nologin")
    assert groups["dialout"][3].split(",") == ["hapticd"]

    assert run(tmpfiles, f"--root={tmp_path}", "--create", SOURCE / "hapticd.tmpfiles") == (0, "")
    user, group = int(users["hapticd"][2]), int(groups["hapticd"][2])
    for folder, owner, mode in (
        ("etc/hapticd", 0, 0o750),
        ("var/lib/hapticd", user, 0o750),
        ("var/lib/hapticd/runs", user, 0o2750),
    ):
        found = (tmp_path / folder).stat()
        assert (found.st_uid, found.st_gid, found.st_mode & 0o7777) == (owner, group, mode), folder


def test_udev_understands_the_rules() -> None:
    udevadm = tool("udevadm")
    version = int(run(udevadm, "--version")[1].split()[0])
    if version < 254:
        pytest.skip(f"udevadm {version} cannot verify rules; 254 can")
    # The group hapticd is made by the installer.
    code, said = run(udevadm, "verify", "--resolve-names=never", SOURCE / "60-hapticd.rules")
    assert code == 0, said
