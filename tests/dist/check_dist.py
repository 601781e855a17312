"""Wheel and sdist, built into dist/ from the files that are under version control, and what is in them (``make dist``).

Not among the tests that run by themselves: the build fetches its back end.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from email.parser import BytesParser
from importlib.metadata import EntryPoints
from pathlib import Path

import pytest
from packaging.metadata import Metadata

from hapticd.config.presets import preset_names

ROOT = Path(__file__).parents[2]
DIST = ROOT / "dist"
PACKAGES = ("hapticd", "drivers", "sim_hw")
BESIDE = ("docs", "examples", "systemd")
"""Folders of the sdist that are not of the wheel."""
TEXTS = {"CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "README.md"}
TOP = {"Makefile", "MANIFEST.in", "constraints.txt", "install.sh", "mkdocs.yml", "pyproject.toml", *TEXTS}

pytestmark = pytest.mark.timeout(900)


def tracked() -> list[Path]:
    """Files under version control and those that would be, relative to the root."""
    command = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("\0")
    return [Path(name) for name in names if name and (ROOT / name).is_file()]


def below(*folders: str) -> set[str]:
    return {str(path) for path in tracked() if path.parts[0] in folders}


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What building said. From a copy: left-overs of earlier builds can neither help nor get in."""
    copy = tmp_path_factory.mktemp("source")
    for path in tracked():
        (copy / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / path, copy / path)
    shutil.rmtree(DIST, ignore_errors=True)
    environment = {
        key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"
    }  # it warns of that
    # The wheel is built from the sdist, so this shows that the sdist is enough.
    command = [sys.executable, "-m", "build", "--outdir", str(DIST), str(copy)]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


@pytest.fixture(scope="session")
def wheel(log: str) -> Path:
    (path,) = DIST.glob("*.whl")
    return path


@pytest.fixture(scope="session")
def sdist(log: str) -> Path:
    (path,) = DIST.glob("*.tar.gz")
    return path


@pytest.fixture(scope="session")
def metadata(wheel: Path) -> bytes:
    return _of_dist_info(wheel, "METADATA")


@pytest.fixture(scope="session")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Programs of a fresh environment that has the wheel, and beside it the dependencies of this one."""
    home = tmp_path_factory.mktemp("fresh")
    subprocess.run([sys.executable, "-m", "venv", str(home)], check=True)
    pip = [str(home / "bin/python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "--no-deps", "--no-index", str(wheel)], check=True)
    # A path in a .pth file: packages are found there, but no .pth file of there is read, so no editable hapticd.
    (home / sysconfig.get_path("purelib", vars={"base": str(home)}) / "dependencies.pth").write_text(
        sysconfig.get_path("purelib") + "\n"
    )
    return home / "bin"


def _of_dist_info(wheel: Path, name: str) -> bytes:
    with zipfile.ZipFile(wheel) as archive:
        (path,) = (entry for entry in archive.namelist() if entry.endswith(f".dist-info/{name}"))
        return archive.read(path)


def run(program: Path, *words: str) -> str:
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [program, *words], capture_output=True, text=True, check=False, cwd=program.parent, env=environment
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_building_warns_of_nothing(log: str) -> None:
    assert [line for line in log.splitlines() if "warning" in line.lower() or "deprecat" in line.lower()] == []


def test_the_wheel_holds_the_packages_and_nothing_else(wheel: Path) -> None:
    """Templates, presets, EDS, profiles, py.typed: whatever is in a package's folder. No tests, no benchmarks."""
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    pages = {name for name in names if ".data/data/share/doc/hapticd/faults/" in name}
    assert {Path(name).name for name in pages} == {
        path.name for path in tracked() if path.parent == Path("docs/faults")
    }
    names -= pages
    assert names == below(*PACKAGES)
    assert {Path(name).suffix for name in names} >= {".py", ".yaml", ".html", ".eds", ".typed"}


def test_the_sdist_holds_what_an_installation_needs(sdist: Path) -> None:
    with tarfile.open(sdist) as archive:
        entries = {entry.name.partition("/")[2]: entry for entry in archive if entry.isfile()}
    made = {"PKG-INFO", "setup.cfg"} | {name for name in entries if name.startswith("hapticd.egg-info/")}
    assert set(entries) - made == below(*PACKAGES, *BESIDE) | TOP
    for script in ("install.sh", "systemd/install.sh"):
        assert entries[script].mode & 0o111, f"{script} cannot be run"


def test_the_metadata_are_valid(metadata: bytes) -> None:
    found = Metadata.from_email(metadata, validate=True)
    assert found.description == (ROOT / "README.md").read_text()
    assert found.description_content_type == "text/markdown"
    assert found.summary
    assert found.requires_python is not None
    needed = [requirement for requirement in found.requires_dist or () if requirement.marker is None]
    assert all(requirement.specifier for requirement in needed)


def test_every_entry_point_leads_somewhere(wheel: Path) -> None:
    """Without importing, which would compile."""
    points = EntryPoints._from_text(_of_dist_info(wheel, "entry_points.txt").decode())
    assert {point.group for point in points} == {"console_scripts", "hapticd.drivers", "can.interface"}
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
        for point in points:
            path = point.module.replace(".", "/")
            (source,) = {f"{path}.py", f"{path}/__init__.py"} & names
            tree = ast.parse(archive.read(source))
            assert point.attr in _names(tree), f"{point.value} is not there"


def _names(tree: ast.Module) -> set[str]:
    found = {node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    imports = (node for node in tree.body if isinstance(node, ast.ImportFrom))
    return found | {alias.asname or alias.name for node in imports for alias in node.names}


def test_it_runs_where_it_is_installed(installed: Path, metadata: bytes) -> None:
    described = BytesParser().parsebytes(metadata)
    assert run(installed / "hapticd", "--version").split() == ["hapticd", described["Version"]]
    where = run(installed / "python", "-c", "import hapticd; print(hapticd.__file__)")
    assert Path(where.strip()).is_relative_to(installed.parent)


@pytest.mark.parametrize("preset", preset_names())
def test_its_presets_are_there(installed: Path, preset: str) -> None:
    assert "servo:" in run(installed / "hapticd", "config", "show", preset)
