"""One virtual scan: turn the table, draw what the sensor sees, add what goes wrong between them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import default_rng
from numpy.typing import NDArray

from truestand.core.artefact import Artefact
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.sim.parts import VirtualPart
from truestand.sim.sensor_errors import lose_patches, table_angles
from truestand.sim.sensor_model import SensorModel
from truestand.sim.simulation import Simulation
from truestand.sim.truth import Truth

Array = NDArray[np.float64]

BLOCK = 128
"""Profiles cast at once."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """A virtual scan and its truth."""

    recording: Recording
    truth: Truth


def simulate(
    stand: Stand,
    simulation: Simulation,
    artefact: Artefact,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    part: VirtualPart | None = None,
) -> Simulated:
    """Scan ``artefact``, with ``part`` on it, on the virtual stand; the same seed gives the same scan.

    ``progress`` is called with (profiles done, profiles in all).

    Raises:
        BadRecipe: a part that can't be, or not on this shaft.
    """
    rng = default_rng(seed)
    angle, counter, time, step = table_angles(stand, simulation.acquisition, rng)
    caster = SensorModel(stand, simulation, artefact, part, rng)
    truth = Truth(
        stand, simulation, caster.table_from_sensor, caster.shaft_from_rotor, step, angle, artefact, part
    )  # fmt: skip
    x, z = _scan(caster, angle, progress)
    lose_patches(z, simulation.optics, rng)
    x[np.isnan(z)] = np.nan
    return Simulated(_recording(truth, x, z, counter, time), truth)


def _scan(caster: SensorModel, angle: Array, progress: Callable[[int, int], None] | None) -> tuple[Array, Array]:
    """x and z (N, M) mm, a block of profiles at a time."""
    x, z = np.empty((angle.size, caster.points)), np.empty((angle.size, caster.points))
    for first in range(0, angle.size, BLOCK):
        rows = slice(first, min(first + BLOCK, angle.size))
        x[rows], z[rows] = caster.rows(angle[rows])
        if progress is not None:
            progress(rows.stop, angle.size)
    return x, z


def _recording(truth: Truth, x: Array, z: Array, counter: NDArray[np.int64], time: Array) -> Recording:
    stand, columns = truth.stand, truth.simulation.acquisition.columns
    reported = stand.table.sign * truth.angle
    counts = stand.counts_per_turn or 36000
    return Recording(
        -x if stand.sensor.mirrored else x,
        z,
        "simulated",
        "",
        time=time if "time" in columns else None,
        angle=reported if "angle" in columns else None,
        encoder=np.rint(reported / (2 * np.pi) * counts) if "encoder" in columns else None,
        counter=counter if "counter" in columns else None,
    )
