"""``python -m tests.dist.versions [PYTHON…]``: the wheel in an empty environment of each Python, and the self-test there.

Each Python gets the newest packages that pip finds for it, and the oldest that pyproject.toml allows: every lower bound
taken at its word. Interpreters are those of this machine (``python3.N`` on the path, pyenv's), and Debian's, with
debootstrap in a folder that is thrown away, as root. The table is on stdout.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PYTHONS = ("3.11", "3.12", "3.13", "3.14", "3.15")
DEBIAN = {"3.11": "bookworm", "3.13": "trixie", "3.14": "testing", "3.15": "testing"}
"""The suites that have them."""
SHOWN = ("numpy", "numba", "scipy", "pandas", "pyarrow")
_OWN_NAMESPACE = 'mount -t proc proc "$1/proc" && mount --rbind /dev "$1/dev" && exec chroot "$@"'


class NotToBeHadError(Exception):
    """An interpreter or a set of packages; the text says why."""


@dataclass(frozen=True)
class Interpreter:
    """One Python.

    Attributes:
        version: such as ``3.13``.
        where: in words, for the table.
        program: its path, inside ``root`` where there is one.
        root: root folder of the Debian that it lives in.
    """

    version: str
    where: str
    program: str
    root: Path | None = None

    def run(self, *command: str | Path) -> str:
        """Run a command where this interpreter is; what it prints.

        Raises:
            NotToBeHadError: with its last words.
        """
        words = [str(word) for word in command]
        environment = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
        if self.root is not None:
            words = ["unshare", "--mount", "sh", "-c", _OWN_NAMESPACE, "sh", str(self.root), *words]
            environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LANG": "C.UTF-8"}
        return output(words, environment)

    def outside(self, path: str) -> Path:
        """Where a path of its file system is on ours."""
        return Path(path) if self.root is None else self.root / path.lstrip("/")


def output(command: list[str], environment: dict[str, str] | None = None) -> str:
    """What a command prints.

    Raises:
        NotToBeHadError: it failed; its last words.
    """
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    if done.returncode != 0:
        wanted = [
            line for line in done.stderr.splitlines() if line.startswith(("ERROR: Could not find", "ERROR: Cannot"))
        ]
        words = (wanted or (done.stderr or done.stdout).splitlines())[-1:]
        raise NotToBeHadError(re.sub(r"^ERROR: | \(from versions: .*\)", "", "".join(words)))
    return done.stdout


def find(version: str, folder: Path) -> Interpreter:
    """This machine's interpreter of a version, else Debian's, which it installs into ``folder``.

    Raises:
        NotToBeHadError: neither.
    """
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for path in (shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python3"))):
        if path and _answers(str(path), version):
            return Interpreter(version, "this machine", str(path))
    suite = DEBIAN.get(version)
    if suite is None:
        raise NotToBeHadError("not on this machine, and Debian never had it in a release")
    if os.geteuid() != 0 or not shutil.which("debootstrap"):
        raise NotToBeHadError(f"not on this machine; Debian {suite} has it, which needs root and debootstrap")
    root = folder / suite
    if not root.exists():
        packages = ",".join(f"python{name}-venv" for name, of in DEBIAN.items() if of == suite)
        mirror = [os.environ["DEBIAN_MIRROR"]] if "DEBIAN_MIRROR" in os.environ else []
        output(["debootstrap", "--variant=minbase", f"--include={packages}", suite, str(root), *mirror])
    return Interpreter(version, f"Debian {suite}", f"/usr/bin/python{version}", root)


def _answers(path: str, version: str) -> bool:
    """Whether it is of that version and can make environments: pyenv's stand-ins on the path may be of none."""
    command = [path, "-c", "import ensurepip, sys; print('%d.%d' % sys.version_info[:2])"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode == 0 and done.stdout.strip() == version


def oldest() -> list[str]:
    """Every lower bound of pyproject.toml as the one version wanted."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    return [re.sub(r">=([^,]+).*", r"==\1", dependency) for dependency in project["dependencies"]]


def tried(python: Interpreter, wheel: Path, constraints: list[str], folder: Path) -> dict[str, str]:
    """Install and test; what the self-test found.

    The packages are fetched by this environment's pip, with its settings, and installed without an index.

    Raises:
        NotToBeHadError: they cannot be had together, or the self-test did not even start.
    """
    with tempfile.TemporaryDirectory(prefix="hd-", dir=python.outside("/tmp")) as name:
        here = Path(name)
        there = here if python.root is None else Path("/") / here.relative_to(python.root)
        (here / "constraints").write_text("\n".join(constraints))
        pip = [
            sys.executable,
            "-m",
            "pip",
            "--disable-pip-version-check",
            "download",
            "--quiet",
            "--only-binary",
            ":all:",
        ]
        pip += ["--python-version", python.version, "--dest", str(here / "wheels")]
        output([*pip, "--constraint", str(here / "constraints"), str(wheel)])
        shutil.copy(Path(__file__).with_name("selftest.py"), here)
        python.run(python.program, "-m", "venv", there / "venv")
        program = there / "venv/bin/python"
        options = ["--quiet", "--no-index", "--find-links", there / "wheels"]
        python.run(
            program, "-m", "pip", "--disable-pip-version-check", "install", *options, there / "wheels" / wheel.name
        )
        found: dict[str, str] = json.loads(python.run(program, "-I", there / "selftest.py"))
        return found


def main() -> int:
    """Print the table; 1 when a self-test failed."""
    failed = False
    print(f"| Python | from | packages | {' | '.join(SHOWN)} | |")
    print(f"|---|---|---|{'---|' * len(SHOWN)}---|")
    with tempfile.TemporaryDirectory(prefix="hapticd-versions-") as name:
        folder = Path(name)
        output([sys.executable, "-m", "build", "--wheel", "--outdir", str(folder), str(ROOT)])
        (wheel,) = folder.glob("*.whl")
        for version in sys.argv[1:] or PYTHONS:
            for kind, constraints in (("oldest", oldest()), ("newest", [])):
                row = [version, "", kind, *([""] * len(SHOWN))]
                try:
                    python = find(version, folder)
                    row[1] = python.where
                    found = tried(python, wheel, constraints, folder)
                    row = [found["python"], python.where, kind, *(found[package] for package in SHOWN)]
                    failed |= bool(found["failed"])
                    result = found["failed"] or "passed"
                except NotToBeHadError as error:
                    result = f"not to be had: {error}"
                print(f"| {' | '.join(row)} | {' '.join(result.split())} |", flush=True)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
