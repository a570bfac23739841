"""Several scans with the shaft clamped again at known angles separate what one scan can't.

Whatever belongs to the shaft turns with it, what belongs to the stand stays. So the coaxiality of the steps is
separated from the laser plane's offset and tilt (with one scan it makes most of their U), and the table bearing's error
from the form of the shaft. The scans' normal matrices are put together; each scan keeps its own clamping, drift
and static profile, all share the laser plane and the axes of the shaft's steps. Where in that plane the sensor stands
each scan knows by itself, to a fraction of a micrometre: one place for all would push the plane far off where the
sensor warms up between two scans.
"""

from dataclasses import replace
from math import cos, degrees, hypot, sin, sqrt

import numpy as np

from truestand.calibration.calibrate import fit_of
from truestand.calibration.covariance import weighed
from truestand.calibration.estimate import solve
from truestand.calibration.model import COAXIALITY, MOUNTING, PLANE, STRETCH, Model, precision_of, stretches_for
from truestand.calibration.refine import Refined, refine_again
from truestand.calibration.result import calibration_of, calibration_with, plane_identifiable
from truestand.calibration.segment import segment
from truestand.core.arrays import Array, Ints
from truestand.core.artefact import Artefact
from truestand.core.assumptions import ASSUMED, CLAMPED_U, K
from truestand.core.calibration import (
    TABLE_BEARING,
    Calibration,
    Check,
    Harmonic,
    Positions,
    Separated,
    StepAxis,
)
from truestand.core.errors import BadRecipe, NotEnoughData
from truestand.core.frames import PLANE_OFFSET, RADIAL
from truestand.core.harmonics import wrap
from truestand.core.message import Message
from truestand.core.scan import Scan

LEAST_TURN_RAD = 0.17
"""Between two clampings, below which nothing can be separated: 10 degrees."""
LEAST_SINGULAR_VALUE = 0.2
"""Per scan, from which a harmonic of the shaft can be separated from the bearing's."""
MOST_BEARING_DIFFERENCE_MM = 0.005
"""Beyond U: a bearing that also tilts may show so much otherwise on another step."""
MOST_MOVED_MM = 0.01
"""By which the sensor may have moved from one scan to the next."""
LEAST_MOVED_MM = 0.002
"""Beyond four standard deviations, by which the scans' laser planes may differ."""
SHARED_PRIORS = (MOUNTING, COAXIALITY, STRETCH)
"""What is known beforehand of the unknowns that all scans share."""
CLAMPED = f"clamping angles{ASSUMED}"
MOVED = "move of the sensor between the scans"
REFITS = 3
"""Fits with known axes until nothing is left of a fit to coaxial ones."""
MOST_REFITS, SETTLED_MM = 6, 2e-5
"""Axes that move by less have settled."""


def calibrate_positions(scans: tuple[Scan, ...], clamped: tuple[float, ...], artefact: Artefact) -> Calibration:
    """The calibration from several scans, the shaft clamped at the angles ``clamped`` (rad, ccw from above).

    The shaft's pose is that of the last scan: so it stands on the table now. Source: error separation by reorientation
    (Whitehouse 1976, J. Phys. E 9, 531).

    Raises:
        BadRecipe: not one angle a scan, or all of them much the same.
        NotEnoughData: a scan that can't be calibrated, or scans that show different cylinders.
    """
    _demand_turns(scans, clamped)
    _demand_one_stand(scans)
    fits = tuple(fit_of(scan, artefact, segment(scan, artefact)) for scan in scans)
    _demand_same_cylinders(fits, artefact)
    fits, joint = fits_on_common_axes(scans, fits, clamped, artefact)
    further = {
        CLAMPED: _clamping_covariance(fits, joint, clamped),
        MOVED: _moved_covariance(fits, joint, clamped),
    }
    identifiable = plane_identifiable(scans[-1], artefact, joint, _largest_offset(joint))
    weighed_joint, parts = weighed(joint, lambda q: _about(fits, clamped, q), identifiable)
    calibration = calibration_with(scans[-1], artefact, weighed_joint, parts | further)
    form, bearing, inseparable, difference = _form_and_bearing(fits, clamped, artefact)
    sha256 = tuple(scan.sha256 for scan in scans)
    positions = Positions(clamped, sha256, _step_axes(joint, artefact), form, bearing, inseparable)
    checks = (_sensor_stood_still(fits), _plane_stood_still(fits, joint), _bearing_alike(difference))
    reasons = (
        *calibration.reasons,
        *(reason for scan in scans for reason in scan.reasons),
        *_reasons_of_others(scans, fits, artefact),
        *(c.reason for c in checks if not c.ok),
    )
    return replace(calibration, positions=positions, checks=(*calibration.checks, *checks), reasons=reasons)


def calibrate_on_axes(scan: Scan, artefact: Artefact, axes: tuple[StepAxis, ...]) -> Calibration:
    """The calibration from one scan of a shaft whose steps' axes are known from several clampings.

    Raises:
        NotEnoughData: the scan can't be calibrated.
    """
    known = {a.surface: a for a in axes}
    cylinders = tuple(replace(c, coaxiality_U=known[c.name].U) if c.name in known else c for c in artefact.cylinders)
    artefact = replace(artefact, cylinders=cylinders)
    fit = fit_of(scan, artefact, segment(scan, artefact))
    own_axes = []
    for k, band in list(enumerate(fit.segments.bands))[1:]:
        axis = known.get(cylinders[band.cylinder].name)
        own_axes.append((0.0, 0.0, 0.0, 0.0) if axis is None else axis.at(fit.model.middles[k]))
    fit = replace(fit, model=replace(fit.model, axes=tuple(own_axes)))
    for _ in range(REFITS):
        fit = refine_again(scan, artefact, fit)
    return calibration_of(scan, artefact, fit)


def _clamping_covariance(fits: tuple[Refined, ...], joint: Refined, clamped: tuple[float, ...]) -> Array:
    """Covariance (p, p) of the unknowns from how well the clamping angles are known: by moving each."""
    covariance = np.zeros_like(joint.solution.information)
    for i in range(len(clamped) - 1):
        other = tuple(a + (CLAMPED_U / K if j == i else 0.0) for j, a in enumerate(clamped))
        moved = together(fits, other).solution.parameters - joint.solution.parameters
        covariance += np.outer(moved, moved)
    return covariance


def _moved_covariance(fits: tuple[Refined, ...], joint: Refined, clamped: tuple[float, ...]) -> Array:
    """Covariance (p, p) of the unknowns if each scan's laser plane moved sideways as far as its sensor did radially.

    A sideways move between two clampings can't be told from a step's axis that is off: radially it shows.
    """
    covariance = np.zeros_like(joint.solution.information)
    for i, radial in enumerate(_radial_positions(fits)):
        p = fits[i].solution.parameters.copy()
        p[PLANE_OFFSET] += (radial - joint.solution.parameters[RADIAL]) / K
        there = replace(fits[i], solution=replace(fits[i].solution, parameters=p))
        moved = together((*fits[:i], there, *fits[i + 1 :]), clamped).solution.parameters - joint.solution.parameters
        covariance += np.outer(moved, moved)
    return covariance


def _radial_positions(fits: tuple[Refined, ...]) -> list[float]:
    """Where each scan has the sensor (mm)."""
    return [float(f.solution.parameters[RADIAL]) for f in fits]


def _reasons_of_others(scans: tuple[Scan, ...], fits: tuple[Refined, ...], artefact: Artefact) -> list[Message]:
    """What speaks against the scans before the last."""
    singles = (calibration_of(scan, artefact, fit) for scan, fit in zip(scans[:-1], fits[:-1], strict=True))
    return [reason.prefixed(f"scan {i}: ") for i, single in enumerate(singles, 1) for reason in single.reasons]


def _demand_turns(scans: tuple[Scan, ...], clamped: tuple[float, ...]) -> None:
    if len(clamped) != len(scans):
        raise BadRecipe(
            f"found {len(clamped)} clamping angles for {len(scans)} scans, need one each: --clamped-at-deg 0,180"
        )
    apart = max(abs(wrap(a - b)) for a in clamped for b in clamped)
    if apart < LEAST_TURN_RAD:
        raise BadRecipe(
            f"found clamping angles within {degrees(apart):.3g} deg, need at least {degrees(LEAST_TURN_RAD):.0f}: turn "
            "the shaft in its clamping between the scans, best by 180 deg"
        )


def _demand_one_stand(scans: tuple[Scan, ...]) -> None:
    """Scans of one stand, each another one, whose table angles count from one zero."""
    sha256 = [s.sha256 for s in scans if s.sha256]
    if len(set(sha256)) < len(sha256):
        raise BadRecipe("found the same scan twice, need one scan for each clamping")
    if len(views := dict.fromkeys(s.view for s in scans)) > 1:
        raise BadRecipe(
            f"found scans of one shaft clamped again by views {' and '.join(map(repr, views))}, need one view; leave "
            "out --clamped-at-deg to calibrate views together"
        )
    zeros = {s.angle_zero for s in scans}
    if len(zeros) > 1:
        raise BadRecipe(
            f"found scans whose table angles count from {' and '.join(sorted(zeros))}, need one zero for all: record "
            "the angle in each, or home the table before each"
        )
    if len({(s.stand.table.direction, s.stand.sensor.mirrored) for s in scans}) > 1:
        raise BadRecipe(
            "found scans of stands with another direction or mirrored sensor, need one stand; check --stand"
        )


def _demand_same_cylinders(fits: tuple[Refined, ...], artefact: Artefact) -> None:
    seen = [tuple(artefact.cylinders[b.cylinder].name for b in f.segments.bands) for f in fits]
    if len(set(seen)) > 1:
        listed = "; ".join(f"scan {i}: {', '.join(names)}" for i, names in enumerate(seen, 1))
        raise NotEnoughData(
            f"the scans show different cylinders ({listed}), need the same ones in each: "
            "is there a part on the shaft, or the sensor's range cut?"
        )


def fits_on_common_axes(
    scans: tuple[Scan, ...], fits: tuple[Refined, ...], clamped: tuple[float, ...], artefact: Artefact
) -> tuple[tuple[Refined, ...], Refined]:
    """The fits with the steps' axes where all scans together put them, and all of them as one.

    A fit to coaxial steps puts their offsets into other unknowns, and takes what does not fit there for outliers: so
    the axes that come out are given back to each scan until they settle.
    """
    fits = tuple(_in_step(scan, fit) for scan, fit in zip(scans, fits, strict=True))
    joint = together(fits, clamped)
    for _ in range(MOST_REFITS):
        axes = _axes_of(joint)
        fits = tuple(
            refine_again(scan, artefact, _with_axes(fit, joint, axes, turn - clamped[-1]))
            for scan, fit, turn in zip(scans, fits, clamped, strict=True)
        )
        joint = together(fits, clamped)
        if np.abs(_axes_of(joint) - axes)[:, :2].max(initial=0.0) < SETTLED_MM:
            break
    return fits, joint


def _in_step(scan: Scan, fit: Refined) -> Refined:
    """The fit with nothing left open of its steps' axes: several clampings find them."""
    others = tuple(q for q in fit.priors if q.name != STRETCH)
    return fit.held_by((*others, *stretches_for(fit.model, scan, fit.segments, [0.0] * (len(fit.model.radii) - 1))))


def _axes_of(joint: Refined) -> Array:
    """(further cylinders, 4): where their axes stand against the base's, in C of the last scan."""
    parameters = joint.solution.parameters + _known_axes(joint.model, joint.solution.parameters.size)
    return np.asarray(parameters[joint.model.axes_slice].reshape(-1, 4))


def _known_axes(model: Model, size: int) -> Array:
    """Where the unknowns of the further cylinders' axes count from, in their places among all (size,); 0 elsewhere."""
    known = np.zeros(size)
    if model.axes:
        known[model.axes_slice] = np.ravel(model.axes)
    return known


def _with_axes(fit: Refined, joint: Refined, axes: Array, turn: float) -> Refined:
    """The fit with its steps' axes known; they have turned with the shaft."""
    own_axes = tuple(
        tuple(_turned(turn, fit.model.middles[k] - joint.model.middles[k]) @ axes[k - 1])
        for k in range(1, len(fit.model.radii))
    )
    p = fit.solution.parameters.copy()
    p[fit.model.axes_slice] = 0.0
    return replace(fit, model=replace(fit.model, axes=own_axes), solution=replace(fit.solution, parameters=p))


def together(fits: tuple[Refined, ...], clamped: tuple[float, ...]) -> Refined:
    """The last fit with a solution that rests on all of them.

    Its unknowns are the last scan's, then what the others have of their own.
    """
    last = fits[-1]
    indices, follows = _indices(fits), _follows(fits, clamped)
    size = follows[0][0].shape[1]
    information, scores, right = np.zeros((size, size)), np.zeros((size, size)), np.zeros(size)
    shared = tuple(replace(q, considered=False) for q in last.priors if q.name in SHARED_PRIORS)
    priors = list(shared)
    for fit, index, (transfer, offset) in zip(fits, indices, follows, strict=True):
        data = fit.solution
        information += transfer.T @ data.information @ transfer
        scores += transfer.T @ fit.score_covariance @ transfer
        right += transfer.T @ (data.information @ (data.parameters - offset) - data.gradient)
        others = (q for q in fit.priors if q.name not in SHARED_PRIORS)
        priors += [replace(q, index=tuple(int(index[j]) for j in q.index)) for q in others]
    # The certificate says coaxial, the unknowns count from elsewhere.
    right -= precision_of(shared, size) * _known_axes(last.model, size)
    p = solve(information + np.diag(precision_of(priors, size)), right)
    solution = replace(
        last.solution, parameters=p, gradient=information @ p - right, information=information,
        steps=max(f.solution.steps for f in fits), converged=all(f.solution.converged for f in fits),
    )  # fmt: skip
    return replace(last, solution=solution, score_covariance=scores, priors=tuple(priors))


def _about(fits: tuple[Refined, ...], clamped: tuple[float, ...], q: Array) -> Refined:
    """As ``together``, but with the unknowns ``q`` (all,), and each scan's cost about what it has of them."""
    own = [transfer @ q + offset for transfer, offset in _follows(fits, clamped)]
    joint = together(tuple(fit.about(p) for fit, p in zip(fits, own, strict=True)), clamped)
    return replace(joint, solution=joint.solution.moved(q))


def _follows(fits: tuple[Refined, ...], clamped: tuple[float, ...]) -> list[tuple[Array, Array]]:
    """How each scan's unknowns follow from all: by a matrix (own, all) and an offset (own,), as its axes and those of
    the last scan, turned, count from different places.
    """
    last, indices = fits[-1], _indices(fits)
    size = max(int(i.max()) for i in indices) + 1
    known = _known_axes(last.model, size)
    follows = []
    for fit, index, turn in zip(fits, indices, clamped, strict=True):
        transfer = _transfer(fit, last, index, turn - clamped[-1], size)
        follows.append((transfer, transfer @ known - _known_axes(fit.model, fit.model.size)))
    return follows


def _turned(turn: float, lever: float) -> Array:
    """(4, 4): offset and slope of an axis after the shaft has turned, the offset counted ``lever`` mm higher up."""
    block = np.zeros((4, 4))
    turned = np.array([[cos(turn), -sin(turn)], [sin(turn), cos(turn)]])
    block[:2, :2] = block[2:, 2:] = turned
    block[:2, 2:] = turned * lever
    return block


def _indices(fits: tuple[Refined, ...]) -> list[Ints]:
    """Where each scan's unknowns stand among all of them: laser plane, axes and what the sensor's range makes of their
    travel shared, the rest its own.
    """
    last = np.arange(fits[-1].model.size)
    indices = []
    size = last.size
    for fit in fits[:-1]:
        own, index = np.ones(fit.model.size, dtype=np.bool_), np.arange(fit.model.size)
        shared = list(_shared(fit.model))
        own[shared], index[shared] = False, _shared(fits[-1].model)  # fits may have form of other orders
        # Without gaps: unknowns that nobody uses would make the normal matrix singular.
        index[own] = size + np.arange(np.count_nonzero(own))
        size += int(np.count_nonzero(own))
        indices.append(index)
    return [*indices, last]


def _shared(model: Model) -> tuple[int, ...]:
    """The unknowns that all scans share."""
    axes, stretches = model.axes_slice, model.stretches_slice
    return (*PLANE, *range(axes.start, axes.stop), *range(stretches.start, stretches.stop))


def _transfer(fit: Refined, last: Refined, index: Ints, turn: float, size: int) -> Array:
    """(own, all): this scan's unknowns from all; the steps' axes turn with the shaft and count at their own middles."""
    transfer = np.zeros((fit.model.size, size))
    transfer[np.arange(fit.model.size), index] = 1.0
    for k in range(1, len(fit.model.radii)):
        lever = fit.model.middles[k] - last.model.middles[k]
        transfer[fit.model.axis_slice(k), last.model.axis_slice(k)] = _turned(turn, lever)
    return transfer


def _covariance(fit: Refined) -> Array:
    return np.asarray(sum(fit.covariance.values()))


def _largest_offset(joint: Refined) -> float:
    """Largest U (mm, k = 2) of a step's sideways offset."""
    covariance = _covariance(joint)
    return max((_offset_expanded(joint, covariance, k) for k in range(1, len(joint.model.radii))), default=0.0)


def _offset_expanded(joint: Refined, covariance: Array, k: int) -> float:
    at = joint.model.axis_slice(k).start
    return K * sqrt(max(float(np.linalg.eigvalsh(covariance[at : at + 2, at : at + 2])[-1]), 0.0))


def _step_axes(joint: Refined, artefact: Artefact) -> tuple[StepAxis, ...]:
    """Where the steps' axes stand against the base's, in C of the last scan."""
    covariance, axes = _covariance(joint), _axes_of(joint)
    step_axes = []
    for k, band in list(enumerate(joint.segments.bands))[1:]:
        x, y, slope_x, slope_y = map(float, axes[k - 1])
        name = artefact.cylinders[band.cylinder].name
        U = hypot(_offset_expanded(joint, covariance, k), CLAMPED_U * hypot(x, y))
        step_axes.append(StepAxis(name, x, y, slope_x, slope_y, joint.model.middles[k], U))
    return tuple(step_axes)


def _form_and_bearing(
    fits: tuple[Refined, ...], clamped: tuple[float, ...], artefact: Artefact
) -> tuple[tuple[Separated, ...], tuple[Separated, ...], tuple[int, ...], float]:
    """Harmonics of the shaft, of the table's bearing, and the orders that these angles can't separate.

    Last, by how much (mm) the surfaces' estimates of the bearing difference beyond their U.

    The shaft's turn by n times the clamping angle, the bearing's stay: two complex unknowns for as many complex
    readings as there are scans.
    """
    turns = np.array(clamped) - clamped[-1]
    orders = min(f.model.orders for f in fits)
    form, bearing, inseparable, difference = [], [], [], 0.0
    for n in range(2, orders + 1):
        design = np.column_stack([np.exp(-1j * n * turns), np.ones(turns.size)])
        separable = float(np.linalg.svd(design, compute_uv=False)[-1]) > LEAST_SINGULAR_VALUE * sqrt(turns.size)
        if not separable:
            inseparable.append(n)
            design = design[:, :1]
        inverse = np.linalg.pinv(design)
        table = []
        for k, band in enumerate(fits[-1].segments.bands):
            waves, variance = zip(*(_wave(f, k, n) for f in fits), strict=True)
            values = inverse @ np.array(waves)
            U = K * np.sqrt(np.square(np.abs(inverse)) @ np.array(variance))
            form.append(_separated(artefact.cylinders[band.cylinder].name, n, values[0], float(U[0])))
            if separable:
                table.append((complex(values[1]), float(U[1])))
        if table:
            weights = np.array([1.0 / max(U, 1e-9) ** 2 for _, U in table])
            mean = complex(weights @ np.array([v for v, _ in table]) / weights.sum())
            bearing.append(_separated(TABLE_BEARING, n, mean, 1.0 / sqrt(float(weights.sum()))))
            difference = max(difference, *(abs(v - mean) - U for v, U in table))
    return tuple(form), tuple(bearing), tuple(inseparable), difference


def _wave(fit: Refined, k: int, n: int) -> tuple[complex, float]:
    """Harmonic n that a surface shows as the complex w of Re(w exp(i n psi)), mm, and the variance of one of its parts.

    Form and bearing of the single fit together: what one scan can tell of them apart is not used here.
    """
    # At table angle theta the sensor sees the surface at psi = -theta: the bearing's sines change sign.
    shown, sine = np.zeros((2, fit.model.size)), fit.model.orders - 1
    for place, turned in ((fit.model.form_slice(k), 1.0), (fit.model.bearing_slice, -1.0)):
        shown[0, place.start + n - 2], shown[1, place.start + sine + n - 2] = 1.0, turned
    a, b = shown @ fit.solution.parameters
    return complex(a, -b), float(np.trace(shown @ _covariance(fit) @ shown.T)) / 2


def _separated(surface: str, n: int, w: complex, U: float) -> Separated:
    return Separated(Harmonic(surface, n, abs(w), float(-np.angle(w))), U)


def _plane_stood_still(fits: tuple[Refined, ...], joint: Refined) -> Check:
    """Whether every scan, now that it knows the steps' axes as well as ``joint`` does, reads the laser plane alike over
    what it sees.
    """
    ends = np.array([e for b in fits[-1].segments.bands for e in (b.low, b.high)])
    design = np.column_stack([np.ones(ends.size), ends])
    planes = np.array([design @ f.solution.parameters[list(PLANE)] for f in fits])
    known = [f.covariance["noise"][np.ix_(PLANE, PLANE)] + _by_axes(f, joint) for f in fits]
    u = np.sqrt(np.einsum("ij,njk,ik->ni", design, np.array(known), design).max())
    return Check.at_most_um(
        "laser_plane_differs", "laser plane differs between the scans, um", float(np.ptp(planes, axis=0).max()),
        LEAST_MOVED_MM + 2 * K * float(u),
        "a clamping angle is not as stated (counter-clockwise from above?), or the sensor moved sideways or tilted "
        "between the scans: check --clamped-at-deg, scan all positions anew",
    )  # fmt: skip


def _by_axes(fit: Refined, joint: Refined) -> Array:
    """Covariance (2, 2) that a scan's own laser plane has for what is open of the axes, doubled: they draw the planes
    of two scans apart, while noise of both is independent.
    """
    axes = np.arange(fit.model.axes_slice.start, fit.model.axes_slice.stop)
    others = np.setdiff1d(np.arange(fit.model.size), axes)
    normal = fit.solution.information + np.diag(precision_of(fit.priors, fit.model.size))
    follow = -solve(normal[np.ix_(others, others)], normal[np.ix_(others, axes)])[np.searchsorted(others, PLANE)]
    at = joint.model.axes_slice
    return np.asarray(2 * follow @ _covariance(joint)[at, at] @ follow.T)


def _bearing_alike(difference: float) -> Check:
    """Whether all surfaces show the same error of the table's bearing."""
    return Check.at_most_um(
        "bearing_disagrees", "surfaces disagree on the table bearing, um", difference, MOST_BEARING_DIFFERENCE_MM,
        "form that doesn't turn with the stated angles shows as bearing error, on each surface another: check "
        "--clamped-at-deg",
    )  # fmt: skip


def _sensor_stood_still(fits: tuple[Refined, ...]) -> Check:
    """Whether the sensor reads the shaft's radius alike in every scan."""
    radial = _radial_positions(fits)
    return Check.at_most_um(
        "sensor_moved_between_scans", "sensor moved between the scans, um", max(radial) - min(radial), MOST_MOVED_MM,
        "the sensor moved or warmed up while the shaft was clamped again: scan all positions anew",
    )  # fmt: skip
