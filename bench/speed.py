"""How long the main job takes against only reading its file, in one run: ratios, for machines differ and are shared.

Run with the development environment: python bench/speed.py [--repeat 3]
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from rich.console import Console
from rich.table import Table

import truestand as ts
from truestand.core.surface import apply_calibration
from truestand.files.recipes.recipes import write_starters

PROFILES = 11_000
POINTS = 640
EMPTY = 0.2
"""Share of empty cells in the file with gaps."""
NUMBERS = {f"column_{i + 1}": pl.Float64 for i in range(POINTS)}


LAUNCH = """
import os, subprocess, sys, time
started = time.perf_counter()
process = subprocess.Popen([sys.executable, "-m", "truestand", *sys.argv[1:]], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
peak = used.ru_maxrss / (1024 if sys.platform == "darwin" else 1) / 1e6
print(os.waitstatus_to_exitcode(status), time.perf_counter() - started, used.ru_utime + used.ru_stime, peak)
"""
"""Runs a command from a small process: a child's peak memory counts that of the process it was forked from."""


def command(*arguments: object) -> tuple[float, float, float]:
    """Wall s, CPU s and peak memory (GB) of a ``truestand`` command, interpreter included."""
    done = subprocess.run(
        [sys.executable, "-c", LAUNCH, *map(str, arguments)], capture_output=True, text=True, check=True
    )
    code, wall, cpu, peak = done.stdout.split()
    if code != "0":
        raise RuntimeError(done.stderr)
    return float(wall), float(cpu), float(peak)


def timed(work: Callable[[], Any]) -> float:
    """Wall s of one call."""
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def read_with_polars(path: Path) -> None:
    """The three blocks as three frames of numbers: what a script with polars would do."""
    for block in range(3):
        frame = pl.read_csv(path, has_header=False, skip_rows=block * (PROFILES + 1), n_rows=PROFILES, schema=NUMBERS)
        assert frame.shape == (PROFILES, POINTS)


def read_at_once_with_polars(path: Path) -> None:
    """All lines in one frame, the empty lines as rows without numbers."""
    assert pl.read_csv(path, has_header=False, schema=NUMBERS).shape[1] == POINTS


def read_with_numpy(path: Path) -> None:
    """All lines in one array; numpy skips the empty ones."""
    assert np.loadtxt(path, delimiter=",").shape == (3 * PROFILES, POINTS)


def write_with_gaps(csv: Path, path: Path, share: float = EMPTY) -> None:
    """The same file with a share of the points of X and Z as empty cells, as real exports have them."""
    empty = np.random.default_rng(0).random((PROFILES, POINTS)) < share
    lines = csv.read_text().split("\n")
    for block in (0, 2):
        first = block * (PROFILES + 1)
        for row, gone in enumerate(empty, first):
            cells = lines[row].split(",")
            lines[row] = ",".join("" if g else cell for cell, g in zip(cells, gone, strict=True))
    path.write_text("\n".join(lines))


def main() -> None:
    """Measure, print one table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=3)
    repeat = parser.parse_args().repeat
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_starters(folder)
        stand, shaft = folder / "stand.toml", folder / "shaft.toml"
        command("simulate", stand, "--artefact", shaft, "-o", folder / "k1.csv", "-q")
        command("import", folder / "k1.csv", "--stand", stand, "-o", folder / "k1.h5", "-q")
        write_with_gaps(folder / "k1.csv", folder / "gaps.csv")
        measured = measure(folder, stand, shaft, repeat)
    Console(width=110).print(table_of(measured))


def measure(folder: Path, stand: Path, shaft: Path, repeat: int) -> list[tuple[str, float, str, str]]:
    """What was measured: name, seconds, against what, further remarks; each the median of ``repeat``, interleaved."""
    csv, gaps, native, out = folder / "k1.csv", folder / "gaps.csv", folder / "k1.h5", folder / "c.json"
    runs: dict[str, list[Any]] = {}
    scan = ts.read_scan(native)
    calibration = ts.calibrate(scan, ts.read_shaft(shaft))
    for _ in range(repeat):
        runs.setdefault("polars", []).append(timed(lambda: read_with_polars(csv)))
        runs.setdefault("polars at once", []).append(timed(lambda: read_at_once_with_polars(csv)))
        runs.setdefault("numpy", []).append(timed(lambda: read_with_numpy(csv)))
        runs.setdefault("csv", []).append(
            command("calibrate", csv, "--stand", stand, "--artefact", shaft, "-o", out, "-q")
        )
        runs.setdefault("polars, gaps", []).append(timed(lambda: read_at_once_with_polars(gaps)))
        runs.setdefault("csv, gaps", []).append(
            command("calibrate", gaps, "--stand", stand, "--artefact", shaft, "-o", out, "-q")
        )
        runs.setdefault("native", []).append(command("calibrate", native, "--artefact", shaft, "-o", out, "-q"))
        runs.setdefault("roll cli", []).append(command("roll", native, "--calibration", out, "-o", folder / "c.ply"))
        surface = apply_calibration(scan, calibration)
        cloud = np.stack([surface.x, surface.y, surface.z])
        del surface
        runs.setdefault("copy", []).append(timed(cloud.copy))
        runs.setdefault("roll", []).append(timed(lambda: apply_calibration(scan, calibration)))
        del cloud
        runs.setdefault("help", []).append(command("--help"))
    wall = {k: statistics.median(v[0] if isinstance(v, tuple) else v for v in values) for k, values in runs.items()}
    cpu = {k: statistics.median(v[1] for v in values) for k, values in runs.items() if isinstance(values[0], tuple)}
    peak = {k: max(v[2] for v in values) for k, values in runs.items() if isinstance(values[0], tuple)}
    reading = min(wall["polars"], wall["polars at once"])
    return [
        ("polars reads the CSV", reading, "1", ""),
        ("numpy reads the CSV", wall["numpy"], f"{wall['numpy'] / reading:.1f} x polars", ""),
        (
            "calibrate from the CSV", wall["csv"],
            f"{wall['csv'] / reading:.1f} x polars, {wall['csv'] / wall['numpy']:.2f} x numpy",
            f"{cpu['csv']:.1f} s CPU, {peak['csv']:.2f} GB",
        ),
        (
            f"calibrate from the CSV with {EMPTY:.0%} empty cells", wall["csv, gaps"],
            f"{wall['csv, gaps'] / wall['polars, gaps']:.1f} x polars reading that file",
            f"{cpu['csv, gaps']:.1f} s CPU, {peak['csv, gaps']:.2f} GB",
        ),
        ("calibrate from the native file", wall["native"], f"{wall['native'] / reading:.1f} x polars",
         f"{cpu['native']:.1f} s CPU, {peak['native']:.2f} GB"),
        ("copy a rolled-up scan in memory", wall["copy"], "1", ""),
        ("roll, library call", wall["roll"], f"{wall['roll'] / wall['copy']:.1f} x the copy", ""),
        ("roll to PLY, whole command", wall["roll cli"], "", f"{cpu['roll cli']:.1f} s CPU, {peak['roll cli']:.2f} GB"),
        ("truestand --help", wall["help"], "", f"{cpu['help']:.2f} s CPU"),
    ]  # fmt: skip


def table_of(measured: list[tuple[str, float, str, str]]) -> Table:
    """The table to print."""
    table = Table(title=f"{PROFILES:,} profiles of {POINTS} points, median of the runs")
    for heading, justify in (("what", "left"), ("wall", "right"), ("against", "left"), ("", "left")):
        table.add_column(heading, justify="right" if justify == "right" else "left")
    for what, seconds, against, more in measured:
        table.add_row(what, f"{seconds:.2f} s", against, more)
    return table


if __name__ == "__main__":
    main()
