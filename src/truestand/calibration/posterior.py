"""The estimate weighed against how well the laser plane was mounted, and the covariance that goes with it.

The fit reads offset d and tilt alpha from how the two steps' first harmonics differ, as if the steps were coaxial. What
the certificate leaves open on coaxiality makes that reading uncertain, the more so the smaller the eccentricity. So
the reading (d, alpha) is combined with the mounting prior, each with its covariance, and the other unknowns follow.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.estimate import PLANE, Prior, Solution, covariance, solve
from truestand.calibration.priors import MOUNTING

Array = NDArray[np.float64]

BARELY = 1e-2
"""Share of the mounting prior's hold that stays on, so that a plane that nobody sees has a number at all."""


@dataclass(frozen=True, slots=True)
class Posterior:
    """Parameters (p,) and their covariance (p, p) by source; the sum of the parts is the whole."""

    parameters: Array
    parts: dict[str, Array]

    @property
    def covariance(self) -> Array:
        """The whole covariance."""
        return np.asarray(sum(self.parts.values()))


def weigh(solution: Solution, priors: tuple[Prior, ...], told: bool = True) -> Posterior:
    """Combine the reading of the laser plane with its mounting prior: Kalman's update of two numbers.

    ``told`` is False where the shaft can't tell the plane at all: then only the mounting counts.

    The fit was held by that prior at the model's floor, to keep it from running away under a centred shaft; that hold
    is taken off first, so that the prior counts once, against what the reading is really worth.
    """
    solution, others = _released(solution, priors)
    parts = covariance(solution, others)
    whole = np.asarray(sum(parts.values()))
    reading = whole[np.ix_(PLANE, PLANE)]
    mounting = np.diag([next(q.u for q in priors if q.name == MOUNTING and i in q.index) ** 2 for i in PLANE])
    gain = mounting @ np.linalg.inv(mounting + reading) if told else np.zeros((2, 2))
    follow = _followers(solution)
    move = follow @ (gain - np.eye(2))
    transfer = np.eye(whole.shape[0])
    transfer[:, PLANE] += move
    weighed = {name: transfer @ part @ transfer.T for name, part in parts.items()}
    weighed[MOUNTING] = move @ mounting @ move.T
    return Posterior(transfer @ solution.parameters, weighed)


def _released(solution: Solution, priors: tuple[Prior, ...]) -> tuple[Solution, tuple[Prior, ...]]:
    """The solution without the mounting prior, one linear step away, and the other priors."""
    hold = np.zeros(solution.parameters.size)
    for q in priors:
        if q.name == MOUNTING:
            hold[list(q.index)] = q.tightness * (1.0 - BARELY)
    information = solution.information - np.diag(hold)
    step = solve(information, hold * solution.parameters)
    others = tuple(q for q in priors if q.name != MOUNTING)
    return replace(solution, parameters=solution.parameters + step, information=information), others


def _followers(solution: Solution) -> Array:
    """How every unknown follows the laser plane's two, (p, 2), from the normal matrix."""
    size = solution.parameters.size
    others = [i for i in range(size) if i not in PLANE]
    matrix = solution.information
    scale = 1.0 / np.sqrt(np.diag(matrix))
    scaled = matrix * scale[:, None] * scale[None, :]
    inner = np.linalg.lstsq(scaled[np.ix_(others, others)], scaled[np.ix_(others, PLANE)], rcond=1e-13)[0]
    follow = np.zeros((size, 2))
    follow[others] = -inner * scale[others][:, None] / scale[list(PLANE)][None, :]
    follow[list(PLANE)] = np.eye(2)
    return follow
