"""How right the numbers are: scans of virtual stands through the commands, as a user runs them, against their truth.

Run with the development environment: python bench/accuracy.py [--seeds 3]
"""

import argparse
import itertools
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

STAND = """
[table]
speed_rad_per_s = 0.3141592653589793
direction = "{direction}"
[[sensor]]
name = "front"
profile_rate_hz = 200.0
points = 640
range_mm = [70.0, 120.0]
mirrored = {mirrored}
[simulation]
phi_deg = {phi}
eccentricity_um = 878.9
eccentricity_direction_deg = 40.0
{simulation}
"""
OVAL = """
[[simulation.form]]
surface = "base"
upr = 2
amplitude_um = 85.0
phase_deg = 25.0
"""
OFF = "laser_plane_offset_mm = 0.25\nlaser_plane_tilt_deg = 0.3\ntilt_mrad = 1.0\ntilt_direction_deg = 115.0\n"

Record = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """One virtual stand."""

    name: str
    simulation: str
    phi: float = -41.802
    direction: str = "ccw"
    mirrored: bool = False

    def stand(self) -> str:
        return STAND.format(
            direction=self.direction,
            mirrored=str(self.mirrored).lower(),
            phi=self.phi,
            simulation=self.simulation,
        )


def truestand(*arguments: object) -> None:
    """One command; its own exit codes 0 and 3 go on."""
    done = subprocess.run(
        [sys.executable, "-m", "truestand", *map(str, arguments)], capture_output=True, text=True, check=False
    )
    if done.returncode not in (0, 3):
        raise RuntimeError(done.stderr)


def run(case: Case, seed: int, method: str = "stand") -> tuple[Record, Record]:
    """The calibration and the truth of one scan."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truestand("init", folder)
        (folder / "stand.toml").write_text(case.stand(), encoding="utf-8")
        shaft = ("--artefact", folder / "shaft.toml")
        truth = folder / "truth.json"
        truestand(
            "simulate", folder / "stand.toml", *shaft, "-o", folder / "k.h5", "--truth", truth, "--seed", seed, "-q"
        )
        truestand("calibrate", folder / "k.h5", *shaft, "--method", method, "-o", folder / "c.json", "-q")
        return tuple(json.loads((folder / f).read_text(encoding="utf-8")) for f in ("c.json", "truth.json"))  # type: ignore[return-value]


def errors(found: Record, true: Record) -> dict[str, float]:
    """What was found minus what is true."""
    sensor, shaft = found["sensor"], found["shaft"]
    result = {
        "e / um": shaft["eccentricity_um"] - true["shaft"]["eccentricity_um"],
        "phi / deg": sensor["phi_deg"] - true["sensor"]["phi_deg"],
    }
    if sensor["laser_plane_offset_mm"] is not None:
        result["d / um"] = 1000 * (sensor["laser_plane_offset_mm"] - true["sensor"]["laser_plane_offset_mm"])
        tilt = sensor["laser_plane_tilt_deg"] - true["sensor"]["laser_plane_tilt_deg"]
        result["alpha / mrad"] = float(np.radians(tilt)) * 1000
        result["tilt / mrad"] = shaft["tilt_mrad"] - true["shaft"]["tilt_mrad"]
    return result


def in_shaft(record: Record, x: NDArray[Any], z: NDArray[Any], theta: float) -> NDArray[Any]:
    """p_C (3, n) by the one line of CONTRACT.md, written out once more."""
    c, s = np.cos(theta), np.sin(theta)
    turn = np.array([[c, s, 0, 0], [-s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    chain = np.array(record["shaft"]["shaft_from_rotor"]) @ turn @ np.array(record["sensor"]["table_from_sensor"])
    return np.asarray((chain @ np.stack([x, np.zeros_like(x), z, np.ones_like(x)]))[:3])


def field(found: Record, true: Record) -> tuple[float, float]:
    """Largest and rms distance (um) of calibrated from true points over the field, turn and height taken out."""
    z, slope = (a.ravel() for a in np.meshgrid(np.linspace(70, 120, 21), np.linspace(-0.14, 0.14, 15)))
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ours, theirs = (np.hstack([in_shaft(r, z * slope, z, t) for t in angles]) for r in (found, true))
    off = ours - theirs
    turn = (theirs[0] * off[1] - theirs[1] * off[0]).sum() / (theirs[0] ** 2 + theirs[1] ** 2).sum()
    off = off - np.stack([-turn * theirs[1], turn * theirs[0], np.full(off.shape[1], off[2].mean())])
    distance = 1000 * np.sqrt((off**2).sum(axis=0))
    return float(distance.max()), float(np.sqrt((distance**2).mean()))


def variations() -> Iterator[Case]:
    """Every sense of everything that has one, one to five turns, start angles all round."""
    for direction, phi, mirrored in itertools.product(
        ("ccw", "cw"), (-41.802, 41.802, -138.198, 138.198), (False, True)
    ):
        name = f"{direction}, phi {phi}{', mirrored' * mirrored}"
        yield Case(name, OFF + "profiles = 4000\nnoise_um = 5.0\n" + OVAL, phi, direction, mirrored)
    for turns in (1.0, 1.5, 2.0, 3.3, 5.0):
        yield Case(f"{turns} turns", OFF + f"profiles = {round(4000 * turns)}\nnoise_um = 5.0\n" + OVAL)
    for off in (2e-5, 1e-4, 1e-2):
        yield Case(
            f"1 turn, table {off:g} fast", OFF + f"profiles = 4000\nspeed_factor = {1 + off}\nnoise_um = 5.0\n" + OVAL
        )
    for start in (-170.0, -60.0, 45.0, 200.0, 355.0):
        simulation = f'profiles = 4400\nstart_angle_deg = {start}\ncolumns = ["angle"]\nnoise_um = 5.0\n'
        yield Case(f"start at {start}", OFF + simulation + OVAL)


def phases() -> Iterator[Case]:
    """A sensor with 25 um of range error, one sine over its range, from phase to phase."""
    for phase in range(0, 360, 45):
        simulation = f"profiles = 4000\nnoise_um = 5.0\nnonlinearity_um = 25.0\nnonlinearity_phase_deg = {phase}.0\n"
        yield Case(f"phase {phase}", simulation + OVAL)


def main() -> None:
    """Measure, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    seeds = range(parser.parse_args().seeds)
    console = Console(width=130)
    console.print(named(seeds))
    console.print(errors_of("senses, turns, start angles: method stand, 5 um of noise", variations()))
    console.print(errors_of("25 um of range error: method stand, 5 um of noise", phases()))


def named(seeds: range) -> Table:
    """The stands of the promises, all seeds."""
    table = Table(title="paper's stand and its relatives")
    for heading in ("stand", "seed", "method", "errors", "residual / um", "more"):
        table.add_column(heading)
    paper = Case("paper's scan", "noise_um = 5.0\n" + OVAL)
    bent = Case("25 um range error", "noise_um = 5.0\nnonlinearity_um = 25.0\n" + OVAL)
    off = Case("plane 0.25 mm, 0.3 deg off; shaft tilted 1 mrad", OFF + "noise_um = 10.0\n")
    for seed in seeds:
        for case, method in ((paper, "paper"), (paper, "stand"), (bent, "stand"), (off, "stand")):
            found, true = run(case, seed, method)
            shown = ", ".join(f"{k} {v:+.4f}" for k, v in errors(found, true).items())
            left = found["residuals"]
            table.add_row(
                case.name, str(seed), method, shown, f"{left['rms_um']:.2f} rms, {left['p90_um']:.2f} p90",
                more(case, found, true),
            )  # fmt: skip
    return table


def more(case: Case, found: Record, true: Record) -> str:
    """What else a stand is there to show."""
    if found["method"] == "paper":
        p = found["paper"]
        return f"phi {found['sensor']['phi_deg']:.4f}, e {p['fit_amplitude_um']:.1f}, bin {p['phase_error_pi']:+.3f} pi"
    if case.name.startswith("plane"):
        return "field: {:.1f} um at most, {:.1f} um rms".format(*field(found, true))
    return "; ".join(f"{c['name']}: {c['value']:.0f}" for c in found["checks"] if not c["ok"])


def errors_of(title: str, cases: Iterator[Case]) -> Table:
    """Each case's errors, and the largest against its own U."""
    table = Table(title=title)
    table.add_column("stand")
    table.add_column("status")
    columns = {"e / um": "eccentricity_um", "phi / deg": "phi_deg", "d / um": "laser_plane_offset_mm",
               "alpha / mrad": "laser_plane_tilt_deg", "tilt / mrad": "tilt_mrad"}  # fmt: skip
    units = {"d / um": 1000.0, "alpha / mrad": float(np.radians(1000.0))}
    for heading in (*columns, "worst / U"):
        table.add_column(heading, justify="right")
    for case in cases:
        found, true = run(case, 1)
        off = errors(found, true)
        worst = max(abs(off[c]) / (found["uncertainty"][key]["U"] * units.get(c, 1.0)) for c, key in columns.items())
        table.add_row(case.name, found["status"], *(f"{off[c]:+.4f}" for c in columns), f"{worst:.2f}")
    return table


if __name__ == "__main__":
    main()
