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
from dataclasses import dataclass
from functools import partial
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


@dataclass(frozen=True)
class Csv:
    """A scan as text: what it is, its file, and how polars is told to read it."""

    what: str
    file: str
    separator: str = ","

    @property
    def polars(self) -> dict[str, Any]:
        commas = self.separator == ";"
        return {"has_header": False, "schema": NUMBERS, "separator": self.separator, "decimal_comma": commas}


CSVS = (
    Csv("the CSV", "k1.csv"),
    Csv(f"the CSV with {EMPTY:.0%} empty cells", "gaps.csv"),
    Csv(f"the CSV with {EMPTY:.0%} empty cells, decimal commas", "commas.csv", ";"),
)

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


def read_with_polars(csv: Csv, folder: Path) -> None:
    """The three blocks as three frames of numbers: what a script with polars would do."""
    for block in range(3):
        frame = pl.read_csv(folder / csv.file, skip_rows=block * (PROFILES + 1), n_rows=PROFILES, **csv.polars)
        assert frame.shape == (PROFILES, POINTS)


def read_at_once_with_polars(csv: Csv, folder: Path) -> None:
    """All lines in one frame, the empty lines as rows without numbers."""
    assert pl.read_csv(folder / csv.file, **csv.polars).shape[1] == POINTS


def read_with_numpy(path: Path, blocks: int) -> None:
    """All lines in one array; numpy skips the empty ones."""
    assert np.loadtxt(path, delimiter=",").shape == (blocks * PROFILES, POINTS)


def write_x_and_z(csv: Path, path: Path) -> None:
    """The blocks X and Z alone, as plain text."""
    lines = csv.read_text().split("\n")
    path.write_text("\n".join(lines[:PROFILES] + lines[2 * (PROFILES + 1) :]))


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


def write_with_commas(csv: Path, path: Path) -> None:
    """The same file with decimal commas."""
    path.write_bytes(csv.read_bytes().translate(bytes.maketrans(b",.", b";,")))


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
        write_x_and_z(folder / "k1.csv", folder / "xz.csv")
        write_with_gaps(folder / "k1.csv", folder / "gaps.csv")
        write_with_commas(folder / "gaps.csv", folder / "commas.csv")
        measured = measure(folder, stand, shaft, repeat)
    Console(width=120).print(table_of(measured))


def measure(folder: Path, stand: Path, shaft: Path, repeat: int) -> list[tuple[str, float, str, str]]:
    """What was measured: name, seconds, against what, further remarks; medians over rounds of all of it in turn."""
    native, out = folder / "k1.h5", folder / "c.json"
    scan = ts.read_scan(native)
    artefact = ts.read_shaft(shaft)
    calibration = ts.calibrate(scan, artefact)
    walls: dict[str, list[float]] = {}
    commands: dict[str, list[tuple[float, float, float]]] = {}

    def clock(what: str, work: Callable[[], Any]) -> None:
        walls.setdefault(what, []).append(timed(work))

    def run(what: str, *arguments: object) -> None:
        commands.setdefault(what, []).append(command(*arguments))
        walls.setdefault(what, []).append(commands[what][-1][0])

    for _ in range(repeat):
        for csv in CSVS:
            ways = [timed(partial(read, csv, folder)) for read in (read_with_polars, read_at_once_with_polars)]
            walls.setdefault(f"polars reads {csv.what}", []).append(min(ways))
            run(
                f"calibrate from {csv.what}", "calibrate", folder / csv.file, "--stand", stand, "--artefact", shaft,
                "-o", out, "-q",
            )  # fmt: skip
        clock("numpy reads the CSV", lambda: read_with_numpy(folder / CSVS[0].file, 3))
        clock("numpy reads X and Z", lambda: read_with_numpy(folder / "xz.csv", 2))
        clock("calibrate, library call", lambda: ts.calibrate(scan, artefact))
        run("calibrate from the native file", "calibrate", native, "--artefact", shaft, "-o", out, "-q")
        run("roll to PLY, whole command", "roll", native, "--calibration", out, "-o", folder / "c.ply")
        surface = apply_calibration(scan, calibration)
        cloud = np.stack([surface.x, surface.y, surface.z])
        del surface
        clock("copy a rolled-up scan in memory", cloud.copy)
        clock("roll, library call", lambda: apply_calibration(scan, calibration))
        del cloud
        run("truestand --help", "--help")

    def line(what: str, *against: tuple[str, str]) -> tuple[str, float, str, str]:
        """A row of the table; ratios are those within a round, because the machine is shared."""
        ratios = [
            f"{statistics.median(a / b for a, b in zip(walls[what], walls[other], strict=True)):.1f} x {name}"
            for other, name in against
        ]
        used = ""
        if what in commands:
            cpu, peak = statistics.median(c for _, c, _ in commands[what]), max(p for _, _, p in commands[what])
            used = f"{cpu:.1f} s CPU, {peak:.2f} GB"
        return what, statistics.median(walls[what]), ", ".join(ratios), used

    polars = ("polars reads the CSV", "polars")
    return [
        *(line(f"polars reads {csv.what}") for csv in CSVS),
        line("numpy reads the CSV", polars),
        *(line(f"calibrate from {csv.what}", (f"polars reads {csv.what}", "polars")) for csv in CSVS),
        line("calibrate from the native file", polars),
        line("numpy reads X and Z"),
        line("calibrate, library call", ("numpy reads X and Z", "numpy")),
        line("copy a rolled-up scan in memory"),
        line("roll, library call", ("copy a rolled-up scan in memory", "the copy")),
        line("roll to PLY, whole command"),
        line("truestand --help"),
    ]


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
