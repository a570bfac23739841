"""Errors of a real gear against its drawing: mm and rad; deviations along the base tangent, positive = excess material.

Teeth have numbers (from 1, counter-clockwise, tooth 1 the first one whose centre is at polar angle >= 0 at
mid-face); the left flank of a tooth is the one at the larger polar angle.
"""

from dataclasses import dataclass, field
from math import radians
from typing import Literal

Flank = Literal["left", "right"]


@dataclass(frozen=True, slots=True)
class Dent:
    """A smooth bowl depth (1 - (d / radius)²)² on one flank, d the distance over roll length and height."""

    tooth: int
    flank: Flank
    roll_length: float
    height: float
    """Of its middle, in C."""
    radius: float
    depth: float
    """Positive into the material; negative: a bump."""


@dataclass(frozen=True, slots=True)
class Chip:
    """The tip of a tooth broken off between two heights, over the tooth's whole thickness, to a radial depth."""

    tooth: int
    bottom: float
    top: float
    depth: float


@dataclass(frozen=True, slots=True)
class Worn:
    """Material missing between two roll lengths and two heights of a flank: a groove, a scratch, a worn band.

    Full depth but for smooth edges of width ``edge`` inside all four sides.
    """

    tooth: int | None
    """None: this flank of every tooth."""
    flank: Flank
    rolls: tuple[float, float]
    heights: tuple[float, float]
    """In C."""
    depth: float
    """Positive into the material; negative: material on top."""
    edge: float = 0.1


@dataclass(frozen=True, slots=True)
class Scratch:
    """A straight groove between two places of a flank, in any direction: depth cos²(pi d / width), d from its line."""

    tooth: int
    flank: Flank
    start: tuple[float, float]
    """Roll length and height in C."""
    end: tuple[float, float]
    width: float
    depth: float
    """Positive into the material; negative: a ridge."""


@dataclass(frozen=True, slots=True)
class FlankErrors:
    """Form of all left or all right flanks."""

    profile_slope: float = 0.0
    """Rise from the root form point to the tip, zero in the middle."""
    helix_slope: float = 0.0
    """Rise from the lower to the upper end of the face, zero in the middle."""


@dataclass(frozen=True, slots=True)
class GearErrors:
    """All errors of a real gear; the default has none."""

    phase: float = radians(3.0)
    """Polar angle in C of a tooth's centre at mid-face."""
    seed: int = 0
    """Of the random pitch errors."""
    pitch: float = 0.0
    """Standard deviation of the independent position error of each flank, tangential at the reference circle."""
    pitch_left: tuple[float, ...] = ()
    """Position error of every tooth's left flank, tangential at the reference circle, positive ccw; () = none."""
    pitch_right: tuple[float, ...] = ()
    eccentricity: float = 0.0
    """Offset of the toothing against the bore."""
    eccentricity_direction: float = 0.0
    """Its azimuth in C."""
    thickness: float = 0.0
    """Transverse, at the reference circle, half on each flank."""
    left: FlankErrors = field(default_factory=FlankErrors)
    right: FlankErrors = field(default_factory=FlankErrors)
    profile_wave: float = 0.0
    """Amplitude of a sine over the roll length from the root form point to the tip."""
    profile_waves: float = 1.0
    profile_crowning: float = 0.0
    """Material missing at root form point and tip, growing with the square from the middle."""
    helix_crowning: float = 0.0
    """Material missing at both ends of the face."""
    feed_marks: float = 0.0
    """Amplitude of a wave over all flanks alike,"""
    feed_mark_spacing: float = 2.0
    """mm of height from crest to crest,"""
    feed_mark_slant: float = 0.0
    """and mm of height by which its crests fall over a mm of roll length."""
    dents: tuple[Dent, ...] = ()
    worn: tuple[Worn, ...] = ()
    scratches: tuple[Scratch, ...] = ()
    chips: tuple[Chip, ...] = ()
    missing: tuple[int, ...] = ()
    """Numbers of the teeth that are not there."""
