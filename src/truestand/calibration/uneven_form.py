"""Form that changes along the shaft: what a film of oil, dirt or a bent shaft leaves in the readings.

The model takes form for the same at every height. Where waves of a few undulations change from one stretch of a
cylinder to the next, the first one, which is the axis itself, changes as well, and nothing tells it from a cylinder
that stands elsewhere. It is taken to be as large as those that show.
"""

from collections.abc import Iterator

import numpy as np

from truestand.calibration.covariance import robust_correction
from truestand.calibration.refine import Refined
from truestand.core.arrays import Array

SOURCE = "form that changes along the shaft"
STRETCHES = 4
"""Of each cylinder, that are compared."""
SLOW, FAST = np.arange(2, 5), np.arange(26, 40)
"""Undulations next to the first one, and such as only noise has."""


def uneven_form(fit: Refined) -> Array:
    """Amplitude (cylinders,) mm, root mean square, of slow waves by which stretches of each cylinder differ."""
    readings, solution = fit.cells.readings, fit.solution
    _, height = fit.plane.to_uv(readings.x, readings.z)
    psi = fit.model.angle(solution.parameters, readings.angle)
    amplitudes = np.zeros(len(fit.model.radii))
    for k, band in enumerate(fit.segments.bands):
        part = np.floor((height - band.low) / band.length * STRETCHES)
        power = []
        for stretch in range(STRETCHES):
            on = (readings.cylinder == k) & (solution.weights > 0) & (part == stretch)
            if on.any():
                waves = np.exp(1j * np.multiply.outer(np.concatenate([SLOW, FAST]), psi[on]))
                w = fit.cells.weight[on]  # what is weighted down for its size is what is looked for
                power.append(np.square(2 * np.abs(waves @ (w * solution.residuals[on])) / w.sum()))
        if power:
            slow, fast = np.split(np.mean(power, axis=0), [SLOW.size])
            free = len(power) / max(len(power) - 1, 1)  # what all stretches share is in the form that was fitted
            amplitudes[k] = np.sqrt(max(float(slow.mean() - fast.mean()), 0.0) * free)
    return amplitudes


def covariance_of_uneven_form(fit: Refined, uneven: Array) -> Array:
    """Covariance (p, p) of the unknowns: each cylinder's axis is off by such a wave, as a whole and from end to end.

    ``uneven`` (cylinders,): mm, as ``uneven_form``.
    """
    moved = fit.following(np.stack(list(_axis_patterns(fit, uneven)), axis=1))
    return np.asarray(moved @ moved.T) * robust_correction(fit.cells, fit.solution) ** 2


def _axis_patterns(fit: Refined, uneven: Array) -> Iterator[Array]:
    """Residuals (n,) mm that one standard deviation of each cylinder's axis makes: along x and y, moved and leaning."""
    readings = fit.cells.readings
    _, height = fit.plane.to_uv(readings.x, readings.z)
    psi = fit.model.angle(fit.solution.parameters, readings.angle)
    for k, (band, amplitude) in enumerate(zip(fit.segments.bands, uneven, strict=True)):
        on = np.where(readings.cylinder == k, amplitude / np.sqrt(2.0), 0.0)
        lever = (height - band.middle) / (band.length / 2)
        for wave in (np.cos(psi), np.sin(psi)):
            yield on * wave
            yield on * wave * lever
