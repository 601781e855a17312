"""Statement and branch coverage of the core by the random frames and the kept corpus: python3 coverage.py [FRAMES].

Builds nothing: 'make coverage' does, and runs this. Exit code 1 below 95 %.
"""

import gzip
import json
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
BUILD = HERE / "build" / "coverage"
LEAST = 0.95


def measured() -> list[dict]:
    """gcov's JSON of the files of the core."""
    with tempfile.TemporaryDirectory() as folder:
        data = [str(path) for path in BUILD.glob("*.gcda")]
        subprocess.run(
            ["gcov", "--json-format", "--branch-probabilities", *data], cwd=folder, check=True, capture_output=True
        )
        files = [json.loads(gzip.decompress(path.read_bytes())) for path in Path(folder).glob("*.json.gz")]
    return [file for document in files for file in document["files"] if file["file"].startswith("core/")]


def main() -> int:
    """Run, measure, print; the exit code."""
    frames = sys.argv[1] if len(sys.argv) > 1 else "200000"
    for old in BUILD.glob("*.gcda"):
        old.unlink()
    subprocess.run([BUILD / "frames", frames, "1"], check=True)
    subprocess.run([BUILD / "frames", *sorted((HERE / "fuzz" / "corpus").iterdir())], check=True)
    enough = True
    print(f"{'file':20} {'statements':>16} {'branches':>16}")
    for file in sorted(measured(), key=lambda file: file["file"]):
        lines = [line["count"] > 0 for line in file["lines"]]
        branches = [branch["count"] > 0 for line in file["lines"] for branch in line["branches"]]
        cells = []
        for hit in (lines, branches):
            share = sum(hit) / len(hit) if hit else 1.0
            enough &= share >= LEAST
            cells.append(f"{sum(hit)}/{len(hit)} {100 * share:5.1f} %")
        print(f"{file['file']:20} {cells[0]:>16} {cells[1]:>16}")
        for line in file["lines"]:
            if line["count"] == 0 or any(branch["count"] == 0 for branch in line["branches"]):
                print(f"    not all of line {line['line_number']}")
    return 0 if enough else 1


if __name__ == "__main__":
    sys.exit(main())
