"""``python -m tests.unprivileged [PYTEST ARGUMENT…]``: a part of the suite as an ordinary user, real time refused.

As root it runs as ``nobody``, without capabilities, groups and limits, on a copy that he may read: a clone, the virtual
environment and even the interpreter may lie in a folder of root's. Compiled code comes along, or it would be compiled anew.
As another user it runs where it is.
"""

from __future__ import annotations

import hashlib
import os
import pwd
import resource
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
USER = "nobody"
TESTS = (
    "tests/unprivileged",
    "tests/config",
    "tests/record",
    "tests/service/test_access.py",
    "tests/service/test_flight.py",
    "tests/service/test_process.py",
    "tests/service/test_socket.py",
    "tests/cli/test_cli_daemon.py",
    "tests/cli/test_cli_kept_recordings.py",
    "tests/cli/test_cli_usage.py",
)
_PARTS = ("benchmarks", "docs", "drivers", "examples", "hapticd", "sim_hw", "systemd", "tests")
_MEMLOCK = 64 << 10
"""Bytes: what Linux gave every user until 5.16."""


def main() -> int:
    """Run it; pytest's exit code."""
    chosen = sys.argv[1:] or [*TESTS]
    limit_all()
    if os.geteuid() != 0:
        return subprocess.run([sys.executable, *_pytest(chosen)], cwd=ROOT, check=False).returncode
    with tempfile.TemporaryDirectory(prefix="hd-") as name:
        folder = Path(name)
        folder.chmod(0o755)
        python, environment = copied(folder)
        print(f"as {USER}, in {folder}", flush=True)
        return subprocess.run(
            [*without_privileges(), python, *_pytest(chosen)], cwd=folder / "tree", env=environment, check=False
        ).returncode


def _pytest(chosen: list[str]) -> list[str]:
    return ["-m", "pytest", "-q", "-p", "no:cacheprovider", *chosen]


def limit_all() -> None:
    """No real-time priority and next to no locked memory, for this process and its children."""
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    _, most = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    least = _MEMLOCK if most == resource.RLIM_INFINITY else min(_MEMLOCK, most)
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (least, least))


def without_privileges() -> list[str]:
    """The command before a command that takes everything away."""
    group = str(pwd.getpwnam(USER).pw_gid)
    drops = ["--clear-groups", "--inh-caps=-all", "--bounding-set=-all", "--no-new-privs"]
    return ["setpriv", f"--reuid={USER}", f"--regid={group}", *drops]


def copied(folder: Path) -> tuple[str, dict[str, str]]:
    """What the user needs, in a folder of his own.

    Returns:
        Interpreter, environment.
    """
    tree, home = folder / "tree", folder / "home"
    tree.mkdir()
    for part in _PARTS:
        shutil.copytree(ROOT / part, tree / part, ignore=shutil.ignore_patterns("__pycache__"))
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy2(path, tree / path.name)
    subprocess.run(["chmod", "-R", "a+rX", str(tree)], check=True)
    python = _environment(folder, tree)
    _compiled(home / ".cache", tree)
    temporary = folder / "t"  # near the root: a socket's path has 107 bytes
    for place in (home, temporary):
        place.mkdir(exist_ok=True)
    subprocess.run(["chown", "-R", USER, str(home), str(temporary)], check=True)
    return str(python), {
        "PATH": f"{python.parent}:{os.environ['PATH']}",
        "HOME": str(home),
        "TMPDIR": str(temporary),
        # A copied interpreter would look for its library where it was built.
        "LD_LIBRARY_PATH": str(folder / "python/lib"),
        "LANG": os.environ.get("LANG", "C.UTF-8"),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HYPOTHESIS_STORAGE_DIRECTORY": str(home / "hypothesis"),
    }


def _environment(folder: Path, tree: Path) -> Path:
    """The virtual environment at another place, with the tree as its hapticd; its interpreter."""
    interpreter, base, venv = Path(sys.executable).resolve(), Path(sys.base_prefix).resolve(), folder / "venv"
    # setpriv itself may start what its user may not: a shell tries.
    probe = [*without_privileges(), "sh", "-c", 'exec "$0" -c ""', str(interpreter)]
    if subprocess.run(probe, check=False, stderr=subprocess.DEVNULL).returncode:
        link(base, folder / "python")
        interpreter = folder / "python" / interpreter.relative_to(base)
    link(Path(sys.prefix), venv)
    for old in venv.glob("bin/python*"):
        old.unlink()
    (venv / "bin/python").symlink_to(interpreter)
    (venv / "pyvenv.cfg").unlink()
    (venv / "pyvenv.cfg").write_text(f"home = {interpreter.parent}\ninclude-system-site-packages = false\n")
    packages = venv / Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)
    for old in packages.glob("__editable__*"):
        shutil.rmtree(old) if old.is_dir() else old.unlink()
    (packages / "hapticd-tree.pth").write_text(f"{tree}\n")
    return venv / "bin/python"


def link(source: Path, target: Path) -> None:
    """A copy that takes no room where both are on one file system."""
    if subprocess.run(["cp", "-al", str(source), str(target)], check=False, stderr=subprocess.DEVNULL).returncode:
        shutil.rmtree(target, ignore_errors=True)
        subprocess.run(["cp", "-a", str(source), str(target)], check=True)


def _compiled(cache: Path, tree: Path) -> None:
    """Numba keeps the code of a folder under the folder's name and a digest of its path; see numba.core.caching."""
    from hapticd import jit

    for source in {jit.cache_folder(room) for room in ("", *jit.FOLDERS)}:
        if source.is_dir():
            shutil.copytree(source, cache / "hapticd" / source.name)
    folders = [path for part in _PARTS for path in (ROOT / part).rglob("*") if path.is_dir()]
    for place in (*folders, *(ROOT / part for part in _PARTS)):
        for found in (cache / "hapticd").glob(f"*/{_subpath(place)}"):
            found.rename(found.with_name(_subpath(tree / place.relative_to(ROOT))))


def _subpath(folder: Path) -> str:
    return f"{folder.name}_{hashlib.sha1(str(folder).encode(), usedforsecurity=False).hexdigest()}"


if __name__ == "__main__":
    sys.exit(main())
