"""Levenberg-Marquardt to the last digit, and what it says of the parameters."""

from collections.abc import Callable

import numpy as np

from truestand.core.arrays import Array

Residuals = Callable[[Array], tuple[Array, Array]]
"""Parameters (m,) to residuals (n,) and their Jacobian (n, m)."""

MOST_STEPS = 300
SETTLED = 1e-15
"""Relative to the feature's size: a step that changes nothing a double can hold."""


def least_squares(residuals: Residuals, start: Array, scale: Array) -> tuple[Array, Array, Array]:
    """Levenberg-Marquardt with Marquardt's scaling to the last digit: parameters, residuals, Jacobian.

    ``scale`` (m,): size of each parameter, against which a step is still.
    """
    q = start.copy()
    r, J = residuals(q)
    damping = 1e-6
    for _ in range(MOST_STEPS):
        step = _damped_step(J, r, damping)
        tried, (r_new, J_new) = q + step, residuals(q + step)
        if r_new @ r_new <= (r @ r) * (1.0 + 1e-14):
            q, r, J = tried, r_new, J_new
            damping = damping / 10.0 if damping > 1e-14 else 0.0
        else:
            damping = max(10.0 * damping, 1e-12)
        if np.all(np.abs(step) <= SETTLED * scale) or damping > 1e12:
            break
    return q, r, J


def _damped_step(J: Array, r: Array, damping: float) -> Array:
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    Q, R = np.linalg.qr(J / size)
    rows = np.vstack([R, np.sqrt(damping) * np.eye(R.shape[1])])
    right = np.concatenate([-(Q.T @ r), np.zeros(R.shape[1])])
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-15)[0] / size)


def inverse_normal(J: Array) -> Array:
    """(J^T J)^-1; infinite variance stays finite but huge where the points leave a parameter open."""
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    scaled = J / size
    return np.asarray(np.linalg.pinv(scaled.T @ scaled, rcond=1e-14, hermitian=True) / np.outer(size, size))
