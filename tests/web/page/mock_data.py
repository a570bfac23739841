"""What a stand with a few days of work behind it would answer: records, entries, trends, a cloud. All of it made up."""

from functools import cache
from typing import Any

import numpy as np

from truestand.files.records.inspection_record import with_limits

Json = dict[str, Any]
LONG_NAME = "Sun wheel of the second planetary stage, hobbed and shaved, drawing 4711-0815-42 rev. F"
PARTS: list[Json] = [
    {"name": "demo-wheel", "title": "Demo wheel", "kind": "gear", "file": "gear.toml"},
    {"name": "pump-shaft", "title": "Pump shaft", "kind": "turned", "file": "pump-shaft.toml"},
    {"name": "bracket", "title": "Bracket, cast", "kind": "cad", "file": "bracket.toml"},
    {
        "name": "sun-wheel",
        "title": LONG_NAME,
        "kind": "gear",
        "file": "sun-wheel-of-the-second-stage-4711-0815-42.toml",
    },
]
CLASS = "ISO 1328-1:2013 class 7"
HOSTILE = "<img src=x onerror=\"document.title='owned'\">"

# name, flank, value, U, limit, verdict; um
LINES: list[tuple[str, str | None, float, float, float | None, str | None]] = [
    ("f_p", "left", 17.7067, 1.8169, 12.0, "does_not_conform"),
    ("f_p", "right", 9.9494, 1.8259, 12.0, "conforms"),
    ("F_p", "left", 31.1197, 9.9065, 35.0, "undecided"),
    ("F_p", "right", 22.7726, 9.8973, 35.0, "conforms"),
    ("f_u", "left", 31.2088, 1.673, None, None),
    ("f_u", "right", 20.1554, 2.2065, None, None),
    ("F_r", None, 47.8384, 4.0529, 31.0, None),
    ("F_alpha", "left", 3.6895, 16.332, 16.0, "undecided"),
    ("F_alpha", "right", 3.8125, 6.3467, 16.0, "conforms"),
    ("f_falpha", "left", 0.0, 0.8248, 12.0, "conforms"),
    ("f_falpha", "right", 1.21, 0.9222, 12.0, "conforms"),
    ("f_Halpha", "left", 3.0631, 4.9085, 9.5, "conforms"),
    ("f_Halpha", "right", -2.964, 4.7169, 9.5, "conforms"),
    ("F_beta", "left", 3.0401, 5.9784, 18.0, "conforms"),
    ("F_beta", "right", 3.0528, 5.1077, 18.0, "conforms"),
    ("f_fbeta", "left", 2.9338, 0.214, 13.0, "conforms"),
    ("f_fbeta", "right", 2.9357, 0.2012, 13.0, "conforms"),
    ("f_Hbeta", "left", -0.2945, 6.3026, 12.0, "conforms"),
    ("f_Hbeta", "right", 0.2904, 6.4168, 12.0, "conforms"),
    ("C_beta", "left", 3.9975, 0.2845, None, None),
    ("C_beta", "right", 4.0052, 0.267, None, None),
]
SIZES: list[tuple[str, float, float, list[float] | None, str | None]] = [
    ("s", 3.11741, 0.0043, [3.1, 3.13], "conforms"),
    ("W_k", 15.4102, 0.0408, None, None),
    ("M_d", 52.7225, 0.1009, None, None),
    ("d_a", 51.99968, 0.02207, None, None),
    ("d_f", 42.99983, 0.02206, None, None),
]
BUDGET = ("angle, once per turn: speed of the table (assumed)", "incidence on the flanks (assumed)", "noise")


def inspection_record(verdict: str, rng: np.random.Generator) -> Json:
    """inspection.json of a gear."""
    good = verdict == "conforms"
    lines = [_line(*line, good=good) for line in LINES] + [_size(*size) for size in SIZES]
    for name in ("F_alpha", "f_Halpha", "F_beta", "f_Hbeta"):
        for flank in ("left", "right"):
            lines += [_tooth(name, flank, tooth, float(rng.normal(2.0, 3.0))) for tooth in range(1, 25)]
    if not good:
        lines.append(_unseen("M_d", None))
        lines += [_unseen("F_pk", flank) for flank in ("left", "right")]
    record = {
        "format": "truestand.inspection",
        "version": 1,
        "verdict": verdict,
        "reasons": [],
        "remarks": ["coarse near the root: one profile a 3.3 mm of roll length at its lower end", f"note: {HOSTILE}"],
        "part": {"kind": "gear", "name": "demo wheel", "serial": "A-0042", "order": "P-7781"},
        "characteristics": lines,
        "defects": [] if good else [_dent(5, "left", 57.7), _dent(16, "right", 26.1)],
        "defect_limit_um": 50.0,
        "settings": {"datum": "the shaft's base: Z of C", "decision": "ISO 14253-1:2017, guard band 1.65 u; k = 2"},
        "published": [],
        "calibration": {"sha256": "2ab50632" * 8, "status": "valid", "created": "2026-11-20T06:02:11Z"},
        "scan": {"sha256": "4940924c" * 8, "profiles": 11000, "points": 640, "revolutions": 2.75, "seen": 0.9466},
        "software": "truestand 0.1.0",
        "created": "2026-11-21T18:33:26Z",
    }
    return with_limits(record)


def _line(
    name: str, flank: str | None, value: float, U: float, limit: float | None, verdict: str | None, *, good: bool
) -> Json:
    if good and verdict is not None and limit is not None:
        value, U, verdict = np.clip(value, -0.4 * limit, 0.4 * limit), min(U, 0.2 * limit), "conforms"
    return {
        "name": name, "flank": flank, "tooth": None, "value_um": float(value), "U_um": U, "limit_um": limit,
        "grade": None if limit is None else 7, "coverage": 0.62 if name == "C_beta" else 1.0,
        "status": "partial" if name == "C_beta" else "measured", "verdict": verdict,
        "capable": limit is None or limit > U, "standard": None if limit is None else CLASS,
        "contributions": [{"name": n, "U_um": U * share} for n, share in zip(BUDGET, (0.9, 0.4, 0.1), strict=True)],
    }  # fmt: skip


def _size(name: str, value: float, U: float, limits: list[float] | None, verdict: str | None) -> Json:
    return {
        "name": name, "flank": None, "tooth": None, "value_mm": value, "U_mm": U, "limits_mm": limits, "grade": None,
        "coverage": 1.0, "status": "measured", "verdict": verdict, "capable": True, "standard": None,
        "contributions": [{"name": BUDGET[0], "U_mm": U}],
    }  # fmt: skip


def _tooth(name: str, flank: str, tooth: int, value: float) -> Json:
    return {
        "name": name, "flank": flank, "tooth": tooth, "value_um": value, "U_um": 4.9, "limit_um": 16.0, "grade": 5,
        "coverage": 1.0, "status": "measured", "verdict": "conforms", "capable": True, "standard": CLASS,
    }  # fmt: skip


def _unseen(name: str, flank: str | None) -> Json:
    return {
        "name": name, "flank": flank, "tooth": None, "value_um": None, "U_um": None, "limit_um": 20.0, "grade": None,
        "coverage": 0.12, "status": "not_measurable", "verdict": "undecided", "capable": True, "standard": CLASS,
        "contributions": [],
    }  # fmt: skip


def _dent(tooth: int, flank: str, depth: float) -> Json:
    return {
        "tooth": tooth, "flank": flank, "roll_length_mm": 8.14, "height_mm": 15.0, "depth_um": depth,
        "extent_mm": 1.05, "kind": "dent", "score": 216.9, "second_score": None,
    }  # fmt: skip


QUANTITIES: list[tuple[str, str, str, float, float]] = [
    ("eccentricity_um", "Eccentricity", "µm", 878.897, 1.346),
    ("eccentricity_direction_deg", "Direction of the eccentricity", "°", 39.999, 0.182),
    ("tilt_mrad", "Tilt of the shaft", "mrad", 0.39847, 0.0509),
    ("phi_deg", "Angle of the sensor, phi", "°", -41.80199, 0.05399),
    ("laser_plane_tilt_deg", "Laser-plane tilt", "°", 0.09908, 0.04497),
    ("laser_plane_offset_mm", "Laser-plane offset", "mm", 0.14993, 0.03893),
    ("radial_position_mm", "Radial position", "mm", 75.82305, 0.0567),
]


def calibration_record(status: str) -> Json:
    """calibration.json, as far as the page reads it."""
    value = {name: v for name, _, _, v, _ in QUANTITIES}
    bad = status == "untrusted"
    table = ((-0.745, 0.0, -0.667, 75.82305), (0.0, -1.0, 0.0, 0.026), (-0.667, 0.0, 0.745, -71.82), (0, 0, 0, 1))
    return {
        "format": "truestand.calibration",
        "version": 1,
        "status": status,
        "reasons": ["residual, um rms: 141 is above 100; look at the residual map: dirt, a keyway, a loose shaft"]
        * bad,
        "method": "stand",
        "created": "2026-11-20T06:02:11Z",
        "valid_until": "2026-11-27T06:02:11Z",
        "software": "truestand 0.1.0",
        "scan": {"sha256": "4940924c" * 8, "profiles": 11000, "points": 640, "revolutions": 2.75, "seen": 0.7297},
        "artefact": {"name": "shaft M"},
        "sensor": {
            "name": "front",
            "table_from_sensor": table,
            "phi_deg": value["phi_deg"],
            "laser_plane_tilt_deg": value["laser_plane_tilt_deg"],
            "laser_plane_offset_mm": value["laser_plane_offset_mm"],
        },
        "shaft": {
            "eccentricity_um": value["eccentricity_um"],
            "eccentricity_direction_deg": value["eccentricity_direction_deg"],
            "tilt_mrad": value["tilt_mrad"],
            "tilt_direction_deg": 109.9,
        },
        "residuals": {"rms_um": 141.4 if bad else 3.414, "p90_um": 5.6177, "points": 5052977, "rejected": 16},
        "harmonics": [
            {"surface": s, "upr": n, "amplitude_um": 85.0 / n**4 + (12.0 if (s, n) == ("bearing", 3) else 0.0)}
            for s in ("base", "bearing")
            for n in range(2, 9)
        ],
        "static_profiles": [
            {"surface": s, "height_mm": h.tolist(), "deviation_um": (2.0 * np.sin(h / 5.0)).tolist()}
            for s, h in (("base", np.linspace(-58, -2, 40)), ("bearing", np.linspace(2, 33, 25)))
        ],
        "uncertainty": {
            name: {
                "U": U,
                "k": 2.0,
                "U_monte_carlo": U * 1.01,
                "contributions": [
                    {"name": text, "U": U * share}
                    for text, share in (("linearity of the sensor", 0.95), ("coaxiality of the steps", 0.3))
                ],
            }
            for name, _, _, _, U in QUANTITIES
        },
        "not_identifiable": ["height"],
        "checks": [
            {"name": "revolutions", "value": 2.75, "limit": 0.9, "ok": True, "advice": "scan at least one full turn"},
            {
                "name": "residual, um rms",
                "value": 141.4 if bad else 3.414,
                "limit": 100.0,
                "ok": not bad,
                "advice": "look at the residual map: dirt, a keyway, a loose shaft or a wrong drawing",
            },
            {"name": "readings seen, share", "value": 0.73, "limit": 0.2, "ok": True, "advice": "check exposure"},
        ],
    }


def verification_record() -> Json:
    """verification.json."""
    return {
        "format": "truestand.verification", "version": 1, "verdict": "holds", "reasons": [],
        "created": "2026-11-21T06:02:11Z", "software": "truestand 0.1.0", "by": "calibration",
        "calibration": {"sha256": "2ab50632" * 8},
        "scan": {"sha256": "4940924c" * 8, "profiles": 11000, "points": 640, "revolutions": 2.75, "seen": 0.73},
        "changes": [
            {"name": "sensor", "value_um": 1.9, "U_um": 2.2, "limit_um": 10.0, "verdict": "holds", "advice": ""},
            {"name": "shaft", "value_um": 3.4, "U_um": 1.1, "limit_um": 10.0, "verdict": "holds", "advice": ""},
        ],
    }  # fmt: skip


def history(kind: str) -> Json:
    """Trends with control limits; one finding."""
    rng = np.random.default_rng(5)
    lines = (
        [(n, label, unit, v, U, None) for n, label, unit, v, U in QUANTITIES]
        if kind == "calibration"
        else [(f"{n} {f}" if f else n, f"{n} {f or ''}".strip(), "µm", v, U, t) for n, f, v, U, t, _ in LINES]
    )
    return {"quantities": [_trend(*line, rng=rng, finding=at == 0) for at, line in enumerate(lines)]}


def _trend(
    name: str,
    label: str,
    unit: str,
    value: float,
    U: float,
    limit: float | None,
    *,
    rng: np.random.Generator,
    finding: bool,
) -> Json:
    drawn = value + 0.35 * U * rng.standard_normal(24)
    drawn[-1] += 2.2 * U if finding else 0.0
    points = [
        {"number": 10 + i, "time": f"2026-11-{1 + i * 20 // 24:02d}T{6 + i % 12:02d}:02:11Z", "value": float(v), "U": U}
        for i, v in enumerate(drawn)
    ]
    texts = (
        [{"number": 33, "text": "outside the control limits: look whether the sensor was knocked"}] if finding else []
    )
    found = {
        "name": name, "label": label, "unit": unit, "points": points, "centre": value, "lower": value - 1.05 * U,
        "upper": value + 1.05 * U, "findings": texts,
    }  # fmt: skip
    return found if limit is None else found | {"limit": limit}


@cache
def cloud(points: int) -> bytes:
    """A spur gear of 24 teeth: uint32 n, then x, y, z (mm) and the deviation (um), float32."""
    rng = np.random.default_rng(1)
    angle = rng.uniform(0.0, 2.0 * np.pi, points)
    wave = np.clip(2.4 * np.cos(24.0 * angle), -1.0, 1.0)
    radius = 47.5 / 2 + 2.25 * wave + 0.004 * rng.standard_normal(points)
    height = rng.uniform(5.0, 25.0, points)
    faces = rng.random(points) < 0.35
    radius[faces] = np.sqrt(rng.uniform(0.3, 1.0, faces.sum())) * radius[faces]
    height[faces] = 25.0
    deviation = 9.0 * np.cos(angle - 1.0) + 3.0 * wave + 1.5 * rng.standard_normal(points)
    deviation -= 55.0 * np.exp(-(((angle - 1.2) * 24) ** 2 + (height - 15.0) ** 2) / 1.5)
    deviation[faces] = np.nan
    columns = (radius * np.cos(angle), radius * np.sin(angle), height, deviation)
    return np.uint32(points).tobytes() + b"".join(c.astype("<f4").tobytes() for c in columns)


RECIPES = {
    "stand.toml": ("stand", "Stand 1", 'name = "Stand 1"\n\n[table]\ndirection = "ccw"\nspeed_rpm = 3.0\n'),
    "shaft.toml": ("artefact", "shaft M", 'name = "shaft M"\n\n[[cylinder]]\nname = "base"\ndiameter_mm = 25.0\n'),
    "gear.toml": ("part", "Demo wheel", 'kind = "gear"\nname = "demo wheel"\nteeth = 24\nmodule_mm = 2.0\n'),
    PARTS[3]["file"]: ("part", LONG_NAME, 'kind = "gear"\nname = "sun wheel"\nteeth = 42\nmodule_mm = 1.5\n'),
}
DEVICES: list[Json] = [
    {"device": "table", "name": "table", "address": "tcp://192.168.0.20:502", "answers": True, "problem": None,
     "told": {"model": "DRX 1000", "position": "12.500°", "homed": "yes"}},
    {"device": "sensor", "name": "front", "address": "tcp://192.168.0.11:32001", "answers": True, "problem": None,
     "told": {"model": "JS-50 WX", "serial": "20731-A", "firmware": "16.3.0", "profiles/s": "1000"}},
    {"device": "sensor", "name": "back", "address": "tcp://192.168.0.12:32001", "answers": False,
     "problem": "found no answer within 2 s, need the sensor on this address; check its cable, then ask again",
     "told": {}},
]  # fmt: skip
