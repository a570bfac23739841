"""The uncertainty budget: every input with its value, distribution, sensitivity and degrees of freedom (GUM, JCGM 100),
and Monte Carlo of the same inputs through the same quantities (JCGM 101).

Type A comes from the scatter of the fit, type B from certificate, data sheet and mounting. Where a recipe is silent, a
usual value stands in and its name says so.
"""

from dataclasses import dataclass, replace
from math import degrees, hypot, inf, sqrt

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.checks import linearity_name, linearity_of
from truestand.calibration.refine import Refined
from truestand.core.artefact import Artefact
from truestand.core.assumptions import ANGLE_ZERO_U, BEARING_U, EXPANSION, SCALE_U, TEMPERATURE_U
from truestand.core.calibration import Contribution, StaticProfile, Uncertainty
from truestand.core.frames import UNKNOWNS
from truestand.core.scan import Scan

Array = NDArray[np.float64]

K = 2.0
TWO_SIGMA = 0.9545
DIRECTIONS = ("eccentricity_direction_deg", "tilt_direction_deg")
HALF_TURN = 180.0
"""deg; nothing known of a direction is any within half a turn to either side, and no U can be more."""
HEIGHT_HIDDEN_U, HEIGHT_SEEN_U = 0.5, 0.01
"""mm, k = 2: an edge may be broken by as much where its face is hidden; where it is seen."""
TRIALS = 20_000
AGREE = 0.05
"""Share of U by which Monte Carlo may differ; beyond it (a magnitude near zero isn't normal) Monte Carlo stands."""


@dataclass(frozen=True, slots=True)
class Input:
    """One input of type B: its standard uncertainty ``u`` and by how much each quantity follows it."""

    name: str
    u: float
    distribution: str
    follows: dict[str, float]
    """Sensitivity by key of the record, in the record's unit per the input's (mm, rad or relative)."""
    dof: float = inf


def budget_of(
    parts: dict[str, Array], scan: Scan, artefact: Artefact, fit: Refined, static: tuple[StaticProfile, ...]
) -> dict[str, Uncertainty]:
    """U (k = 2) of every reported quantity with its contributions, confirmed by Monte Carlo.

    ``parts``: covariance (p, p) of the unknowns by source, mm and rad.
    """
    p = fit.solution.parameters
    gradients = sensitivities(p)
    inputs = type_b(scan, artefact, fit, static)
    simulated = monte_carlo(p, parts, inputs)
    found = {}
    for key, gradient in gradients.items():
        lines = [_from_fit(name, part, gradient, fit) for name, part in parts.items()]
        lines += [_from_input(i, key) for i in inputs if key in i.follows]
        U = float(np.sqrt(sum(line.U**2 for line in lines)))
        lines.sort(key=lambda line: -line.U)
        stands = simulated[key] if abs(simulated[key] - U) > AGREE * U and key not in DIRECTIONS else U
        found[key] = Uncertainty(stands, K, tuple(lines), simulated[key])
    return found | {key: replace(found[key], U=min(found[key].U, HALF_TURN)) for key in DIRECTIONS}


def sensitivities(p: Array) -> dict[str, Array]:
    """Gradient (8,) of each reported quantity, in the record's unit, over the geometry's unknowns in mm and rad."""
    e, t = hypot(p[4], p[5]), hypot(p[6], p[7])
    unit = np.eye(UNKNOWNS)
    ex, ey = unit[4], unit[5]
    tx, ty = unit[6], unit[7]
    return {
        "phi_deg": degrees(1) * unit[0],
        "radial_position_mm": unit[1],
        "laser_plane_offset_mm": unit[2],
        "laser_plane_tilt_deg": degrees(1) * unit[3],
        "eccentricity_um": 1000.0 * (p[4] * ex + p[5] * ey) / max(e, 1e-9),
        "eccentricity_direction_deg": degrees(1) * (p[4] * ey - p[5] * ex) / max(e * e, 1e-12),
        "tilt_mrad": 1000.0 * (p[6] * tx + p[7] * ty) / max(t, 1e-9),
        "tilt_direction_deg": degrees(1) * (p[6] * ty - p[7] * tx) / max(t * t, 1e-12),
    }


def type_b(scan: Scan, artefact: Artefact, fit: Refined, static: tuple[StaticProfile, ...]) -> tuple[Input, ...]:
    """What certificate, data sheet and stand leave open and one scan can't see."""
    sensor, p = scan.stand.sensor, fit.solution.parameters
    eccentricity, lean = 1000.0 * hypot(p[4], p[5]), hypot(p[6], p[7])
    band = max(fit.segments.bands, key=lambda b: b.high - b.low)
    base = artefact.cylinders[fit.segments.bands[0].cylinder]
    # Off by U at either end of the visible line, independently; that slope turns the line and stretches the wave.
    slope = sqrt(2.0) / (band.high - band.low)
    lever = abs((band.low + band.high) / 2 - fit.model.height)  # from the sensor's origin, about which phi turns
    scale = SCALE_U if sensor.scale_U is None else sensor.scale_U
    height = HEIGHT_SEEN_U if fit.segments.shoulder_seen else HEIGHT_HIDDEN_U
    bearing = {"eccentricity_um": 1000.0}
    if eccentricity > 1.0:
        bearing["eccentricity_direction_deg"] = degrees(1000.0 / eccentricity)
    return (
        Input("diameter of the artefact", (base.diameter_U or 0.0) / 2, "normal", {"radial_position_mm": 0.5}),
        Input(linearity_name(sensor), linearity_of(sensor, static) / 2, "normal",
              {"phi_deg": degrees(slope), "radial_position_mm": hypot(1.0, lever * slope),
               "eccentricity_um": eccentricity * slope}),
        Input("scale of the sensor" + (" (assumed)" if sensor.scale_U is None else ""), scale / 2, "normal",
              {"eccentricity_um": eccentricity}),
        Input("height zero: the shoulder", height / 2, "rectangular",
              {"eccentricity_um": 1000.0 * lean, "laser_plane_offset_mm": abs(float(np.tan(p[3])))}),
        Input("temperature of the artefact (assumed)", TEMPERATURE_U / 2, "rectangular",
              {"radial_position_mm": EXPANSION * base.radius}),
        Input("table bearing, once per turn (assumed)", BEARING_U / 2, "normal", bearing),
        Input("zero of the table angle (assumed)", ANGLE_ZERO_U / 2, "rectangular",
              dict.fromkeys(DIRECTIONS, degrees(1))),
    )  # fmt: skip


def monte_carlo(
    p: Array, parts: dict[str, Array], inputs: tuple[Input, ...], trials: int = TRIALS, seed: int = 1
) -> dict[str, float]:
    """Half-width, in the record's unit, that holds 95.45 % of the trials about the estimate, by key.

    The inputs are drawn from their distributions and go through the quantities themselves, not their slopes: near
    e = 0 the eccentricity is no longer normal and its direction wraps.
    """
    rng = np.random.default_rng(seed)
    whole = np.asarray(sum(parts.values()))[:UNKNOWNS, :UNKNOWNS]
    drawn = p[:UNKNOWNS] + rng.standard_normal((trials, UNKNOWNS)) @ _root(whole).T
    values, best = _quantities(drawn), _quantities(p[None, :UNKNOWNS])
    off = {key: values[key] - best[key] for key in values}
    for i in inputs:
        noise = rng.standard_normal(trials) if i.distribution == "normal" else rng.uniform(-sqrt(3), sqrt(3), trials)
        for key, sensitivity in i.follows.items():
            off[key] = off[key] + i.u * sensitivity * noise
    for key in DIRECTIONS:
        off[key] = (off[key] + HALF_TURN) % (2 * HALF_TURN) - HALF_TURN
    return {key: float(np.quantile(np.abs(o), TWO_SIGMA)) for key, o in off.items()}


def _root(covariance: Array) -> Array:
    """A square root (n, n) of a covariance whose unknowns have very different units."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def _quantities(p: Array) -> dict[str, Array]:
    """The reported quantities (n,) of parameters (n, 8), in the record's units."""
    return {
        "phi_deg": np.degrees(p[:, 0]),
        "radial_position_mm": p[:, 1],
        "laser_plane_offset_mm": p[:, 2],
        "laser_plane_tilt_deg": np.degrees(p[:, 3]),
        "eccentricity_um": 1000.0 * np.hypot(p[:, 4], p[:, 5]),
        "eccentricity_direction_deg": np.degrees(np.arctan2(p[:, 5], p[:, 4])),
        "tilt_mrad": 1000.0 * np.hypot(p[:, 6], p[:, 7]),
        "tilt_direction_deg": np.degrees(np.arctan2(p[:, 7], p[:, 6])),
    }


def _from_fit(name: str, part: Array, gradient: Array, fit: Refined) -> Contribution:
    u = sqrt(max(float(gradient @ part[:UNKNOWNS, :UNKNOWNS] @ gradient), 0.0))
    if name == "noise":
        used = np.unique(fit.cells.group * len(fit.model.radii) + fit.cells.readings.cylinder).size
        return Contribution(name, K * u, u, "normal", 1.0, float(max(used - fit.model.size, 1)))
    known = [q.u for q in fit.priors if q.name == name]
    value = known[0] if known else u
    return Contribution(name, K * u, value, "normal", u / value if value else 0.0, inf)


def _from_input(i: Input, key: str) -> Contribution:
    return Contribution(i.name, K * i.u * i.follows[key], i.u, i.distribution, i.follows[key], i.dof)
