"""What the sensor sees of the shaft, with the shaft's wobble taken out: position across the axis over that along it.

In the laser plane, a turning eccentric shaft moves to and fro across its axis as a whole. So each profile is shifted
across the direction that is tried for the axis until it lies on the others; what remains is the outline of the shaft,
sharp enough to be held against its drawing. Medians all the way: spikes, ghosts and dirt on less than half don't count.
"""

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from truestand.core.arrays import Array, Mask
from truestand.core.errors import NotEnoughData
from truestand.core.frames import LaserPlane
from truestand.core.robust import medians, robust_sd
from truestand.core.scan import Scan

NEIGHBOUR_SLOPE = 4.0
"""Steepest surface, range over x, that a neighbouring reading still supports (76 degrees against the line)."""
SAMPLED_PROFILES = 400
LEAST_POINTS = 12
"""Readings a profile must show on average."""
MOST_VIEW_MM = 2000.0
"""No such sensor sees as far from the middle of its readings."""
LEAST_BIN_MM, READING_BIN = 0.1, 0.75
"""Along the axis; share of what lies between two readings of a profile, where that is more: in narrower bins,
readings of a sparse profile come and go with the wobble."""
PASSES = 3
MOST_SPREAD_MM = 0.1
"""Median deviation within a bin above which it shows no one surface."""
CHORD_MM = 1.2
"""Length of the pieces of profile whose directions are used. 10 um of noise turn one by 0.7 degrees."""
MOST_SAGITTA_MM = 0.06
"""How far the middle of a straight piece may lie beside its chord."""
MOST_LENGTH_RATIO = 6.0
"""A piece this many times as long as usual spans a gap."""
DIRECTION_STEP_RAD, NEAR_DIRECTION_RAD = np.radians(0.5), np.radians(3.0)
MOST_DIRECTIONS = 4
LEAST_CROWD_SHARE = 0.02
"""Share of the pieces that a direction must have."""
LEAST_SEEN_SHARE = 0.1
"""Readings in a bin, per profile, below which it is not seen."""


@dataclass(frozen=True, slots=True)
class Silhouette:
    """The outline along a direction: ``v`` (B,) mm along it, ``u`` (B,) mm across it, NaN where no surface is seen."""

    phi: float
    bin: float
    """mm from one ``v`` to the next."""
    v: Array
    u: Array
    shift: Array
    """(n,) mm by which each sampled profile was moved across."""

    @property
    def wobble(self) -> float:
        """Robust standard deviation of the shifts, mm: what moves turns with the table."""
        return robust_sd(self.shift - np.median(self.shift))

    @property
    def other_way_up(self) -> "Silhouette":
        """The same outline along the opposite direction."""
        return replace(self, phi=self.phi - pi, v=-self.v[::-1], u=self.u[::-1])


def sample(scan: Scan) -> Scan:
    """Profiles spread evenly over whole turns; x and z are NaN where no neighbour supports a reading.

    Raises:
        NotEnoughData: too few points.
    """
    whole = int(scan.profiles * max(int(scan.revolutions), 1) / max(scan.revolutions, 1.0))
    rows = np.unique(np.linspace(0, max(whole - 1, 0), SAMPLED_PROFILES).astype(np.intp))
    part = scan.taken(rows)
    good = supported(part.x, part.z)
    if np.count_nonzero(good) < LEAST_POINTS * rows.size:
        raise NotEnoughData(
            f"found {np.count_nonzero(np.isfinite(scan.z))} points in {scan.profiles} profiles, need a visible "
            "surface; check exposure, range and that the laser was on"
        )
    for values in (part.x, part.z):
        good &= np.abs(values - np.median(values[good])) < MOST_VIEW_MM
    return replace(part, x=np.where(good, part.x, np.nan), z=np.where(good, part.z, np.nan))


def supported(x: Array, z: Array) -> Mask:
    """Mask (N, M) of readings that a neighbour on the same profile supports.

    A surface continues from point to point; a spike or a ghost stands alone. Two of three random spikes next to each
    other would pass: these are for the robust fit to reject.
    """
    dx = np.abs(np.diff(x, axis=1))
    dz = np.abs(np.diff(z, axis=1))
    pitch = float(np.nanmedian(dx)) if np.isfinite(dx).any() else 0.0
    close = dz <= NEIGHBOUR_SLOPE * (dx + pitch)
    mask = np.zeros(z.shape, dtype=np.bool_)
    mask[:, :-1] |= close
    mask[:, 1:] |= close
    return mask


def directions(seen: Scan) -> list[float]:
    """Candidate directions of the axis (phi in 0..pi), the likeliest first: those of straight pieces of the profiles.

    The pieces are chords of about ``CHORD_MM`` mm whose middle reading lies on them; steps between surfaces can't turn
    them.
    """
    chord = _chords(seen)
    counts = np.bincount((chord / DIRECTION_STEP_RAD).astype(np.intp), minlength=round(pi / DIRECTION_STEP_RAD))
    window = np.ones(2 * round(NEAR_DIRECTION_RAD / DIRECTION_STEP_RAD) + 1)
    half = window.size // 2
    crowd = np.convolve(np.concatenate([counts[-half:], counts, counts[:half]]), window, mode="valid")
    peaks: list[float] = []
    for i in np.argsort(crowd)[::-1]:
        if len(peaks) == MOST_DIRECTIONS or crowd[i] < max(1.0, LEAST_CROWD_SHARE * chord.size):
            break
        at = (i + 0.5) * DIRECTION_STEP_RAD
        if all(abs((at - p + pi / 2) % pi - pi / 2) > 2 * NEAR_DIRECTION_RAD for p in peaks):
            peaks.append(_middle(chord, float(at)))
    return [p % pi for p in peaks]


def _chords(seen: Scan) -> Array:
    """Directions (n,) in 0..pi of straight pieces of all profiles."""
    pitch = float(np.nanmedian(np.hypot(np.diff(seen.x), np.diff(seen.z))))
    half = max(3, min(round(CHORD_MM / 2 / max(pitch, 1e-6)), seen.x.shape[1] // 4))
    x, z = seen.x, seen.z
    dx, dz = x[:, 2 * half :] - x[:, : -2 * half], z[:, 2 * half :] - z[:, : -2 * half]
    sagitta_x = x[:, half:-half] - (x[:, 2 * half :] + x[:, : -2 * half]) / 2
    sagitta_z = z[:, half:-half] - (z[:, 2 * half :] + z[:, : -2 * half]) / 2
    length = np.hypot(dx, dz)
    beside = np.abs(sagitta_x * dz - sagitta_z * dx) / np.maximum(length, 1e-9)
    straight = (beside < MOST_SAGITTA_MM) & (length < MOST_LENGTH_RATIO * half * pitch)
    return np.asarray(np.arctan2(dx[straight], dz[straight]) % pi)


def _middle(chord: Array, peak: float) -> float:
    """The median direction about a peak, noise being the same to both sides."""
    for reach in (2.0, 1.5, 1.0, 1.0):  # a peak may be as wide as the window that found it
        off = (chord - peak + pi / 2) % pi - pi / 2
        peak += float(np.median(off[np.abs(off) < reach * NEAR_DIRECTION_RAD]))
    return peak


def silhouette(seen: Scan, phi: float) -> Silhouette:
    """The outline along ``phi``, the wobble taken out."""
    u, v = LaserPlane(phi).to_uv(seen.x, seen.z)
    on = np.isfinite(u)
    low, high = np.quantile(v[on], [0.0005, 0.9995])
    bin_ = _bin(v)
    count = max(1, int((high - low) / bin_) + 1)
    cell = np.floor((v - low) / bin_, where=on, out=np.full(v.shape, -1.0)).astype(np.intp)
    on &= (cell >= 0) & (cell < count)
    row, _ = np.nonzero(on)
    cell, across = cell[on], u[on]
    shift = np.zeros(len(u))
    centre, count_seen = medians(cell, across, count)
    for _ in range(PASSES):
        usable = (count_seen >= LEAST_SEEN_SHARE * len(u)) & np.isfinite(centre)
        part = np.where(usable[cell], across - centre[cell], np.nan)
        offset, readings = medians(row[np.isfinite(part)], part[np.isfinite(part)], len(u))
        offset = np.where(readings >= LEAST_POINTS, offset, 0.0)
        shift = offset - np.mean(offset)
        centre, count_seen = medians(cell, across - shift[row], count)
    spread, _ = medians(cell, np.abs(across - shift[row] - centre[cell]), count)
    shown = (count_seen >= LEAST_SEEN_SHARE * len(u)) & (spread < MOST_SPREAD_MM)
    return Silhouette(phi, bin_, low + (np.arange(count) + 0.5) * bin_, np.where(shown, centre, np.nan), shift)


def _bin(v: Array) -> float:
    """mm along the axis for readings at ``v`` (n, M) mm."""
    apart = np.abs(np.diff(v, axis=1))
    known = apart[np.isfinite(apart)]
    return max(LEAST_BIN_MM, READING_BIN * float(np.median(known))) if known.size else LEAST_BIN_MM
