"""The pictures of a plan: where the sensors stand, what each sees of the part, and what other places would give."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle, Wedge

from truestand.core.arrays import Array
from truestand.core.frames import Pose, about_axis
from truestand.core.units import degrees
from truestand.gear.geometry import FLANKS
from truestand.planning.gear_target import GearTarget
from truestand.planning.plan import Plan
from truestand.planning.target import View
from truestand.report.drawing import GREY, INK, PALE, SEQUENTIAL, SURFACES, figure, image, styled

WIDTH = 9.6
"""Inches."""
PART, SHAFT = "#c9d3dc", "#e6eaee"
STEEPEST = 90.0
"""Degrees of incidence at the end of the colour scale."""
MANY = 2
"""Views from which their pictures are smaller."""


@styled
def places(plan: Plan) -> Figure:
    """Each sensor from the side, in its own laser plane; then all of them from above."""
    fig = figure(WIDTH, 3.4 if len(plan.views) < MANY else 2.8)
    *panels, above = fig.subplots(1, len(plan.views) + 1)
    for k, (axes, view) in enumerate(zip(panels, plan.views, strict=True)):
        _bodies(axes, plan)
        _sensor_from_side(axes, view, plan, SURFACES[k % len(SURFACES)])
        axes.set(title=f"{view.mount.sensor.name}, from the side", xlabel="from the axis, mm", ylabel="height, mm")
    _from_above(above, plan)
    for axes in (*panels, above):
        axes.set_aspect("equal")
        axes.autoscale_view()
    return fig


def _bodies(axes: Axes, plan: Plan) -> None:
    """Table, shaft and part, cut through the axis."""
    face = plan.search.swept[-1]
    reach = max(b.radius for b in (*plan.setting.shaft, *plan.search.target.swept)) + 25.0
    axes.add_patch(Rectangle((-reach, face.top - 6.0), 2 * reach, 6.0, color=PALE))
    for bodies, colour in ((plan.setting.shaft, SHAFT), (plan.search.target.swept, PART)):
        for b in bodies:
            corner, width, height = (-b.radius, b.bottom), 2 * b.radius, b.top - b.bottom
            axes.add_patch(Rectangle(corner, width, height, facecolor=colour, edgecolor=GREY, lw=0.6))
    axes.axvline(0.0, color=GREY, lw=0.6, ls=(0, (8, 3, 2, 3)))


def _sensor_from_side(axes: Axes, view: View, plan: Plan, colour: str) -> None:
    optics, pose = view.mount.sensor.optics, view.mount.place.pose(plan.setting.artefact.base.radius)
    width, _, depth = optics.housing
    box = [(-width / 2, 0), (width / 2, 0), (width / 2, -depth), (-width / 2, -depth)]
    axes.add_patch(Polygon(_side(pose, box), facecolor=colour, alpha=0.25, edgecolor=colour))
    near, far = optics.range
    ends = [float(optics.half_line(z)) for z in (near, far)]
    zone = [(-ends[0], near), (ends[0], near), (ends[1], far), (-ends[1], far)]
    axes.add_patch(Polygon(_side(pose, zone), facecolor=colour, alpha=0.12, edgecolor=colour, lw=0.8))
    for x, z in zip((-ends[0], ends[0]), (near, near), strict=True):
        axes.plot(*_side(pose, [(0.0, 0.0), (x, z)]).T, color=colour, lw=0.6, ls=":")


def _side(pose: Pose, points: Sequence[tuple[float, float]]) -> Array:
    """Points x, z of a sensor as distance from the axis and height (n, 2)."""
    return pose(np.array([(x, 0.0, z) for x, z in points]))[:, [0, 2]]


def _from_above(axes: Axes, plan: Plan) -> None:
    """Table, part and housings."""
    table = plan.search.swept[-1]
    axes.add_patch(Circle((0, 0), table.radius, facecolor=SHAFT, edgecolor=GREY, lw=0.6))
    for b in plan.search.target.swept:
        axes.add_patch(Circle((0, 0), b.radius, facecolor=PART, edgecolor=GREY, lw=0.6))
    for area in plan.search.room.keep_out:
        low, high = (degrees(a) for a in area.azimuth)
        outer = min(area.radius[1], 3 * table.radius)
        width = outer - min(area.radius[0], outer)
        axes.add_patch(Wedge((0, 0), outer, low, high, width=width, fill=False, edgecolor=INK, hatch="///", lw=0.5))
    for k, view in enumerate(plan.views):
        _housing_from_above(axes, view, plan, SURFACES[k % len(SURFACES)])
    axes.set(title="from above", xlabel="mm", ylabel="mm")


def _housing_from_above(axes: Axes, view: View, plan: Plan, colour: str) -> None:
    pose = about_axis(view.mount.place.azimuth, 0.0) @ view.mount.place.pose(plan.setting.artefact.base.radius)
    width, thick, depth = view.mount.sensor.optics.housing
    corners = np.array(
        [(x, y, z) for x in (-width / 2, width / 2) for y in (-thick / 2, thick / 2) for z in (-depth, 0.0)]
    )
    outline = _hull(pose(corners)[:, :2])
    axes.add_patch(Polygon(outline, facecolor=colour, alpha=0.3, edgecolor=colour))
    start, end = pose(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, view.mount.place.standoff]]))[:, :2]
    axes.plot(*np.stack([start, end]).T, color=colour, lw=1.0)
    x, y = outline.mean(axis=0)
    axes.text(x, y, view.mount.sensor.name, ha="center", va="center", color=INK, fontsize=7.5)


def _hull(points: Array) -> Array:
    from scipy.spatial import ConvexHull

    return np.asarray(points[ConvexHull(points).vertices])


@styled
def flanks(plan: Plan, target: GearTarget) -> Figure:
    """What each view sees of a left and a right flank, by the angle of incidence."""
    fig = figure(WIDTH, 0.5 + 1.9 * len(plan.views))
    panels = fig.subplots(len(plan.views), 2, squeeze=False, sharex=True, sharey=True)
    drawn: Any = None
    for row, view in zip(panels, plan.views, strict=True):
        picture = target.picture(view)
        extent = (*picture.heights, *picture.rolls)
        for axes, flank, incidence in zip(row, FLANKS, np.degrees(picture.incidence), strict=True):
            drawn = image(axes, incidence, extent, (40.0, STEEPEST), SEQUENTIAL + "_r")
            axes.set(title=f"{view.mount.sensor.name}: {flank} flanks")
        row[0].set_ylabel("roll length, mm")
    for axes in panels[-1]:
        axes.set_xlabel("height, mm")
    fig.colorbar(drawn, ax=panels.ravel().tolist(), label="incidence, °", pad=0.01)
    return fig


@styled
def tried(plan: Plan) -> Figure:
    """Places from which the shaft can be calibrated, by how much they show; those compared by their U."""
    fig = figure(WIDTH, 3.2)
    left, right = fig.subplots(1, 2)
    coverage = plan.search.target.surfaces.coverage
    best: dict[tuple[float, float], float] = {}
    for c in plan.search.candidates:
        where = round(degrees(c.place.phi), 1), round(c.place.height, 1)
        best[where] = max(best.get(where, 0.0), min(coverage(c.seen).values()))
    phi, height = np.array(list(best)).T if best else np.zeros((2, 0))
    points = left.scatter(phi, height, c=list(best.values()), s=42, marker="s", cmap=SEQUENTIAL, vmin=0.0, vmax=1.0)
    fig.colorbar(points, ax=left, label="seen of the surface seen least, share", pad=0.01)
    left.set(title="What single places show at best", xlabel="phi, °", ylabel="height, mm")
    compared = [(t.places[-1], t.share) for t in plan.tried if not t.missing]
    if compared:
        at, share = zip(*compared, strict=True)
        at_phi, standoff = [degrees(p.phi) for p in at], [p.standoff for p in at]
        points = right.scatter(at_phi, standoff, c=100 * np.array(share), s=22, cmap=SEQUENTIAL + "_r", lw=0)
        fig.colorbar(points, ax=right, label="largest U of the limits, about, %", pad=0.01)
    for axes, key in ((left, "height"), (right, "standoff")):
        for view in plan.views:
            p = view.mount.place
            axes.plot(degrees(p.phi), getattr(p, key), marker="x", color="#a8240b", ms=8, mew=1.8)
    ranges = [view.mount.sensor.optics.range for view in plan.views]
    if ranges:
        right.set_ylim(min(low for low, _ in ranges), max(high for _, high in ranges))
    right.set(title="Places that were compared", xlabel="phi, °", ylabel="stand-off, mm")
    return fig
