"""Does an old calibration still hold? A new scan of the artefact answers, quantity by quantity."""

from dataclasses import dataclass, replace
from math import hypot, pi, radians, sqrt
from typing import Literal

import numpy as np

from truestand.apply.repeats import azimuth_repeatability, form_change, repeatability, told_together
from truestand.apply.right_view import demand_own_view
from truestand.apply.transfer import configuration_reasons, transfer, untied_reasons
from truestand.apply.views import demand_one_each
from truestand.apply.witness import Witness, witness
from truestand.calibration.calibrate import calibrate
from truestand.calibration.positions import calibrate_on_axes
from truestand.calibration.views import AZIMUTH_KEY, calibrate_views
from truestand.core.arrays import Array
from truestand.core.artefact import Artefact
from truestand.core.assumptions import K
from truestand.core.calibration import Calibration, ScanSummary
from truestand.core.errors import NotEnoughData, TruestandError
from truestand.core.frames import (
    ECCENTRICITY,
    ECCENTRICITY_X,
    PHI,
    PLANE_OFFSET,
    PLANE_TILT,
    RADIAL,
    UNKNOWNS,
    LaserPlane,
    axis_sensitivity,
    facing,
    in_table,
    sensor_parameters,
)
from truestand.core.harmonics import wrap
from truestand.core.message import UNTIED, Message
from truestand.core.scan import Scan
from truestand.uncertainty.influence import unknowns_of

Verdict = Literal["holds", "does_not_hold", "undecided"]
By = Literal["calibration", "witness"]

LIMIT = 0.01
"""mm by which a calibrated point may have moved on the artefact."""
SENSOR_MOVED = "the sensor has moved or turned in the laser plane: calibrate again"
HEIGHT_MOVED = "the sensor or the shaft has moved along the axis: calibrate again"
SHAFT_MOVED = "the shaft was clamped again or has slipped: calibrate again"
PLANE_MOVED = "the laser plane has moved or tilted: calibrate again"
VIEWS_TURNED = "it and the first view have turned against each other: calibrate again"
MORE_TURNS, EVERY_VIEW = "scan for more turns", "scan the shaft by every view of the calibration"
PLANE_UNTOLD = (
    "the scans don't tell where the laser plane stands: calibrate and verify by a shaft of two diameters that runs "
    "half a millimetre or more off centre"
)
NOT_COMPARED = Message(
    "azimuths_not_compared",
    "how the views stand to each other about the axis was not compared: scan the shaft by every view of the "
    "calibration, from the zero of the angle that it has",
)
CLAMPED_AGAIN = 5.0
"""Times the change of its form by which a shaft moves that was clamped again: dirt moves its axis by less."""
DIRT_ALONG = 0.1
"""mm: at the shoulder, dirt moves no sensor along the axis by so much."""
SHAFT = slice(ECCENTRICITY_X, UNKNOWNS)
"""Of the unknowns: its eccentricity and tilt."""
PLANE_KEYS = {"laser_plane_offset_mm", "laser_plane_tilt_deg"}
PUBLISHED = Message(
    "published_method", "the old calibration is of the published method, which knows no laser plane or tilt"
)
WORST_FIRST: tuple[Verdict, ...] = ("does_not_hold", "undecided", "holds")


@dataclass(frozen=True, slots=True)
class Change:
    """How far one thing has moved since the old calibration: mm on the artefact, with U (k = 2)."""

    code: str
    name: str
    value: float
    U: float
    limit: float
    verdict: Verdict
    advice: str
    """What to do where it has moved,"""
    remedy: str = MORE_TURNS
    """and where it is undecided."""
    view: str | None = None
    """Of several views, the one that moved."""


@dataclass(frozen=True, slots=True)
class Verification:
    """The answer, what it rests on, and the calibration that the new scan gives."""

    verdict: Verdict
    changes: tuple[Change, ...]
    reasons: tuple[Message, ...]
    calibration: Calibration | None
    """None where the scan shows too little of the artefact to be calibrated, or there are several."""
    scans: tuple[ScanSummary, ...]
    """One of each view."""
    by: By
    """Whether the artefact was calibrated again, or judged by the shaft in view beside a part."""


def verify_views(
    scans: tuple[Scan, ...], old: Calibration, artefact: Artefact, limit: float = LIMIT, start_stated: bool = False
) -> Verification:
    """Hold the calibration of several views against a new scan by each (``verify``): which of them has moved is named.

    Raises:
        NotEnoughData: as ``verify``.
        BadRecipe: two scans of one view, or one of a view of which the calibration is not.
    """
    demand_one_each(scans)
    together = _calibrated_together(scans, old, artefact, start_stated)
    found = [_verify(scan, old, artefact, limit, start_stated, together) for scan in scans]
    if len(found) == 1:
        return found[0]
    named = list(zip((scan.view for scan in scans), found, strict=True))
    by: By = "calibration" if all(v.by == "calibration" for v in found) else "witness"
    compared: tuple[Message, ...] = (NOT_COMPARED,) if together is None and by == "calibration" else ()
    return Verification(
        _worst({v.verdict for v in found} | {"undecided" for _ in compared}),
        tuple(replace(c, name=f"{name}: {c.name}", view=name) for name, v in named for c in v.changes),
        (*(r.prefixed(f"view {name!r}: ") for name, v in named for r in v.reasons), *compared),
        None,
        tuple(v.scans[0] for v in found),
        by,
    )


def verify(
    scan: Scan, old: Calibration, artefact: Artefact, limit: float = LIMIT, start_stated: bool = False
) -> Verification:
    """Compare an old calibration with a new scan of the artefact, or of a part beside which the shaft shows.

    What both scans share (certificate, mounting prior) cancels: U is the repeatability of both. A change within
    ``limit`` by more than U holds, one beyond it by more than U does not, in between is undecided. A scan that can't be
    calibrated by itself is judged by its witness band: where the sensor stands radially, and how the shaft runs.
    ``start_stated``: the table angle of the scan's first profile was given by the user. Source: what two estimates
    share cancels in their difference (GUM, JCGM 100, 5.2); decision as ISO 14253-1.

    Raises:
        NotEnoughData: the new scan can't be calibrated and shows no witness band.
        BadRecipe: a scan of a view of which the calibration is not, or that another view took.
    """
    return _verify(scan, old, artefact, limit, start_stated, None)


def _verify(
    scan: Scan, old: Calibration, artefact: Artefact, limit: float, start_stated: bool, together: Calibration | None
) -> Verification:
    """``verify`` by the scans of all views calibrated ``together``; None: by this scan alone."""
    whole, old = old, old.of_view(scan.view)
    if whole.views:
        demand_own_view(scan, whole, witness(scan, old))
    reasons = (
        *configuration_reasons(scan, old),
        *(() if old.method == "stand" else (PUBLISHED,)),
        *(reason.prefixed("the old calibration is untrusted: ") for reason in _doubts(old)),
    )
    tied = _is_tied(scan, old, start_stated)
    if not tied:
        aligned = transfer(scan, old)
        scan = aligned.scan
        if aligned.calibration.angle_zero != "witness":
            reasons = (*reasons, *(untied_reasons(scan, old) or (UNTIED,)))
    new, untrusted = _calibrated(scan, artefact, old) if together is None else _with_doubts(together.for_scan(scan))
    band = None if new is not None and _shows_artefact(new) else witness(scan, replace(old, artefact=artefact))
    if band is not None:
        return _verification(_changes_in_band(band, tied, limit), reasons, "witness", scan, new)
    if new is None:
        raise NotEnoughData(untrusted[0])
    reasons = (*(reason.prefixed("the new scan is untrusted: ") for reason in untrusted), *reasons)
    covariance, remedy = repeatability(old, new), MORE_TURNS
    if whole.views and together is None:
        covariance, remedy = covariance + told_together(old, new), EVERY_VIEW
    turn = (0.0, 0.0) if together is None else _turn(whole, together, scan.view)
    changes = _changes(old, new, artefact, limit, covariance, remedy, turn)
    reasons = (*reasons, *_by_form(changes, form_change(old, new, _plane_told(old, new))))
    return _verification(changes, reasons, "calibration", scan, new)


def _is_tied(scan: Scan, old: Calibration, start_stated: bool) -> bool:
    """Whether the scan's angle is that of the calibration."""
    return not untied_reasons(scan, old, start_stated) and old.angle_zero != "unknown"


def _calibrated_together(
    scans: tuple[Scan, ...], old: Calibration, artefact: Artefact, start_stated: bool
) -> Calibration | None:
    """The calibration of all views by new scans, as the old one was made: what steps off coaxial do to both cancels.

    None: of some views only, or where it can't be told.
    """
    by_view = {scan.view: scan for scan in scans}
    every = len(scans) > 1 and by_view.keys() == {view.name for view in old.views}
    if not every or not all(_is_tied(scan, old.for_scan(scan), start_stated) for scan in scans):
        return None
    try:
        return calibrate_views(tuple(by_view[view.name] for view in old.views), artefact)
    except TruestandError:
        return None  # each is judged by itself then


def _calibrated(scan: Scan, artefact: Artefact, old: Calibration) -> tuple[Calibration | None, tuple[Message, ...]]:
    """The new scan's own calibration, and why it is not to be trusted; its zero of the angle is judged before."""
    try:
        axes = old.positions.axes if old.positions is not None else ()
        new = calibrate_on_axes(scan, artefact, axes) if axes else calibrate(scan, artefact)
    except NotEnoughData as error:
        return None, (Message("not_calibrated", str(error)),)
    return _with_doubts(new)


def _with_doubts(new: Calibration) -> tuple[Calibration, tuple[Message, ...]]:
    return new, _doubts(new)


def _doubts(calibration: Calibration) -> tuple[Message, ...]:
    """Why it is not to be trusted; its zero of the angle is judged before."""
    return tuple(r for r in calibration.reasons if r.code != UNTIED.code)


def _shows_artefact(new: Calibration) -> bool:
    """Whether the scan showed the artefact by itself, and not a part with some shaft beside it."""
    return all(c.ok for c in new.checks if c.code in ("surfaces_told_apart", "drawing_explains_view"))


def _verification(
    changes: list[Change], undecided: tuple[Message, ...], by: By, scan: Scan, new: Calibration | None
) -> Verification:
    """The worst of the changes; nothing is decided where there are reasons why it is ``undecided``."""
    worst = _worst({c.verdict for c in changes})
    reasons = tuple(_reason(c) for c in changes if c.verdict != "holds")
    if undecided:
        worst, reasons = "undecided", undecided
    return Verification(worst, tuple(changes), reasons, new, (ScanSummary.of(scan),), by)


def _by_form(changes: list[Change], form: float) -> tuple[Message, ...]:
    """Why nothing is decided: the shaft's ``form`` (mm) is another, and no more has moved than that may explain."""
    most = {"shaft_moved": CLAMPED_AGAIN * form, "sensor_moved_along": DIRT_ALONG, "sensor_moved_radially": 0.0}
    if not form or any(c.value > most.get(c.code, c.value) for c in changes if c.verdict == "does_not_hold"):
        return ()
    text = (
        f"the shaft's form is not that of the calibration, its waves of 2 to 4 a turn differ by {1000 * form:.2f} um: "
        "it is dirty or worn, or has turned in its clamp: clean it and clamp it as it was, or calibrate again"
    )
    return (Message("form_changed", text),)


def _worst(verdicts: set[Verdict]) -> Verdict:
    return next(v for v in WORST_FIRST if v in verdicts)


def _reason(c: Change) -> Message:
    if c.verdict == "undecided":
        found = f"found {1000 * c.value:.2f} um with U {1000 * c.U:.2f} um, limit {1000 * c.limit:.2f} um"
        text = f"{c.name}: {found}: too near to decide, or not known well enough; {c.remedy}"
        return Message(f"{c.code}_undecided", text)
    return Message(c.code, f"{c.name}: {c.advice}")


def _change(
    code: str, name: str, move: tuple[float, float], advice: str, limit: float, remedy: str = MORE_TURNS
) -> Change:
    """The change by a move: its size and U, mm."""
    value, U = move
    verdict: Verdict = "undecided"
    if value + U <= limit:
        verdict = "holds"
    elif value - U > limit:
        verdict = "does_not_hold"
    return Change(code, name, value, U, limit, verdict, advice, remedy)


def _changes_in_band(band: Witness, direction: bool, limit: float) -> list[Change]:
    """What the shaft in view beside a part says; the ``direction`` counts where it doesn't tie the scan itself."""
    size = abs(band.eccentricity_size), band.eccentricity_U
    shaft = (hypot(*band.eccentricity_change), band.change_U) if direction else size
    return [
        _change("sensor_moved_radially", "sensor, radially", (abs(band.radial), band.radial_U), SENSOR_MOVED, limit),
        _change("shaft_moved", "shaft on the table", shaft, SHAFT_MOVED, limit),
    ]


def _changes(
    old: Calibration, new: Calibration, artefact: Artefact, limit: float, covariance: Array, remedy: str,
    turn: tuple[float, float],
) -> list[Change]:  # fmt: skip
    """Everything that could have moved, each at the worst of the artefact's points in view.

    ``covariance`` (8, 8): of the difference of the unknowns where nothing moved; ``remedy``: what makes it smaller;
    ``turn``: rad by which the view has turned about the axis, and sees the shaft turned the other way; its standard
    uncertainty.
    """
    points = _seen_points(new, artefact)
    before, now = unknowns_of(old)[0], unknowns_of(new)[0]
    moved = now - before
    moved[SHAFT] = _turned_by(now[SHAFT], turn[0]) - before[SHAFT]
    of_shaft = covariance.copy()
    of_shaft[ECCENTRICITY, ECCENTRICITY] += (hypot(*now[ECCENTRICITY]) * turn[1]) ** 2 * np.eye(2)
    # The largest move counts, with its own U.
    on_table = max(_move(axis_sensitivity(v), moved, of_shaft) for _, _, v in points)
    shaft = _change("shaft_moved", "shaft on the table", on_table, SHAFT_MOVED, limit, remedy)
    clamped_again = shaft.verdict == "does_not_hold"
    everything = _both(old.covariance, new.covariance)
    if clamped_again:  # its steps' axes and its form have turned with it
        covariance = everything
    told = _plane_told(old, new)
    # What the scans don't tell may have moved as far as the mounting leaves it.
    of_plane = covariance if told else everything
    radial = max(_radial_move(old, new, point, covariance) for point in points)
    sideways = max(_move(_plane_sensitivity(v), moved, of_plane) for _, _, v in points)
    changes = [
        _change("sensor_moved_radially", "sensor, radially", radial, SENSOR_MOVED, limit, remedy),
        _change("sensor_moved_sideways", "sensor, sideways", sideways, PLANE_MOVED, limit,
                remedy if told else PLANE_UNTOLD),
    ]  # fmt: skip
    along = _along(old, new, artefact, covariance)
    # An edge may be too rough for the limit: the height that rests on it is known to 0.5 mm only, too.
    if along is not None and (_shows_face(new) or along[1] < max(limit, along[0])):
        changes.append(_change("sensor_moved_along", "sensor, along the axis", along, HEIGHT_MOVED, limit, remedy))
    about = _about(old, new, artefact, clamped_again)
    if about is not None:
        changes.append(_change("sensor_moved_about", "sensor, about the axis", about, VIEWS_TURNED, limit, remedy))
    return [*changes, shaft]


def _turn(old: Calibration, new: Calibration, view: str) -> tuple[float, float]:
    """rad by which a view has turned about the axis against the one that sees the shaft least moved; standard u.

    There is one shaft, and in the angle of a view that turned it seems to have turned the other way.
    """
    pairs = {known.name: (known, new.of_view(known.name)) for known in old.views}
    if any(AZIMUTH_KEY in c.not_identifiable for pair in pairs.values() for c in pair):
        return 0.0, 0.0
    moved = {n: hypot(*(unknowns_of(b)[0] - unknowns_of(a)[0])[ECCENTRICITY]) for n, (a, b) in pairs.items()}
    still = min(moved, key=moved.__getitem__)
    if view == still:
        return 0.0, 0.0
    (own_before, own), (still_before, still_now) = both = pairs[view], pairs[still]
    u = hypot(*(azimuth_repeatability(*pair) for pair in both if pair[1].azimuth_repeats is not None))
    return wrap(own.azimuth - own_before.azimuth - still_now.azimuth + still_before.azimuth), u


def _turned_by(shaft: Array, turn: float) -> Array:
    """Eccentricity and tilt (4,), each turned by ``turn``."""
    vectors = (shaft[0::2] + 1j * shaft[1::2]) * np.exp(1j * turn)
    return np.stack([vectors.real, vectors.imag], axis=1).reshape(-1)


def _plane_told(old: Calibration, new: Calibration) -> bool:
    """Whether both scans tell where the laser plane stands; under another plane form lies elsewhere on each surface."""
    return PLANE_KEYS.isdisjoint((*old.not_identifiable, *new.not_identifiable))


def _about(old: Calibration, new: Calibration, artefact: Artefact, clamped_again: bool) -> tuple[float, float] | None:
    """By how much (mm, at the largest radius in view) a view has turned about the axis against the first, and its U.

    None for the first, and for a view that was not calibrated together with the others.
    """
    if new.azimuth_repeats is None:
        return None
    seen = {profile.surface for profile in new.static_profiles}
    radius = max(c.radius for c in artefact.cylinders if c.name in seen)
    U = K * azimuth_repeatability(old, new)
    if clamped_again:
        U = radians(hypot(*(c.uncertainty[AZIMUTH_KEY].U for c in (old, new) if AZIMUTH_KEY in c.uncertainty)))
    if AZIMUTH_KEY in (*old.not_identifiable, *new.not_identifiable):
        U = pi
    return radius * abs(wrap(new.azimuth - old.azimuth)), radius * U


def _along(old: Calibration, new: Calibration, artefact: Artefact, covariance: Array) -> tuple[float, float] | None:
    """By how much (mm) the sensor has moved along the shaft, told by the shoulder's face or edge, and its U.

    None where one scan shows the face and the other its edge, or neither; nor can a record from before heights had a
    repeatability tell an edge from nothing.
    """
    if new.height_repeats is None or _shows_face(old) != _shows_face(new):
        return None
    if old.height_repeats is None and not _shows_face(old):
        return None
    radius = new.shoulder_radius
    phi, radial, height, _, _ = sensor_parameters(new.table_from_sensor)
    x, z = LaserPlane(phi, radial, height).from_uv(np.array(radius), np.array(artefact.shoulder))
    after, before = (in_table(c.table_from_sensor, x, z)[1] for c in (new, old))
    lever = np.zeros((1, UNKNOWNS))
    lever[0, PHI] = radius - radial
    repeats = hypot(new.height_repeats, new.height_repeats if old.height_repeats is None else old.height_repeats)
    return abs(float(after - before)), hypot(K * repeats, _expanded(lever, covariance))


def _shows_face(calibration: Calibration) -> bool:
    """Whether its height 0 was told by the shoulder's face."""
    return "height" not in calibration.not_identifiable


def _both(old: Array, new: Array) -> Array:
    """The sum of two covariances; a record without one has the new scan's."""
    return new + (old if old.size else new)


def _seen_points(new: Calibration, artefact: Artefact) -> list[tuple[float, float, float]]:
    """Sensor readings x, z (mm) at the ends of the artefact's cylinders as far as seen, and their height v."""
    phi, radial, height, _, _ = sensor_parameters(new.table_from_sensor)
    plane = LaserPlane(phi, radial, height)
    points = []
    for profile in new.static_profiles:
        radius = next(c.radius for c in artefact.cylinders if c.name == profile.surface)
        for v in (float(profile.height[0]), float(profile.height[-1])):
            x, z = plane.from_uv(np.array(radius), np.array(v))
            points.append((float(x), float(z), v))
    return points


def _radial_move(
    old: Calibration, new: Calibration, point: tuple[float, float, float], covariance: Array
) -> tuple[float, float]:
    """By how much (mm) a reading's radial position differs between the calibrations, and its U."""
    x, z, v = point
    phi, _, height, _, _ = sensor_parameters(new.table_from_sensor)
    sensitivity = np.zeros((1, UNKNOWNS))
    sensitivity[0, [PHI, RADIAL]] = -facing(phi) * (v - height), 1.0
    after, before = (in_table(c.table_from_sensor, np.array(x), np.array(z))[0] for c in (new, old))
    return abs(float(after - before)), _expanded(sensitivity, covariance)


def _plane_sensitivity(v: float) -> Array:
    """How the laser plane's offset at a height (mm) follows the unknowns: (1, 8)."""
    sensitivity = np.zeros((1, UNKNOWNS))
    sensitivity[0, [PLANE_OFFSET, PLANE_TILT]] = 1.0, v
    return sensitivity


def _move(sensitivity: Array, moved: Array, covariance: Array) -> tuple[float, float]:
    """Distance (mm) by which a point moves that follows the unknowns by (n, 8), and its U."""
    return float(np.linalg.norm(sensitivity @ moved)), _expanded(sensitivity, covariance)


def _expanded(sensitivity: Array, covariance: Array) -> float:
    """U (k = 2) in the direction in which it is largest."""
    return K * sqrt(max(float(np.linalg.eigvalsh(sensitivity @ covariance @ sensitivity.T)[-1]), 0.0))
