"""The estimate weighed against how well the laser plane was mounted, and the covariance that goes with it.

The fit reads offset d and tilt alpha from how the two steps' first harmonics differ, as if the steps were coaxial. What
the certificate leaves open on coaxiality makes that reading uncertain, the more so the smaller the eccentricity. So
the reading (d, alpha) is combined with the mounting prior, each with its covariance, and the other unknowns follow.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truestand.core.fit import Prior, Solution, covariance
from truestand.core.model import GEOMETRY
from truestand.core.priors import MOUNTING

Array = NDArray[np.float64]

PLANE = (GEOMETRY.index("plane_offset"), GEOMETRY.index("plane_tilt"))


@dataclass(frozen=True, slots=True)
class Posterior:
    """Parameters (p,) and their covariance (p, p) by source; the sum of the parts is the whole."""

    parameters: Array
    parts: dict[str, Array]

    @property
    def covariance(self) -> Array:
        """The whole covariance."""
        return np.asarray(sum(self.parts.values()))


def weigh(solution: Solution, priors: tuple[Prior, ...]) -> Posterior:
    """Combine the reading of the laser plane with its mounting prior: Kalman's update of two numbers."""
    parts = covariance(solution, priors)
    whole = np.asarray(sum(parts.values()))
    plane = np.ix_(PLANE, PLANE)
    reading = whole[plane] - parts[MOUNTING][plane]
    mounting = np.diag([next(q.u for q in priors if q.name == MOUNTING and i in q.index) ** 2 for i in PLANE])
    gain = mounting @ np.linalg.inv(mounting + reading)
    follow = _followers(solution)
    move = follow @ (gain - np.eye(2))
    transfer = np.eye(whole.shape[0])
    transfer[:, PLANE] += move
    weighed = {name: transfer @ part @ transfer.T for name, part in parts.items()}
    weighed[MOUNTING] = weighed[MOUNTING] + move @ mounting @ move.T
    return Posterior(transfer @ solution.parameters, weighed)


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
