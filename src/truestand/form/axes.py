"""Axes in space: frames along them, points seen about them, and directions that cover a hemisphere."""

import numpy as np

from truestand.core.arrays import Array


def upright(direction: Array) -> Array:
    """The same axis with its largest component positive."""
    sign = np.sign(direction[int(np.argmax(np.abs(direction)))])
    return np.asarray(direction * (sign or 1.0))


def frame_along(direction: Array) -> Array:
    """Rows (3, 3): a right-handed orthonormal frame whose last axis is ``direction``."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(helper, direction)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(direction, first), direction])


def frame_tilted(frame: Array, a: float, b: float) -> Array:
    """The frame whose last axis is (a, b, 1) in the old one."""
    axis = np.array([a, b, 1.0]) @ frame
    return frame_along(axis / np.linalg.norm(axis))


def about_axis(away: Array, a: float, b: float) -> tuple[Array, Array, Array, Array, Array]:
    """Points (n, 3) mm, counted from a point of the axis along (a, b, 1): the axis as a unit vector, its slopes (2, 3)
    over a and b, how far along it the points lie, their distances (n,) mm and unit vectors (n, 3) away from it.
    """
    length = np.sqrt(1.0 + a**2 + b**2)
    axis = np.array([a, b, 1.0]) / length
    tilts = (np.eye(3)[:2] - np.outer(axis[:2], axis)) / length
    along = away @ axis
    level = away - along[:, None] * axis
    distance = np.maximum(np.linalg.norm(level, axis=1), 1e-300)
    return axis, tilts, along, distance, level / distance[:, None]


def hemisphere(number: int) -> Array:
    """Unit vectors (number, 3) spread evenly over a hemisphere (golden spiral)."""
    i = np.arange(number) + 0.5
    z = i / number
    around = np.pi * (1.0 + np.sqrt(5.0)) * i
    level = np.sqrt(1.0 - z * z)
    return np.column_stack([level * np.cos(around), level * np.sin(around), z])
