"""Height zero: the shoulder face between the first two cylinders, where the scan shows it."""

from dataclasses import replace
from math import cos, sin

import numpy as np

from truestand.core.artefact import Artefact
from truestand.core.fit import gauss_newton
from truestand.core.frames import facing, shaft_from_rotor
from truestand.core.refine import Refined, sectors
from truestand.core.scan import Scan

SAMPLED_PROFILES = 1000
FACE_REACH = 0.3
"""mm: half-height of the slab in which the face's points lie once the model is known."""


def with_height(scan: Scan, artefact: Artefact, fit: Refined) -> Refined:
    """The fit with height zero moved to the median of the shoulder face's points; as it was where none are seen."""
    if not fit.segments.shoulder_seen:
        return fit
    heights = face_heights(scan, artefact, fit)
    if heights.size < 50:
        return replace(fit, segments=replace(fit.segments, shoulder_seen=False))
    shift = float(np.median(heights))
    for _ in range(5):  # the median of the slab, again with the slab where it should be
        near = heights[np.abs(heights - shift) < FACE_REACH / 2]
        shift = float(np.median(near)) if near.size else shift
    model = replace(fit.model, height=fit.model.height - shift)
    bands = tuple(replace(b, low=b.low - shift, high=b.high - shift) for b in fit.segments.bands)
    segments = replace(fit.segments, bands=bands, height=model.height)
    solution = gauss_newton(model, fit.cells, fit.solution.parameters, fit.priors, sectors(scan, fit.grid, fit.cells))
    return replace(fit, model=model, segments=segments, solution=solution)


def face_heights(scan: Scan, artefact: Artefact, fit: Refined) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Heights (n,) mm in C of readings on the shoulder face, of evenly spread profiles."""
    p = fit.solution.parameters
    rows = np.unique(np.linspace(0, scan.profiles - 1, SAMPLED_PROFILES).astype(np.intp))
    x, z = scan.x[rows], scan.z[rows]
    u = facing(p[0]) * (cos(p[0]) * x - sin(p[0]) * z) + p[1]
    v = sin(p[0]) * x + cos(p[0]) * z + fit.model.height
    angle = fit.model.angle(p, scan.angle[rows])[:, None]
    c, s = np.cos(angle), np.sin(angle)
    y, level = p[2] + sin(p[3]) * v, cos(p[3]) * v
    pose = shaft_from_rotor(*p[4:8])
    in_shaft = [
        pose.rotation[i, 0] * (c * u + s * y) + pose.rotation[i, 1] * (c * y - s * u) + pose.rotation[i, 2] * level
        + pose.translation[i]
        for i in range(3)
    ]  # fmt: skip
    radius = np.hypot(in_shaft[0], in_shaft[1])
    inner, outer = sorted(c.radius for c in artefact.cylinders[:2])
    margin = min(0.5, 0.2 * (outer - inner))
    with np.errstate(invalid="ignore"):
        on = (radius > inner + margin) & (radius < outer - margin) & (np.abs(in_shaft[2]) < FACE_REACH)
    return np.asarray(in_shaft[2][on])
