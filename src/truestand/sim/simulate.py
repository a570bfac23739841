"""One virtual scan: the angles of the table, what the sensor sees there, and the recording of it."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator, default_rng
from numpy.typing import NDArray

from truestand.core.arrays import Array, Ints
from truestand.core.artefact import Artefact
from truestand.core.scan import Recording
from truestand.core.stand import Stand
from truestand.sim.parts import VirtualPart
from truestand.sim.sensor_errors import lose_patches
from truestand.sim.sensor_model import SensorModel
from truestand.sim.simulation import DEFAULT_COUNTS_PER_TURN, Acquisition, Simulation, speed_and_rate
from truestand.sim.truth import Truth

BLOCK_PROFILES = 128
"""Computed at once."""
MAX_GAPS = 5
"""Runs of lost profiles."""


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
    angle, counter, time, step = _table_angles(stand, simulation.acquisition, rng)
    model = SensorModel(stand, simulation, artefact, part, rng)
    truth = Truth(stand, simulation, model.table_from_sensor, model.shaft_from_rotor, step, angle, artefact, part)
    x, z = _scan(model, angle, progress)
    lose_patches(z, simulation.optics, rng)
    x[np.isnan(z)] = np.nan
    return Simulated(_recording(truth, x, z, counter, time), truth)


def _table_angles(stand: Stand, a: Acquisition, rng: Generator) -> tuple[Array, NDArray[np.int64], Array, float]:
    """True table angle (N,) rad, counter, time (s) of the profiles that arrive, and the mean step."""
    speed, rate = speed_and_rate(stand)
    total = a.profiles + a.dropped
    time = np.arange(total) / rate
    turned = np.where(time < a.ramp, time**2 / (2 * max(a.ramp, 1e-9)), time - a.ramp / 2)
    turned = turned * speed * a.speed_factor
    turned = turned + a.ripple / a.ripple_per_turn * np.sin(a.ripple_per_turn * turned)
    arrived = np.setdiff1d(np.arange(total), _gaps(total, a.dropped, rng))[: a.profiles]
    angle = a.start_angle + stand.table.sign * turned
    return angle[arrived], arrived.astype(np.int64), time[arrived], speed * a.speed_factor / rate


def _gaps(total: int, dropped: int, rng: Generator) -> Ints:
    """Indices of the profiles that get lost: in runs, none at the ends."""
    runs = min(MAX_GAPS, dropped)
    lost: set[int] = set()
    for i in range(runs):
        length = dropped // runs + (i < dropped % runs)
        while True:
            start = int(rng.integers(1, max(total - length - 1, 2)))
            run = set(range(start, start + length))
            if not run & lost:
                lost |= run
                break
    return np.array(sorted(lost), dtype=np.intp)


def _scan(model: SensorModel, angle: Array, progress: Callable[[int, int], None] | None) -> tuple[Array, Array]:
    """x and z (N, M) mm, a block of profiles at a time."""
    x, z = np.empty((angle.size, model.points)), np.empty((angle.size, model.points))
    for first in range(0, angle.size, BLOCK_PROFILES):
        rows = slice(first, min(first + BLOCK_PROFILES, angle.size))
        x[rows], z[rows] = model.profiles(angle[rows])
        if progress is not None:
            progress(rows.stop, angle.size)
    return x, z


def _recording(truth: Truth, x: Array, z: Array, counter: NDArray[np.int64], time: Array) -> Recording:
    stand, columns = truth.stand, truth.simulation.acquisition.columns
    reported = stand.table.sign * truth.angle
    counts = stand.counts_per_turn or DEFAULT_COUNTS_PER_TURN
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
