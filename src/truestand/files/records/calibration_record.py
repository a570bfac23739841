"""calibration.json and verification.json: mm and rad inside, the units in the keys outside.

Records are versioned and append-only: a reader here understands every version ever written, and a key once written
keeps its meaning (docs/decisions/0003).
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from truestand.core.arrays import Array
from truestand.core.calibration import (
    VIEW_UNKNOWNS,
    Calibration,
    Check,
    Contribution,
    Harmonic,
    JointCovariance,
    PaperFigures,
    Positions,
    Residuals,
    ScanSummary,
    Separated,
    StaticProfile,
    StepAxis,
    Uncertainty,
)
from truestand.core.errors import UnreadableFile
from truestand.core.frames import Pose, about_axis, own_shaft_from_rotor, shaft_parameters
from truestand.core.message import UNTIED, Message
from truestand.core.scan import AngleSource, AngleZero
from truestand.core.stand import Sensor, Stand, Table
from truestand.files.atomic import write_json_atomic
from truestand.files.checking import refuse_other_types
from truestand.files.recipes.recipes import shaft_from_recipe, shaft_recipe, stand_from_recipe, stand_recipe
from truestand.files.records.record import (
    NO_CODE,
    SOFTWARE,
    Record,
    assumptions_record,
    messages_record,
    now,
    read_json,
    read_messages,
    scan_record,
    without_nan,
)
from truestand.uncertainty.assumed import assumptions_of

if TYPE_CHECKING:
    from truestand.apply.verify import Verification

FORMAT = "truestand.calibration"
VERSION = 2
LEAST_COS_TILT = 1e-3
"""Of a shaft: one that lies across the table's axis has no eccentricity."""
MOST_MM = 1e9
"""No stand is larger."""
UM, MRAD = 1000.0, 1000.0
"""um in a mm, mrad in a rad."""


def calibration_record(calibration: Calibration, created: str) -> Record:
    """The record (CONTRACT.md) of a calibration; ``created`` is an ISO time."""
    c = calibration
    record: Record = {
        "format": FORMAT,
        "version": VERSION,
        "status": c.status,
        "reasons": messages_record(c.reasons),
        "method": c.method,
        "created": created,
        "valid_until": c.valid_until,
        "software": SOFTWARE,
        "scan": None if c.scan is None else scan_record(c.scan),
        "stand": stand_recipe(c.stand),
        "artefact": None if c.artefact is None else shaft_recipe(c.artefact),
        "table": {
            "direction": c.stand.table.direction,
            "angle_source": c.angle_source,
            "angle_zero": c.angle_zero,
            "rad_per_profile": c.rad_per_profile,
            "speed_factor": c.speed_factor,
        },
        "sensor": _sensor(c),
        "shaft": {
            "shaft_from_rotor": c.shaft_from_rotor.matrix.tolist(),
            "eccentricity_um": UM * c.eccentricity,
            "eccentricity_direction_deg": _degrees(c.eccentricity_direction),
            "eccentricity_vector": _vector(c),
            "tilt_mrad": None if c.tilt is None else MRAD * c.tilt,
            "tilt_direction_deg": _degrees(c.tilt_direction),
        },
        **_measured(c),
        "assumptions": assumptions_record(assumptions_of(c, ())),
    }
    if c.views:
        record["sensors"] = [_view(view) for view in c.views]
    if c.joint is not None:
        record["joint"] = {"views": list(c.joint.views), "matrix": c.joint.matrix.tolist()}
    if c.paper is not None:
        record["paper"] = {
            "bin": c.paper.bin,
            "bin_amplitude_um": UM * c.paper.bin_amplitude,
            "fit_amplitude_um": UM * c.paper.fit_amplitude,
            "phase_error_pi": c.paper.phase_error_pi,
            "arcsine_shift_pi": c.paper.arcsine_shift_pi,
        }
    if c.positions is not None:
        record["positions"] = _positions(c.positions)
    return without_nan(record)


def _sensor(c: Calibration) -> Record:
    """Where a sensor stands; ``table_from_sensor`` into T, the table of the first view."""
    return {
        "name": c.name,
        "table_from_sensor": (c.first_from_table @ c.table_from_sensor).matrix.tolist(),
        "phi_deg": math.degrees(c.phi),
        "laser_plane_tilt_deg": _degrees(c.plane_tilt),
        "laser_plane_offset_mm": c.plane_offset,
    }


def _view(c: Calibration) -> Record:
    """A sensor of several: where it stands in T, and what its own scan told."""
    return {
        **_sensor(c),
        "azimuth_deg": math.degrees(c.azimuth),
        "height_mm": c.height,
        "status": c.status,
        "reasons": messages_record(c.reasons),
        "scan": None if c.scan is None else scan_record(c.scan),
        "stand": stand_recipe(c.stand),
        "rad_per_profile": c.rad_per_profile,
        "speed_factor": c.speed_factor,
        **_measured(c),
    }


def _measured(c: Calibration) -> Record:
    """What a scan told beside the poses."""
    return {
        "residuals": None if c.residuals is None else _residuals(c.residuals),
        "harmonics": [_harmonic(h) for h in c.harmonics],
        "static_profiles": [
            {
                "surface": s.surface,
                "height_mm": s.height.tolist(),
                "deviation_um": (UM * s.deviation).tolist(),
            }
            for s in c.static_profiles
        ],
        "uncertainty": {
            key: {"U": u.U, "k": u.k, "U_monte_carlo": u.monte_carlo, "contributions": _lines(u)}
            for key, u in c.uncertainty.items()
        },
        "covariance": {
            "names": list(c.covariance_names),
            "matrix": c.covariance.tolist(),
            "repeatability": c.repeatability.tolist(),
            "height_repeats_um": None if c.height_repeats is None else UM * c.height_repeats,
            "azimuth_repeats_deg": None if c.azimuth_repeats is None else math.degrees(c.azimuth_repeats),
        },
        "not_identifiable": list(c.not_identifiable),
        "checks": [
            {
                "code": k.code,
                "name": k.name,
                "value": k.value,
                "limit": k.limit,
                "ok": k.ok,
                "advice": k.advice,
                "text": str(k.reason),
            }
            for k in c.checks
        ],
    }


def verification_record(verification: "Verification", created: str, calibration_sha256: str) -> Record:
    """The record of a verification: what moved, against which limit, and what to do."""
    v = verification
    record: Record = {
        "format": "truestand.verification",
        "version": VERSION,
        "verdict": v.verdict,
        "reasons": messages_record(v.reasons),
        "created": created,
        "software": SOFTWARE,
        "calibration": {"sha256": calibration_sha256},
        "scan": scan_record(v.scans[0]),
        "by": v.by,
        "changes": [
            {
                "code": c.code,
                "name": c.name,
                "value_um": UM * c.value,
                "U_um": UM * c.U,
                "limit_um": UM * c.limit,
                "verdict": c.verdict,
                "advice": c.advice,
                **({} if c.view is None else {"view": c.view}),
            }
            for c in v.changes
        ],
    }
    if len(v.scans) > 1:
        record["scans"] = [scan_record(scan) for scan in v.scans]
    return without_nan(record)


def write_calibration(path: Path | str, calibration: Calibration, created: str | None = None) -> Record:
    """Write calibration.json (as a whole or not at all) and return its content.

    ``created`` is an ISO time; the present one where none is given.
    """
    created = created or calibration.created or now()
    record = calibration_record(calibration, created)
    write_json_atomic(Path(path), record)
    return record


def read_calibration(path: Path | str) -> Calibration:
    """A calibration from its record, of any version ever written.

    ``format``, ``version``, ``table``, ``sensor`` and ``shaft`` alone will do.

    Raises:
        UnreadableFile: no JSON, no calibration, a newer version, or transforms that are no rigid motion.
    """
    path = Path(path)
    record = read_json(path)
    if record.get("format") != FORMAT:
        raise UnreadableFile(f"{path}: found format {record.get('format')!r}, need {FORMAT!r}; give a calibration.json")
    version = record.get("version")
    if not isinstance(version, int) or version > VERSION:
        raise UnreadableFile(f"{path}: found version {version!r}, this truestand reads up to {VERSION}; update it")
    try:
        calibration = _calibration(record)
        refuse_other_types(calibration, Calibration, "calibration")
        return calibration
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError) as wrong:
        raise UnreadableFile(f"{path}: the calibration record is incomplete or malformed ({wrong!r})") from wrong


def _calibration(record: Record) -> Calibration:
    table, sensor, shaft = record["table"], record["sensor"], record["shaft"]
    stand = stand_from_recipe(record["stand"]) if record.get("stand") else _stand_of(table, sensor)
    if table.get("direction", stand.table.direction) != stand.table.direction:
        raise ValueError(f"found direction {table['direction']!r} beside a stand that turns {stand.table.direction!r}")
    source = table.get("angle_source", "index")
    calibration = Calibration(
        method="paper" if record.get("method") == "paper" else "stand",
        table_from_sensor=_pose(sensor["table_from_sensor"], "table_from_sensor"),
        shaft_from_rotor=_upright(_pose(shaft["shaft_from_rotor"], "shaft_from_rotor")),
        stand=stand,
        angle_source=source,
        angle_zero=_angle_zero(table, source),
        speed_factor=_speed_factor(table, stand),
        rad_per_profile=table.get("rad_per_profile"),
        artefact=shaft_from_recipe(record["artefact"]) if record.get("artefact") else None,
        reasons=_reasons(record, _angle_zero(table, source)),
        scan=_read_scan(record.get("scan")),
        paper=_read_paper(record.get("paper")),
        positions=_read_positions(record.get("positions")),
        joint=_read_joint(record.get("joint")),
        software=record.get("software", ""),
        created=record.get("created"),
        valid_until=record.get("valid_until"),
        **_read_measured(record),
    )
    return replace(calibration, views=tuple(_read_view(s, calibration) for s in record.get("sensors", [])))


def _read_view(record: Record, first: Calibration) -> Calibration:
    """A view of several, in frames of its own; ``first``: the calibration of the first view."""
    azimuth, height = math.radians(record["azimuth_deg"]), float(record["height_mm"])
    place = about_axis(azimuth, height)
    pose = place.inverse @ _pose(record["table_from_sensor"], "table_from_sensor")
    return replace(
        first,
        table_from_sensor=pose,
        shaft_from_rotor=own_shaft_from_rotor(first.shaft_from_rotor, place),
        azimuth=azimuth,
        height=height,
        stand=stand_from_recipe(record["stand"]),
        speed_factor=record["speed_factor"],
        rad_per_profile=record["rad_per_profile"],
        reasons=read_messages(record.get("reasons", ())),
        scan=_read_scan(record.get("scan")),
        joint=None,
        **_read_measured(record),
    )


def _read_joint(joint: Any) -> JointCovariance | None:
    if joint is None:
        return None
    views, matrix = tuple(joint["views"]), _matrix(joint["matrix"])
    if matrix.shape[0] != VIEW_UNKNOWNS * len(views):
        raise ValueError(f"joint: found shape {matrix.shape} for {len(views)} views, need {VIEW_UNKNOWNS} rows each")
    return JointCovariance(views, matrix)


def _read_measured(record: Record) -> dict[str, Any]:
    """What ``_measured`` wrote, by the fields of a calibration."""
    covariance = record.get("covariance") or {}
    height_repeats, azimuth_repeats = (covariance.get(key) for key in ("height_repeats_um", "azimuth_repeats_deg"))
    return {
        "residuals": _read_residuals(record.get("residuals")),
        "harmonics": tuple(_read_harmonic(h) for h in record.get("harmonics", [])),
        "static_profiles": tuple(
            _static_profile(s["surface"], _array(s["height_mm"]), _array(s["deviation_um"]) / UM)
            for s in record.get("static_profiles", [])
        ),
        "uncertainty": {k: _uncertainty(u) for k, u in (record.get("uncertainty") or {}).items()},
        "covariance_names": tuple(covariance.get("names", ())),
        "covariance": _matrix(covariance.get("matrix")),
        "repeatability": _matrix(covariance.get("repeatability")),
        "height_repeats": None if height_repeats is None else height_repeats / UM,
        "azimuth_repeats": None if azimuth_repeats is None else math.radians(azimuth_repeats),
        "not_identifiable": tuple(record.get("not_identifiable", ())),
        "checks": tuple(
            Check(c.get("code", NO_CODE), c["name"], c["value"], c["limit"], c["ok"], c["advice"])
            for c in record.get("checks", [])
        ),
    }


def _angle_zero(table: Mapping[str, Any], source: AngleSource) -> AngleZero:
    """From where the table's angle counts; nobody knows where the record doesn't say and there is no index."""
    stated: AngleZero | None = table.get("angle_zero")
    return stated or ("index" if source in ("angle", "encoder") else "unknown")


def _reasons(record: Record, angle_zero: AngleZero) -> tuple[Message, ...]:
    reasons = read_messages(record.get("reasons", ()))
    if angle_zero == "unknown" and UNTIED.code not in {r.code for r in reasons}:
        reasons = (*reasons, UNTIED)
    if record.get("status") not in (None, "valid", "untrusted"):
        raise ValueError(f"found status {record['status']!r}, need valid or untrusted")
    if record.get("status") == "untrusted" and not reasons:
        return (Message("no_reason_given", "the record says untrusted and gives no reason"),)
    return reasons


def _pose(matrix: Any, name: str) -> Pose:
    array = np.asarray(matrix, dtype=np.float64)
    if array.shape != (4, 4) or not np.isfinite(array).all():
        raise ValueError(f"{name}: found shape {array.shape}, need a finite 4x4 matrix")
    if np.abs(array).max() > MOST_MM:
        raise ValueError(f"{name}: found {np.abs(array).max():.3g}, need mm of a stand")
    pose = Pose.from_matrix(array)
    drift = np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max()
    if not drift <= 1e-6 or np.linalg.det(pose.rotation) < 0 or not np.allclose(array[3], [0, 0, 0, 1]):
        raise ValueError(f"{name}: found no proper rotation (|R Rt - 1| = {drift:.2g}), need a rigid transform")
    return pose


def _upright(pose: Pose) -> Pose:
    """A shaft's pose, whose eccentricity and tilt are those of an axis that crosses the plane Z = 0."""
    if abs(pose.rotation[2, 2]) < LEAST_COS_TILT:
        raise ValueError("shaft_from_rotor: found a shaft that lies across the table's axis, need one along it")
    return pose


def _static_profile(surface: str, height: Array, deviation: Array) -> StaticProfile:
    if height.ndim != 1 or deviation.shape != height.shape:
        raise ValueError(f"static_profiles: found {height.shape} heights and {deviation.shape} deviations, need pairs")
    return StaticProfile(surface, height, deviation)


def _stand_of(table: Mapping[str, Any], sensor: Mapping[str, Any]) -> Stand:
    """The least stand that a record without one implies: its direction, and one step of angle a profile."""
    step = table.get("rad_per_profile")
    return Stand(
        Table(speed=step, direction=table.get("direction", "ccw")),
        (Sensor(name=sensor.get("name", "sensor"), profile_rate=None if step is None else 1.0),),
    )


def _speed_factor(table: Mapping[str, Any], stand: Stand) -> float:
    """Estimated over stated table speed; from the step a profile where an older or foreign record lacks the factor."""
    if table.get("speed_factor") is not None:
        return float(table["speed_factor"])
    step, speed, rate = table.get("rad_per_profile"), stand.table.speed, stand.sensor.profile_rate
    return float(step) * rate / speed if step and speed and rate else 1.0


def _vector(c: Calibration) -> Record:
    """The eccentricity as a vector in R with its ellipse: what holds where it is too small to have a direction."""
    x, y, _, _ = shaft_parameters(c.shaft_from_rotor)
    ellipse = c.eccentricity_ellipse
    known = (
        {}
        if ellipse is None
        else {
            "U_major_um": UM * ellipse.major,
            "U_minor_um": UM * ellipse.minor,
            "major_direction_deg": math.degrees(ellipse.direction),
        }
    )
    return {"x_um": UM * x, "y_um": UM * y, **known}


def _read_scan(s: Any) -> ScanSummary | None:
    return None if s is None else ScanSummary(s["sha256"], s["profiles"], s["points"], s["revolutions"], s["seen"])


def _residuals(r: Residuals) -> Record:
    return {"rms_um": UM * r.rms, "p90_um": UM * r.p90, "points": int(r.points), "rejected": int(r.rejected)}


def _read_residuals(r: Any) -> Residuals | None:
    return None if r is None else Residuals(r["rms_um"] / UM, r["p90_um"] / UM, r["points"], r["rejected"])


def _read_paper(p: Any) -> PaperFigures | None:
    if p is None:
        return None
    return PaperFigures(
        p["bin"],
        p["bin_amplitude_um"] / UM,
        p["fit_amplitude_um"] / UM,
        p["phase_error_pi"],
        p["arcsine_shift_pi"],
    )


def _harmonic(h: Harmonic) -> Record:
    return {
        "surface": h.surface, "upr": h.upr, "amplitude_um": UM * h.amplitude, "phase_deg": math.degrees(h.phase),
    }  # fmt: skip


def _read_harmonic(h: Any) -> Harmonic:
    return Harmonic(h["surface"], int(h["upr"]), h["amplitude_um"] / UM, math.radians(h["phase_deg"]))


def _positions(p: Positions) -> Record:
    """The block ``positions``: what several clampings of the shaft told apart."""
    return {
        "clamped_deg": [math.degrees(a) for a in p.clamped],
        "scans": list(p.scans),
        "axes": [
            {
                "surface": a.surface,
                "x_um": UM * a.x,
                "y_um": UM * a.y,
                "slope_x_mrad": MRAD * a.slope_x,
                "slope_y_mrad": MRAD * a.slope_y,
                "height_mm": a.height,
                "U_um": UM * a.U,
            }
            for a in p.axes
        ],
        "form": [_separated(s) for s in p.form],
        "bearing": [_separated(s) for s in p.bearing],
        "inseparable": list(p.inseparable),
    }


def _read_positions(p: Any) -> Positions | None:
    if p is None:
        return None
    return Positions(
        clamped=tuple(math.radians(a) for a in p["clamped_deg"]),
        scans=tuple(p["scans"]),
        axes=tuple(_read_axis(a) for a in p["axes"]),
        form=tuple(_read_separated(s) for s in p["form"]),
        bearing=tuple(_read_separated(s) for s in p["bearing"]),
        inseparable=tuple(p["inseparable"]),
    )


def _separated(s: Separated) -> Record:
    return {**_harmonic(s.harmonic), "U_um": UM * s.U}


def _read_separated(s: Any) -> Separated:
    return Separated(_read_harmonic(s), s["U_um"] / UM)


def _read_axis(a: Any) -> StepAxis:
    x, y, slope_x, slope_y, U = (a[k] / UM for k in ("x_um", "y_um", "slope_x_mrad", "slope_y_mrad", "U_um"))
    return StepAxis(a["surface"], x, y, slope_x, slope_y, a["height_mm"], U)


def _uncertainty(u: Any) -> Uncertainty:
    lines = tuple(
        Contribution(
            c["name"], c["U"], c.get("value"), c.get("distribution", "normal"), c.get("sensitivity"),
            math.inf if c.get("dof") is None else c["dof"],
        )
        for c in u.get("contributions", [])
    )  # fmt: skip
    if u["U"] is not None and u["U"] < 0:
        raise ValueError(f"found U {u['U']}, need 0 or more")
    return Uncertainty(u["U"], u["k"], lines, u.get("U_monte_carlo"))


def _lines(u: Uncertainty) -> list[Record]:
    """The budget's lines; null degrees of freedom are infinite."""
    return [
        {
            "name": c.name,
            "U": c.U,
            "value": c.value,
            "distribution": c.distribution,
            "sensitivity": c.sensitivity,
            "dof": None if math.isinf(c.dof) else c.dof,
        }
        for c in u.contributions
    ]


def _matrix(rows: Any) -> Array:
    matrix = _array(rows or np.zeros((0, 0)))
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
        raise ValueError(f"covariance: found shape {matrix.shape}, need a square matrix")
    if (np.diag(matrix) < 0).any():
        raise ValueError("covariance: found a negative variance")
    return matrix


def _array(values: Any) -> Array:
    return np.array(values, dtype=np.float64)


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else math.degrees(angle)
