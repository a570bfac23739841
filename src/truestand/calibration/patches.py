"""Patches: stretches of a surface that lie higher or lower than the rest of a turn: dirt, a flat, a shallow keyway.

A series of waves follows dirt of 10 to 25 um on a third of one cylinder so closely that it is taken for form, and its
wave once a turn for the cylinder's axis. But form goes in waves, and a patch begins and ends, at once or over some
degrees. So both are looked for together, by orthogonal matching pursuit (Pati, Rezaiifar and Krishnaprasad 1993): of
what the slowest waves leave of a turn, the wave that explains most is taken out, until a patch does that explains most
of what is left, and more than two waves would, which have as many unknowns; and either more than three, or the shaft's
slow waves as well.
"""

from dataclasses import dataclass
from functools import cache
from math import sqrt, tau

import numpy as np
from numpy.typing import NDArray

from truestand.calibration.edges import COUNT, SECTORS, around, stretch_of
from truestand.core.arrays import Array, Mask
from truestand.core.harmonics import Harmonics, fit_harmonics
from truestand.core.robust import robust_sd

SLOWEST = 6
"""Waves a turn that are the shaft's whatever patches there are."""
FASTEST = 60
"""Faster ones have little of a patch."""
MOST_WAVES = 12
"""That are taken out."""
SOFT = (2.0, 6.0, 12.0, 20.0)
"""Degrees over which an edge rises."""
NARROWEST, WIDEST = 4.0, 162.0
"""Degrees, at half their height."""
STEP = 1 / 3
"""Of its softness, by which the widths of a patch are tried; not less than a stretch of the turn."""
MOST = 0.6
"""Share of what is left (of its square) that a patch has to explain."""
RIVALS = 2
"""Waves that together have to explain less: they have as many unknowns as a patch (place, width, softness, height)."""
OVAL, AGREE = 2, 0.3
"""What is left looks like a wide, soft patch where form falls steadily, too: so it also has to explain the slow waves
beyond the oval, of whose squares this share may stay; or as much as a third rival.
"""
LEAST_MM, SIGNIFICANT = 0.002, 12.0
"""mm, and standard deviations: lower ones are never patches. Forty thousand are looked at (chance makes 5 of that), and
neighbouring stretches err alike.
"""
MOST_PATCHES = 8
BESIDE = 2.0
"""Degrees at either end of a patch that are not trusted with it."""
MOST_OTHER = 0.5
"""Share of a surface that may be other than the shaft."""
ALIKE = 0.25
"""Share of its height by which a patch may differ from that of another surface and be the table's."""
LEAST_LEFT = 1e-4
"""Share of a patch (of its square) that waves leave and that is seen, for anything to be told of it."""


def patches(angle: Array, traces: Array, radii: tuple[float, ...]) -> Mask:
    """Stretches of table angle (bands, SECTORS) in which a surface lies higher or lower than on most of a turn.

    ``traces``: (bands, n) mm over table ``angle`` (n,) rad, of cylinders of these radii (mm). What another surface has
    at the same angle, as high, is left in: a table's angle that jumps makes such.
    """
    return np.stack([_patches_of(k, angle, traces, radius) for k, radius in enumerate(radii)])


@dataclass(frozen=True, slots=True)
class _Patch:
    """A stretch of a surface that lies apart, with edges that rise over some degrees."""

    middle: float
    """rad, on the shaft."""
    width: float
    """Degrees, at half its height."""
    soft: float
    """Degrees over which an edge rises."""
    height: float
    """mm"""

    def shape(self, place: Array) -> Array:
        """Its shape (n,), 0 to 1, at places (n,) rad on the shaft."""
        return _shape(self._off(place), self.width, self.soft)

    def covers(self, place: Array) -> Mask:
        """Whether it covers places (n,) rad, and what lies beside its ends."""
        return self._off(place) < (self.width + self.soft) / 2 + BESIDE

    def _off(self, place: Array) -> Array:
        return np.asarray(np.degrees(np.abs(np.angle(np.exp(1j * (place - self.middle))))))


def _shape(off: Array, width: float, soft: float) -> Array:
    """Of a patch of unit height, so many degrees off its middle."""
    return np.clip(((width + soft) / 2 - off) / soft, 0.0, 1.0)


def _patches_of(k: int, angle: Array, traces: Array, radius: float) -> Mask:
    """Those (SECTORS,) of one surface."""
    towards, sideways = _travel(angle, traces[k])
    ahead, middles = _ahead(sideways(angle), radius), _middles(COUNT)
    place, trace = angle + ahead, traces[k] - towards(angle) - radius * np.cos(ahead)
    mask = np.zeros(COUNT, dtype=np.bool_)
    for _ in range(MOST_PATCHES):
        patch = _patch_of(angle, place, np.where(mask[stretch_of(place)], np.nan, trace))
        if patch is None or _is_shared(k, patch.shape(place), angle, traces):
            break
        more = mask | patch.covers(middles)
        if more.mean() > MOST_OTHER:
            break
        mask = more
    sectors = _middles(SECTORS)
    return mask[stretch_of(sectors + _ahead(sideways(sectors), radius))]


def _ahead(sideways: Array, radius: float) -> Array:
    """By how much (rad) the place on the shaft that is read runs ahead of the table's angle; sideways: mm."""
    return np.asarray(np.arcsin(np.clip(sideways / radius, -1.0, 1.0)))


def _travel(angle: Array, trace: Array) -> tuple[Harmonics, Harmonics]:
    """A shaft's travel (mm over table angle) towards the sensor and sideways, of a trace (n,) mm over table ``angle``.

    Sideways it brings other places of the shaft into view; over table angle a wave of form would spread over the
    spectrum.
    """
    fitted = fit_harmonics(angle, trace, (1, 2, 3))
    c, s = fitted.cos[:1], fitted.sin[:1]
    return Harmonics((1,), 0.0, c, s), Harmonics((1,), 0.0, -s, c)


def _patch_of(angle: Array, place: Array, trace: Array) -> _Patch | None:
    """The patch that stands out of a trace (n,) mm over table ``angle`` and ``place`` on the shaft (n,) rad."""
    on, time = np.isfinite(trace), _time(trace)
    slow = _waves_at(place, SLOWEST)
    design = np.column_stack([slow, np.ones(time.size), time])
    fitted = _fitted(design, trace)
    ones = np.ones(np.count_nonzero(on))
    turn, drift, ahead = (around(place[on], ones, v[on]) for v in (trace - design @ fitted, time, place - angle))
    return _patch_in(turn + _waves_at(_middles(COUNT), SLOWEST) @ fitted[: slow.shape[1]], drift, ahead)


def _middles(count: int) -> Array:
    """Of so many stretches of a turn, rad."""
    return (np.arange(count, dtype=np.float64) + 0.5) * (tau / count)


def _time(trace: Array) -> Array:
    """Of the samples (n,) of a trace, 0 to 1."""
    return np.linspace(0.0, 1.0, trace.size)


def _waves_at(angle: Array, most: int) -> Array:
    """Waves of 1 to ``most`` a turn at angles (n,) rad: (n, 2 most)."""
    phase = np.multiply.outer(angle, np.arange(1, most + 1))
    return np.hstack([np.cos(phase), np.sin(phase)])


def _is_shared(k: int, shape: Array, angle: Array, traces: Array) -> bool:
    """Whether another trace than the ``k``-th has a patch of this ``shape`` (n,) as well, as high."""
    design = np.column_stack([shape, np.ones(shape.size), _time(shape), _waves_at(angle, SLOWEST)])
    heights = np.array([_fitted(design, trace)[0] for trace in traces])
    return bool((np.abs(np.delete(heights, k) - heights[k]) < ALIKE * abs(heights[k])).any())


def _fitted(design: Array, trace: Array) -> Array:
    """Coefficients (columns,) of a ``design`` (n, columns) in a trace (n,), where it is seen."""
    seen = np.isfinite(trace)
    return np.asarray(np.linalg.lstsq(design[seen], trace[seen], rcond=None)[0])


def _patch_in(turn: Array, drift: Array, ahead: Array) -> _Patch | None:
    """The patch that stands out of a ``turn`` (n,) mm of the shaft, NaN where nothing is seen; None: there is none.

    ``drift`` (n,): what grows steadily over the scan; ``ahead`` (n,) rad: by which the place on the shaft runs ahead of
    the table's angle.
    """
    seen, place = np.isfinite(turn), _middles(turn.size)
    # The table's bearing passes with its angle.
    waves = np.stack([_waves(place, seen), _waves(place - ahead, seen)], axis=1)
    oval = waves[: OVAL + 1, 0].reshape(-1, turn.size)[1:]  # the first sine is none
    slow = waves[OVAL + 1 : SLOWEST + 1, 0].reshape(-1, turn.size)
    beyond_oval = _Left.of(turn, _shapes(turn.size)).without(np.vstack([np.where(seen, drift, 0.0), oval]))
    left, waves = beyond_oval.without(slow), waves[SLOWEST + 1 :]
    for _ in range(MOST_WAVES):
        by_waves = left.explained_by(waves)
        patch, explained = left.best_patch()
        third, *rivals = np.sort(by_waves.max(axis=1))[-RIVALS - 1 :]
        noise = robust_sd(np.diff(left.values[seen], 2)) / sqrt(6.0)  # a value's share of a second difference
        most = MOST * (left.squares - noise**2 * np.count_nonzero(seen))
        stands_out = abs(patch.height) > LEAST_MM and explained > max(most, sum(rivals), (SIGNIFICANT * noise) ** 2)
        if stands_out and (explained > third + sum(rivals) or beyond_oval.has(patch, slow)):
            return patch
        left = left.without(waves[np.unravel_index(np.argmax(by_waves), by_waves.shape)])
    return None


@dataclass(frozen=True, slots=True)
class _Shapes:
    """Patches of unit height about the first of n stretches."""

    width: Array
    soft: Array
    """(k,) degrees."""
    size: Array
    """(k,): sum of the squares of their heights."""
    spectra: NDArray[np.complex128]
    """(k, n // 2 + 1): of their heights,"""
    of_squares: NDArray[np.complex128]
    """and of the squares of these."""


@dataclass(frozen=True, slots=True)
class _Left:
    """What is left of a turn without some waves."""

    values: Array
    """(n,) mm, 0 where nothing is seen."""
    basis: Array
    """(n, m): the waves, orthonormal where it is seen."""
    sizes: Array
    """(k, n): sum of the squares of what they leave of each patch at each place."""
    shapes: _Shapes

    @classmethod
    def of(cls, turn: Array, shapes: _Shapes) -> "_Left":
        """All of it."""
        seen = np.isfinite(turn)
        sizes = _inner(seen.astype(np.float64), shapes.of_squares)
        return cls(np.where(seen, turn, 0.0), np.zeros((turn.size, 0)), sizes, shapes)

    @property
    def squares(self) -> float:
        """Their sum, mm2."""
        return float(self.values @ self.values)

    def without(self, waves: Array) -> "_Left":
        """What further ``waves`` (j, n) leave."""
        further, _ = np.linalg.qr(waves.T - self.basis @ (self.basis.T @ waves.T))
        explained = sum(np.square(_inner(column, self.shapes.spectra)) for column in further.T)
        values = self.values - further @ (further.T @ self.values)
        return _Left(values, np.hstack([self.basis, further]), self.sizes - explained, self.shapes)

    def explained_by(self, waves: Array) -> Array:
        """How much of its square each of the ``waves`` (..., 2, n) explains, mm2."""
        known = waves @ self.basis
        left = waves @ waves.swapaxes(-1, -2) - known @ known.swapaxes(-1, -2)
        along = waves @ self.values
        alike = LEAST_LEFT * self.values.size * np.eye(2)  # of a wave that is known, nothing is left
        return np.asarray(np.einsum("...i,...ij,...j->...", along, np.linalg.inv(left + alike), along))

    def has(self, patch: _Patch, waves: Array) -> bool:
        """Whether a patch explains most of the ``waves`` (j, n), too."""
        values = self.values - patch.height * patch.shape(_middles(self.values.size))
        flat, _ = np.linalg.qr(waves.T - self.basis @ (self.basis.T @ waves.T))
        return float(np.square(flat.T @ values).sum()) < AGREE * float(np.square(flat.T @ self.values).sum())

    def best_patch(self) -> tuple[_Patch, float]:
        """The patch that explains most, and how much of its square, mm2."""
        along = _inner(self.values, self.shapes.spectra)
        told = self.sizes > LEAST_LEFT * self.shapes.size[:, None]
        explained = np.divide(np.square(along), self.sizes, out=np.zeros_like(along), where=told)
        k, at = np.unravel_index(np.argmax(explained), explained.shape)
        middle, height = _middles(self.values.size)[at], along[k, at] / self.sizes[k, at]
        patch = _Patch(float(middle), float(self.shapes.width[k]), float(self.shapes.soft[k]), float(height))
        return patch, float(explained[k, at])


def _inner(values: Array, spectra: NDArray[np.complex128]) -> Array:
    """Sum of ``values`` (n,) times each shape at each place (k, n)."""
    return np.asarray(np.fft.irfft(np.fft.rfft(values) * np.conj(spectra), values.size, axis=1))


def _waves(angle: Array, seen: Mask) -> Array:
    """Waves up to the fastest at angles (n,), 0 where nothing is seen, sines and cosines: (waves, 2, n)."""
    phase = np.multiply.outer(np.arange(FASTEST + 1), np.where(seen, angle, 0.0))
    return np.stack([np.sin(phase), np.cos(phase)], axis=1) * seen


@cache
def _shapes(count: int) -> _Shapes:
    """All patches that are looked for."""
    middle = np.arange(count, dtype=np.float64) * (360.0 / count)
    off = np.minimum(middle, 360.0 - middle)
    sizes = [
        (width, soft)
        for soft in SOFT
        for width in np.arange(max(NARROWEST, soft), WIDEST, max(360.0 / count, STEP * soft)).tolist()
    ]
    heights = np.array([_shape(off, *size) for size in sizes])
    width, soft = np.array(sizes).T
    return _Shapes(width, soft, np.square(heights).sum(axis=1), np.fft.rfft(heights), np.fft.rfft(np.square(heights)))
