"""The calibration of several sensors from scans of the same shaft: all poses in one frame, and how well they are known.

A view is a sensor in a place. Azimuth and height between views come from what all see of the shaft: the direction of
its eccentricity, the phases of its form, its shoulder (``calibration.joint``).
"""

from dataclasses import replace
from math import degrees, hypot, sqrt

import numpy as np

from truestand.calibration.calibrate import fit_of
from truestand.calibration.covariance import weighed
from truestand.calibration.joint import Joint, View, azimuths_alike, together
from truestand.calibration.model import COAXIALITY
from truestand.calibration.result import IDENTIFIABLE, calibration_with, plane_identifiable
from truestand.calibration.segment import segment
from truestand.calibration.uneven_form import SOURCE, covariance_of_uneven_form, uneven_form
from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.assumptions import ANGLE_ZERO_U, ASSUMED, BEARING_U, K
from truestand.core.calibration import VIEW_UNKNOWNS, Calibration, Check, Contribution, JointCovariance, Uncertainty
from truestand.core.errors import BadRecipe
from truestand.core.frames import ECCENTRICITY_X, ECCENTRICITY_Y, UNKNOWNS, axis_sensitivity
from truestand.core.harmonics import wrap
from truestand.core.message import UNTIED, Message
from truestand.core.scan import AngleZero, Scan
from truestand.uncertainty.budget import HALF_TURN_DEG

MOST_OTHERWISE_MM = 0.005
"""By which a view may see the shaft's axis, or its form, otherwise than all views together."""
AZIMUTH_KEY, HEIGHT_KEY = "azimuth_deg", "height_mm"
"""Of a view, in the record."""
Parts = dict[str, Array]
"""Covariance (n, n) of all unknowns by source."""


def calibrate_views(scans: tuple[Scan, ...], artefact: Artefact) -> Calibration:
    """The calibration of several sensors, from a scan of the same shaft by each, taken at once or one after the other.

    It is that of the first view; ``views`` holds all of them, ``joint`` how well they are known together.

    Raises:
        BadRecipe: a view twice, a scan twice, or scans of different tables.
        NotEnoughData: a scan that can't be calibrated.
    """
    _demand_views(scans)
    fits = tuple(fit_of(scan, artefact, segment(scan, artefact)) for scan in scans)
    joint = together(fits, tuple(scan.stand.sensor for scan in scans))
    checks = tuple(_same_shaft(view, joint) for view in joint.views)
    plane = plane_identifiable(scans[0], artefact, joint.views[0].fit)
    joint, parts = weighed(joint, joint.about, plane)
    views = tuple(
        _with_check(_of_view(scan, artefact, view, joint, parts), check)
        for scan, view, check in zip(scans, joint.views, checks, strict=True)
    )
    covariance = _joint_covariance(views, joint, parts)
    return replace(views[0], views=views, joint=covariance, checks=_checks(views), reasons=_reasons(views))


def _with_check(calibration: Calibration, check: Check) -> Calibration:
    reasons = calibration.reasons if check.ok else (*calibration.reasons, check.reason)
    return replace(calibration, checks=(*calibration.checks, check), reasons=reasons)


def _checks(views: tuple[Calibration, ...]) -> tuple[Check, ...]:
    """Those of the first view, and of the others with their names."""
    first, *others = views
    named = (replace(c, name=f"view {v.name}: {c.name}") for v in others for c in v.checks)
    return (*first.checks, *named)


def _demand_views(scans: tuple[Scan, ...]) -> None:
    """Scans of one table, each by another sensor."""
    names = [scan.view for scan in scans]
    if len(set(names)) < len(names):
        raise BadRecipe(
            f"found the views {', '.join(names)}, need another one for each scan: name them by --view, or "
            "give --clamped-at-deg where the shaft was clamped again for each"
        )
    sha256 = [s.sha256 for s in scans if s.sha256]
    if len(set(sha256)) < len(sha256):
        raise BadRecipe("found the same scan twice, need one scan of each view")
    tables = {(s.stand.table.direction, s.stand.table.speed) for s in scans}
    if len(tables) > 1:
        listed = " and ".join(f"{direction} at {speed} rad/s" for direction, speed in sorted(tables, key=str))
        raise BadRecipe(f"found scans of tables that turn {listed}, need one table for all views; check --stand")
    zeros = {s.angle_zero for s in scans}
    if len(zeros) > 1:
        raise BadRecipe(
            f"found scans whose table angles count from {' and '.join(sorted(zeros))}, need one zero for all: record "
            "the angle in each, or home the table before each"
        )


def _of_view(scan: Scan, artefact: Artefact, view: View, joint: Joint, parts: Parts) -> Calibration:
    """The calibration of one view in its own frames, and where these stand in the first view's."""
    p, jacobian = view.own(joint.parameters)
    fit = replace(view.fit, solution=replace(view.fit.solution, parameters=p))
    own = {name: jacobian @ part @ jacobian.T for name, part in parts.items()}
    calibration = calibration_with(scan, artefact, fit, own)
    if view.pose is None:
        return calibration
    azimuth, height = view.place(joint.parameters)
    uncertainty = _place_uncertainty(scan.angle_zero, view, joint, parts)
    hidden = _place_hidden(scan.angle_zero, view, joint, uncertainty[AZIMUTH_KEY].U)
    return replace(
        calibration, azimuth=wrap(azimuth), height=height, uncertainty=calibration.uncertainty | uncertainty,
        azimuth_repeats=_azimuth_repeats(scan.angle_zero, view, parts),
        not_identifiable=(*calibration.not_identifiable, *hidden),
    )  # fmt: skip


def _place_uncertainty(zero: AngleZero, view: View, joint: Joint, parts: Parts) -> dict[str, Uncertainty]:
    """U of a view's azimuth and height."""
    assert view.pose is not None
    azimuth, height = view.pose
    lines = [Contribution(n, K * sqrt(max(c[azimuth, azimuth], 0.0))) for n, c in parts.items()]
    lines += [Contribution(n, K * sqrt(v)) for n, v in _azimuth_variances(zero, view, joint).items()]
    heights = [Contribution(n, K * sqrt(max(c[height, height], 0.0))) for n, c in parts.items()]
    in_degrees = [replace(line, U=degrees(line.U)) for line in lines]
    U = min(hypot(*(line.U for line in in_degrees)), HALF_TURN_DEG)
    return {
        AZIMUTH_KEY: Uncertainty(U, K, _largest_first(in_degrees)),
        HEIGHT_KEY: Uncertainty(hypot(*(line.U for line in heights)), K, _largest_first(heights)),
    }


def _largest_first(lines: list[Contribution]) -> tuple[Contribution, ...]:
    return tuple(sorted((line for line in lines if line.U), key=lambda line: -line.U))


def _azimuth_variances(zero: AngleZero, view: View, joint: Joint) -> dict[str, float]:
    """Variances (rad2) of a view's azimuth by what no scan shows, each view's own: the once-a-turn error of the
    bearing, which it takes for eccentricity; form that changes along the shaft; where its scan starts.
    """
    assert view.pose is not None
    bearing = uneven = 0.0
    for each in joint.views:
        follows = joint.followers(each)[view.pose[0]]
        bearing += float(np.square(follows[[ECCENTRICITY_X, ECCENTRICITY_Y]]).sum()) * (BEARING_U / K) ** 2
        uneven += float(follows @ covariance_of_uneven_form(each.fit, uneven_form(each.fit)) @ follows)
    return {
        f"table bearing, once per turn{ASSUMED}": bearing,
        SOURCE: uneven,
        f"zero of the table angle{ASSUMED}": _start_variance(zero),
    }


def _azimuth_repeats(zero: AngleZero, view: View, parts: Parts) -> float:
    """rad, standard: how well second scans of all views give the same azimuth."""
    assert view.pose is not None
    azimuth, _ = view.pose
    return sqrt(parts["noise"][azimuth, azimuth] + _start_variance(zero))


def _start_variance(zero: AngleZero) -> float:
    """Variance (rad2) of an azimuth by where two scans start; each index is the same mark."""
    return 0.0 if zero == "index" else 2 * (ANGLE_ZERO_U / K) ** 2


def _place_hidden(zero: AngleZero, view: View, joint: Joint, azimuth_U: float) -> list[str]:
    """What of a view's place is not identifiable.

    Without a common zero of the angle, what is found for the azimuth holds the difference of the scans' zeros.
    """
    first = joint.views[0]
    alike = azimuths_alike(first.fit, view.fit) or azimuth_U > IDENTIFIABLE * HALF_TURN_DEG
    seen = first.fit.segments.shoulder_seen and view.fit.segments.shoulder_seen
    return [key for key, hidden in ((AZIMUTH_KEY, alike or zero == "unknown"), (HEIGHT_KEY, not seen)) if hidden]


def _same_shaft(view: View, joint: Joint) -> Check:
    """Whether a view sees the same shaft as all together: its axis where it sees it, and its form.

    What one view takes for its laser plane may be the steps' coaxiality, which all together know better; and its sensor
    may stretch the shaft's travel.
    """
    fit = view.fit
    off = view.own(joint.parameters)[0] - fit.solution.parameters
    covariance = fit.covariance["noise"] + fit.covariance.get(COAXIALITY, 0.0)
    axis = np.stack([axis_sensitivity(b.middle) for b in fit.segments.bands])
    travel = float(np.hypot(*joint.parameters[[ECCENTRICITY_X, ECCENTRICITY_Y]]))
    U = K * hypot(
        sqrt(float(np.einsum("kij,jl,kil->k", axis, covariance[:UNKNOWNS, :UNKNOWNS], axis).max())),
        travel * view.stretches[0].u,
    )
    form = off[fit.model.forms_slice]
    return Check.at_most_um(
        "view_of_another_shaft", "sees the shaft otherwise than all views together, um",
        float(max(*np.linalg.norm(axis @ off[:UNKNOWNS], axis=1), np.abs(form).max(initial=0.0))),
        MOST_OTHERWISE_MM + 2 * U,
        "the shaft was clamped again or is another one, the table ran at another speed, or a sensor is not as its "
        "recipe says: scan it with all sensors anew",
    )  # fmt: skip


def _reasons(views: tuple[Calibration, ...]) -> tuple[Message, ...]:
    """What speaks against each view by itself, and against using them together."""
    found: list[Message] = []
    for view in views:
        found += [r if r.code == UNTIED.code else r.prefixed(f"view {view.name}: ") for r in view.reasons]
        if AZIMUTH_KEY in view.not_identifiable and view.angle_zero != "unknown":
            text = (
                f"view {view.name}: where it stands about the axis is not known, the shaft looks alike from several "
                "sides: clamp it eccentrically, by half a millimetre or more"
            )
            found.append(Message("azimuth_unknown", text))
    return tuple(dict.fromkeys(found))


def _joint_covariance(views: tuple[Calibration, ...], joint: Joint, parts: Parts) -> JointCovariance:
    """Of each view's geometry, azimuth and height, all together; what only a view's own covariance knows in its own."""
    rows = np.zeros((len(joint.views), VIEW_UNKNOWNS, joint.parameters.size))
    further = np.zeros((len(joint.views), VIEW_UNKNOWNS))
    for k, (calibration, view) in enumerate(zip(views, joint.views, strict=True)):
        rows[k, :UNKNOWNS] = view.own(joint.parameters)[1][:UNKNOWNS]
        if view.pose is not None:
            rows[k, [UNKNOWNS, UNKNOWNS + 1], list(view.pose)] = 1.0
            further[k, UNKNOWNS] = sum(_azimuth_variances(calibration.angle_zero, view, joint).values())
    flat = rows.reshape(-1, joint.parameters.size)
    matrix = flat @ np.asarray(sum(parts.values())) @ flat.T + np.diag(further.reshape(-1))
    for k, calibration in enumerate(views):
        own = slice(k * VIEW_UNKNOWNS, k * VIEW_UNKNOWNS + UNKNOWNS)
        matrix[own, own] = calibration.covariance
    return JointCovariance(tuple(calibration.name for calibration in views), matrix)
