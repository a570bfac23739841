"""Twenty single faults put into the code, one at a time: which of them do the tests of their room find?

python bench/mutants.py [m01 m02 ...] [--root .] [--list bench/mutants.json] [--jobs 2]

The list was chosen by chance before any test was made faster. Each fault goes into a copy of src and tests; its tests
run there until the first failure.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def mutate(source: str, mutant: dict[str, str]) -> str:
    """The file with the one line changed; refuses a list that no longer fits the code."""
    at = source.index(f"def {mutant['function']}(")
    if mutant["old_line"] not in source[at:]:
        raise SystemExit(f"{mutant['id']}: {mutant['function']} in {mutant['file']} has no line {mutant['old_line']!r}")
    return source[:at] + source[at:].replace(mutant["old_line"], mutant["new_line"], 1)


def outcome(mutant: dict[str, str], root: Path, jobs: int) -> str:
    """The first test that fails with this fault in the code, or "survived"."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in ("src", "tests", "bench", "docs"):
            shutil.copytree(root / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("pyproject.toml", "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE"):
            shutil.copy(root / name, copy / name)
        changed = copy / "src" / mutant["file"]
        changed.write_text(mutate(changed.read_text(), mutant))
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", str(jobs), *mutant["tests"].split()]
        environment = os.environ | {"PYTHONPATH": str(copy / "src")}
        done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    if done.returncode not in (0, 1, 2) or (done.returncode and not failed):
        said = done.stdout[-2000:] + done.stderr[-2000:]
        raise SystemExit(f"{mutant['id']}: pytest ended with {done.returncode}\n{said}")
    return "found by " + failed[0].split(" - ")[0].split(maxsplit=1)[1] if failed else "survived"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("ids", nargs="*", help="only these, e.g. m01 m14")
    parser.add_argument("--root", type=Path, default=Path.cwd())
    parser.add_argument("--list", type=Path, default=Path(__file__).with_name("mutants.json"))
    parser.add_argument("--jobs", type=int, default=2, help="test processes")
    args = parser.parse_args()
    mutants = [m for m in json.loads(args.list.read_text()) if not args.ids or m["id"] in args.ids]
    found = 0
    for mutant in mutants:
        began = time.monotonic()
        said = outcome(mutant, args.root, args.jobs)
        found += said != "survived"
        took = time.monotonic() - began
        print(f"{mutant['id']} {mutant['file']} {mutant['function']}: {said} ({took:.0f} s)", flush=True)
    print(f"{found} of {len(mutants)} found")


if __name__ == "__main__":
    main()
