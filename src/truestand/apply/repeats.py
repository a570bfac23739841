"""What another calibration of the same artefact repeats: how far two may differ where nothing has moved."""

from cmath import phase, rect
from collections import defaultdict
from math import hypot, radians, sqrt

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.views import AZIMUTH_KEY
from truestand.core.arrays import Array
from truestand.core.assumptions import K
from truestand.core.calibration import TABLE_BEARING, Calibration
from truestand.core.frames import ECCENTRICITY
from truestand.uncertainty.influence import unknowns_of

Waves = NDArray[np.complex128]

FORM_WAVES = (2, 3, 4)
"""A turn, by which two scans know the shaft again: the neighbours of the one that tells how its steps run."""
FORM_SURE = 5.0
"""Times the noise of a scan, all readings of a profile erring alike, by which these waves differ for certain,"""
LEAST_FORM_MM = 1e-4
"""and mm by which they always may."""
LITTLE_TURN = 0.02
"""rad: what a shaft turned by no more does to its steps' axes is less than they are known to, by far."""
OF_ALL = 0.5
"""Share of a surface's waves by which it may change for reasons that are not the shaft's."""


def repeatability(old: Calibration, new: Calibration) -> Array:
    """Covariance (8, 8) of the difference of two calibrations of one artefact: noise, and what else acts on each.

    Mounting, certificate and drawing are the same for both, and cancel as far as both scans weigh them alike.
    """
    noise = old.repeatability if old.repeatability.size else new.repeatability
    whole = old.covariance if old.covariance.size else new.covariance
    return noise + new.repeatability + least_difference(whole - noise, new.covariance - new.repeatability)


def azimuth_repeatability(old: Calibration, new: Calibration) -> float:
    """The same of a view's azimuth (rad, standard), where the new calibration has one; old records may tell less."""
    assert new.azimuth_repeats is not None
    noise = new.azimuth_repeats if old.azimuth_repeats is None else old.azimuth_repeats
    if AZIMUTH_KEY not in old.uncertainty:
        return hypot(noise, new.azimuth_repeats)
    alike = [
        sqrt(max((radians(c.uncertainty[AZIMUTH_KEY].U) / K) ** 2 - own**2, 0.0))
        for c, own in ((old, noise), (new, new.azimuth_repeats))
    ]
    return hypot(noise, new.azimuth_repeats, alike[1] - alike[0])


def least_difference(a: Array, b: Array) -> Array:
    """Covariance (n, n) of the difference of two estimates that err by ``a`` and ``b`` (n, n) from the same causes.

    The causes act on both as much alike as these allow (Olkin and Pukelsheim 1982): A - B W, with A A' = a, B B' = b
    and the rotation W that brings B next to A.
    """
    scale = np.sqrt(np.maximum(np.maximum(np.diag(a), np.diag(b)), 1e-300))
    roots = []
    for covariance in (a, b):
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        roots.append(vectors * np.sqrt(np.maximum(values, 0.0)))
    one, other = roots
    out, _, back = np.linalg.svd(other.T @ one)  # the orthogonal Procrustes problem
    left = (one - other @ out @ back) * scale[:, None]
    return np.asarray(left @ left.T)


def told_together(old: Calibration, new: Calibration) -> Array:
    """Covariance (8, 8) of what several views have told together of one and its own scan doesn't: by as much one knows
    more than the other, in the directions in which it does (Hausman 1978).
    """
    scale = np.sqrt(np.maximum(np.diag(new.covariance), 1e-300))
    values, vectors = np.linalg.eigh((new.covariance - old.covariance) / np.outer(scale, scale))
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T * np.outer(scale, scale))


def form_change(old: Calibration, new: Calibration, plane_told: bool) -> float:
    """mm by which the slowest waves of the surfaces are others than they were; 0 within noise.

    A shaft that turned in its clamp, dirt and wear change them, and with them the one wave a turn by which the steps'
    axes are known. What turns by little, or as the shaft's eccentricity does, is the same shaft under another zero of
    the angle. What the bearing or the sensor do anew each time is the same on all surfaces, and under a laser plane
    that is not told form lies elsewhere on each: these count only where they are half of what there was.
    """
    before, now = _slow_waves(old), _slow_waves(new)
    if not before or before.keys() != now.keys():
        return 0.0
    is_now = np.array([now[surface] for surface in before])
    changes = []
    for turn in (0.0, _turned(old, new)):
        was = np.array(list(before.values())) * np.exp(-1j * np.array(FORM_WAVES) * turn)
        moved = _beyond_little_turn(is_now - was, was)
        half = OF_ALL * _sizes(was)
        apart, alike = _sizes(moved - moved[0]), float(_sizes(moved)[0])
        certain = apart if plane_told else apart * (apart > half.max())
        changes.append(max(float(certain.max()), alike * (alike > half[0])))
    noise = hypot(*(c.residuals.rms / sqrt(c.scan.profiles) for c in (old, new) if c.residuals and c.scan))
    return change if (change := min(changes)) > max(FORM_SURE * noise, LEAST_FORM_MM) else 0.0


def _turned(old: Calibration, new: Calibration) -> float:
    """rad by which the eccentricity has turned."""
    before, now = (complex(*unknowns_of(c)[0][ECCENTRICITY]) for c in (old, new))
    return phase(now * before.conjugate())


def _beyond_little_turn(moved: Waves, was: Waves) -> Waves:
    """What a turn of all by up to ``LITTLE_TURN`` leaves of how waves have ``moved``, both (surfaces, 3)."""
    slope = -1j * np.array(FORM_WAVES) * was
    turn = float(np.vdot(slope, moved).real) / max(float(np.vdot(slope, slope).real), 1e-300)
    return np.asarray(moved - max(-LITTLE_TURN, min(turn, LITTLE_TURN)) * slope)


def _sizes(waves: Waves) -> Array:
    return np.asarray(np.linalg.norm(waves, axis=1))


def _slow_waves(calibration: Calibration) -> dict[str, Waves]:
    """How each surface stands out over the table's angle by form and bearing: (3,) mm, Re(w exp(-i n angle))."""
    waves: dict[str, Waves] = defaultdict(lambda: np.zeros(len(FORM_WAVES), dtype=np.complex128))
    for h in calibration.harmonics:
        if h.upr in FORM_WAVES:
            # At table angle theta the sensor sees a surface at -theta.
            sense = 1.0 if h.surface == TABLE_BEARING else -1.0
            waves[h.surface][FORM_WAVES.index(h.upr)] = rect(h.amplitude, sense * h.phase)
    bearing = waves.pop(TABLE_BEARING, 0.0)
    return {surface: form + bearing for surface, form in waves.items()}
