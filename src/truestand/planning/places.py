"""The places that are tried: over all that there are, or over all that a positioner reaches."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import product
from math import degrees, radians

import numpy as np

from truestand.planning.carried import Carrier
from truestand.planning.kinematics import Position
from truestand.planning.optics import Optics
from truestand.planning.place import Place
from truestand.planning.target import Mount, Target
from truestand.planning.views import Setting

ANGLES = np.radians(np.arange(35.0, 146.0, 7.5))
"""Between axis and sensor, either way round about its z where the camera makes a difference."""
STANDOFFS, HEIGHTS, OFFSETS = 6, 6, (0.0, -0.1, 0.1, -0.2, 0.2)
"""Places tried along the range, and along the part; plane offsets, in radii of the thinnest cylinder of the shaft. At
0.3 of them its steps look 0.15 mm otherwise than drawn, and some stands take one for another."""
RANGE_MARGIN = 2.0
"""mm of range at either end that places leave."""
BEYOND, FARTHEST_BEYOND = 10.0, 25.0
"""mm above and below the surfaces at which the laser's middle may meet the shaft; where a positioner may have no better
places, farther away.
"""
NEXT = ((radians(3.0), 0.0, 0.0, 0.0), (0.0, 4.0, 0.0, 0.0), (0.0, 0.0, 3.0, 0.0), (0.0, 0.0, 0.0, 0.3))
"""Steps by which a place is made better: angle, stand-off, height, plane offset."""


def places_for(
    optics: Optics, carried: bool, setting: Setting, target: Target
) -> Iterator[tuple[Place, Position | None]]:
    """Places to try with a sensor, with the positions of the positioner where it is ``carried``."""
    if not carried or setting.carrier is None:
        yield from ((place, None) for place in _standing(optics, setting, target))
        return
    (near, far), heights = optics.range, target.surfaces.points[:, 2]
    low, high = heights.min() - FARTHEST_BEYOND, heights.max() + FARTHEST_BEYOND
    for position, place in setting.carrier.places(setting.artefact.base.radius):
        if near < place.standoff < far and low < place.height < high and _through_shaft(place, setting):
            yield place, position


def beside(mount: Mount, setting: Setting) -> Iterator[Mount]:
    """The same view a step away, in place or in position."""
    if mount.position is not None and setting.carrier is not None:
        moved = _brought(mount, setting.carrier.beside(mount.position), setting.carrier, setting)
    else:
        moved = (replace(mount, place=place) for place in _next_to(mount.place))
    yield from (found for found in moved if _through_shaft(found.place, setting))


def rounded(mount: Mount, setting: Setting) -> Mount:
    """The same view where a person would put it."""
    carrier, place = setting.carrier, mount.place
    if mount.position is not None and carrier is not None:
        return next(_brought(mount, [carrier.rounded(mount.position)], carrier, setting), mount)
    at = replace(
        place, phi=radians(round(2 * degrees(place.phi)) / 2), standoff=round(2 * place.standoff) / 2,
        height=round(2 * place.height) / 2, plane_offset=round(20 * place.plane_offset) / 20,
    )  # fmt: skip
    return replace(mount, place=at)


def _standing(optics: Optics, setting: Setting, target: Target) -> Iterator[Place]:
    heights = target.surfaces.points[:, 2]
    (near, far), signs = optics.range, (-1.0, 1.0) if optics.triangulation else (-1.0,)
    along = np.linspace(heights.min() - BEYOND, heights.max() + BEYOND, HEIGHTS)
    for sign, angle, standoff, height, offset in product(
        signs, ANGLES, np.linspace(near + RANGE_MARGIN, far - RANGE_MARGIN, STANDOFFS), along, OFFSETS
    ):
        yield Place(float(sign * angle), float(standoff), float(height), float(offset * setting.thinnest))


def _next_to(place: Place) -> Iterator[Place]:
    for by, sign in product(NEXT, (1.0, -1.0)):
        yield replace(
            place, phi=place.phi + sign * by[0], standoff=place.standoff + sign * by[1],
            height=place.height + sign * by[2], plane_offset=place.plane_offset + sign * by[3],
        )  # fmt: skip


def _brought(mount: Mount, positions: Iterable[Position], carrier: Carrier, setting: Setting) -> Iterator[Mount]:
    """The same view where the positioner brings it."""
    for position in positions:
        place = carrier.kinematics.place(position, setting.artefact.base.radius)
        if place is not None:
            yield replace(mount, place=place, position=position)


def _through_shaft(place: Place, setting: Setting) -> bool:
    """Whether the laser plane is as near the axis as a calibration needs."""
    return abs(place.plane_offset) <= max(OFFSETS) * setting.thinnest
