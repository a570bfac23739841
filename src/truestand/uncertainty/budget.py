"""The uncertainty budget: every input with its value, distribution, sensitivity and degrees of freedom (GUM, JCGM 100),
and Monte Carlo of the same inputs through the same quantities (JCGM 101).

Type A comes from the scatter of the fit, type B from certificate, data sheet and mounting. Where a recipe is silent, a
usual value stands in and its name says so (``core.assumptions``).
"""

from dataclasses import dataclass
from math import degrees, hypot, sqrt

import numpy as np

from truestand.core.arrays import Array
from truestand.core.assumptions import K
from truestand.core.calibration import Contribution, Uncertainty
from truestand.core.frames import ECCENTRICITY, PHI, PLANE_OFFSET, PLANE_TILT, RADIAL, TILT, UNKNOWNS

COVERAGE_PROBABILITY = 0.9545
DIRECTIONS = ("eccentricity_direction_deg", "tilt_direction_deg")
HALF_TURN_DEG = 180.0
"""U of a direction of which nothing is known; no U can be more."""
TRIALS = 20_000
MOST_DISAGREEMENT = 0.05
"""Share of U by which Monte Carlo may differ; beyond it (a magnitude near zero isn't normal) its value is reported."""


@dataclass(frozen=True, slots=True)
class Input:
    """One input of type B: its standard uncertainty ``u`` and by how much each quantity follows it."""

    name: str
    u: float
    distribution: str
    follows: dict[str, float]
    """Sensitivity by key of the record, in the record's unit per the input's (mm, rad or relative)."""


def budget_of(
    p: Array, parts: dict[str, Array], inputs: tuple[Input, ...], noise_dof: float, stated: dict[str, float]
) -> dict[str, Uncertainty]:
    """U (k = 2) of every reported quantity with its contributions, confirmed by Monte Carlo.

    Args:
        p: the unknowns of the geometry (8,), mm and rad.
        parts: their covariance (8, 8) by source; ``noise`` is of type A.
        inputs: what the unknowns' covariance doesn't hold.
        noise_dof: degrees of freedom of the noise.
        stated: standard uncertainty of the inputs behind the other parts, by name, where they are one number.
    """
    simulated = monte_carlo(p, parts, inputs)
    budget = {}
    for key, gradient in sensitivities(p).items():
        lines = [_from_fit(name, part, gradient, noise_dof, stated) for name, part in parts.items()]
        lines += [_from_input(i, key) for i in inputs if key in i.follows]
        U = float(np.sqrt(sum(line.U**2 for line in lines)))
        lines.sort(key=lambda line: -line.U)
        reported = simulated[key] if abs(simulated[key] - U) > MOST_DISAGREEMENT * U else U
        if key in DIRECTIONS:  # trials are never farther off than half a turn, and U neither
            reported = min(max(reported, U), HALF_TURN_DEG)
        budget[key] = Uncertainty(reported, K, tuple(lines), simulated[key])
    return budget


def sensitivities(p: Array) -> dict[str, Array]:
    """Gradient (8,) of each reported quantity, in the record's unit, over the unknowns p (8,) in mm and rad."""
    unit = np.eye(UNKNOWNS)
    (x, y), (along_x, along_y) = p[ECCENTRICITY], p[TILT]
    ex, ey = unit[ECCENTRICITY]
    tx, ty = unit[TILT]
    e, t = hypot(x, y), hypot(along_x, along_y)
    return {
        "phi_deg": degrees(1) * unit[PHI],
        "radial_position_mm": unit[RADIAL],
        "laser_plane_offset_mm": unit[PLANE_OFFSET],
        "laser_plane_tilt_deg": degrees(1) * unit[PLANE_TILT],
        "eccentricity_um": 1000.0 * (x * ex + y * ey) / max(e, 1e-9),
        "eccentricity_direction_deg": degrees(1) * (x * ey - y * ex) / max(e * e, 1e-12),
        "tilt_mrad": 1000.0 * (along_x * tx + along_y * ty) / max(t, 1e-9),
        "tilt_direction_deg": degrees(1) * (along_x * ty - along_y * tx) / max(t * t, 1e-12),
    }


def monte_carlo(
    p: Array, parts: dict[str, Array], inputs: tuple[Input, ...], trials: int = TRIALS, seed: int = 1
) -> dict[str, float]:
    """Half-width, in the record's unit, that holds 95.45 % of the trials about the estimate, by key.

    The inputs are drawn from their distributions and go through the quantities themselves, not their slopes: near
    e = 0 the eccentricity is no longer normal and its direction wraps.
    """
    rng = np.random.default_rng(seed)
    whole = np.asarray(sum(parts.values()))
    drawn = p + rng.standard_normal((trials, UNKNOWNS)) @ square_root(whole)[0].T
    values, best = _quantities(drawn), _quantities(p[None])
    off = {key: values[key] - best[key] for key in values}
    for i in inputs:
        noise = rng.standard_normal(trials) if i.distribution == "normal" else rng.uniform(-sqrt(3), sqrt(3), trials)
        for key, sensitivity in i.follows.items():
            off[key] = off[key] + i.u * sensitivity * noise
    for key in DIRECTIONS:
        off[key] = (off[key] + HALF_TURN_DEG) % (2 * HALF_TURN_DEG) - HALF_TURN_DEG
    return {key: float(np.quantile(np.abs(o), COVERAGE_PROBABILITY)) for key, o in off.items()}


def square_root(covariance: Array) -> tuple[Array, Array]:
    """A square root (n, n) of a covariance whose unknowns have very different units, and the squared weight (n,) of
    each of its columns once all unknowns have one unit, the largest last.
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)), values


def _quantities(p: Array) -> dict[str, Array]:
    """The reported quantities (n,) of parameters (n, 8), in the record's units."""
    (ex, ey), (tx, ty) = p[:, ECCENTRICITY].T, p[:, TILT].T
    return {
        "phi_deg": np.degrees(p[:, PHI]),
        "radial_position_mm": p[:, RADIAL],
        "laser_plane_offset_mm": p[:, PLANE_OFFSET],
        "laser_plane_tilt_deg": np.degrees(p[:, PLANE_TILT]),
        "eccentricity_um": 1000.0 * np.hypot(ex, ey),
        "eccentricity_direction_deg": np.degrees(np.arctan2(ey, ex)),
        "tilt_mrad": 1000.0 * np.hypot(tx, ty),
        "tilt_direction_deg": np.degrees(np.arctan2(ty, tx)),
    }


def _from_fit(name: str, part: Array, gradient: Array, noise_dof: float, stated: dict[str, float]) -> Contribution:
    u = sqrt(max(float(gradient @ part @ gradient), 0.0))
    if name == "noise":
        return Contribution(name, K * u, u, "normal", 1.0, noise_dof)
    value = stated.get(name) or u
    return Contribution(name, K * u, value, "normal", u / value if value else 0.0)


def _from_input(i: Input, key: str) -> Contribution:
    return Contribution(i.name, K * i.u * i.follows[key], i.u, i.distribution, i.follows[key])
