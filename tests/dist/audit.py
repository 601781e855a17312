"""``python -m tests.dist.audit`` (``make audit``): what is known against the versions in constraints.txt.

Three sources, each as far as the package index at hand goes: pip-audit, which asks for the index's own advisories and skips
what it has none for; the advisories in the package safety-db, as old as its newest release; releases that were taken back.
Prints what each could and could not look at, and fails on a finding.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

CONSTRAINTS = Path(__file__).parents[2] / "constraints.txt"
PINNED = {
    canonicalize_name(name): version for name, version in (line.split("==") for line in CONSTRAINTS.read_text().split())
}
_PIP = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", "install"]


def asked_index(folder: Path) -> tuple[str, list[str]]:
    """What pip-audit looked at, and found."""
    subprocess.run([sys.executable, "-m", "venv", str(folder / "venv")], check=True)
    pip = [str(folder / "venv/bin/python"), *_PIP[1:], "pip-audit"]
    subprocess.run(pip, check=True)
    command = [
        folder / "venv/bin/pip-audit",
        "--disable-pip",
        "--no-deps",
        "--progress-spinner",
        "off",
        "--format",
        "json",
    ]
    done = subprocess.run([*command, "-r", CONSTRAINTS], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False)
    packages = json.loads(done.stdout)["dependencies"] if done.stdout else []
    looked = [package for package in packages if "vulns" in package]
    found = [f"{package['name']} {package['version']}: {vuln['id']}" for package in looked for vuln in package["vulns"]]
    return f"{len(looked)} of {len(PINNED)} packages; the index has no advisories for the others", found


def asked_safety_db(folder: Path) -> tuple[str, list[str]]:
    """What the newest advisories that are a package say."""
    subprocess.run([*_PIP, "--no-deps", "--target", str(folder / "db"), "safety-db"], check=True)
    (metadata,) = (folder / "db").glob("safety_db-*.dist-info")
    advisories = json.loads((folder / "db/safety_db/insecure_full.json").read_text())
    read, found = 0, []
    for name, entries in advisories.items():
        version = PINNED.get(canonicalize_name(name))
        for entry in entries if version else ():
            read += 1
            if any(version in SpecifierSet(spec) for spec in entry["specs"]):
                found.append(f"{name} {version}: {entry['cve'] or entry['id']}")
    released = metadata.name.removeprefix("safety_db-").removesuffix(".dist-info")
    return f"{read} advisories on {len(PINNED)} packages, of {released}", found


def asked_authors(folder: Path) -> tuple[str, list[str]]:
    """Which releases are no longer offered."""
    report = folder / "report.json"
    options = ["--dry-run", "--ignore-installed", "--no-deps", "--report", str(report), "-r", str(CONSTRAINTS)]
    subprocess.run([*_PIP, *options], check=True)
    chosen = json.loads(report.read_text())["install"]
    found = [
        f"{entry['metadata']['name']} {entry['metadata']['version']}" for entry in chosen if entry.get("is_yanked")
    ]
    return f"{len(chosen)} of {len(PINNED)} releases", found


def main() -> int:
    """Print one line for each source; 1 on a finding."""
    findings = 0
    print("| source | looked at | found |\n|---|---|---|")
    sources = {"pip-audit": asked_index, "safety-db": asked_safety_db, "taken back": asked_authors}
    for name, ask in sources.items():
        with tempfile.TemporaryDirectory(prefix="hapticd-audit-") as folder:
            looked_at, found = ask(Path(folder))
        print(f"| {name} | {looked_at} | {'; '.join(found) or 'nothing'} |", flush=True)
        findings += len(found)
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
