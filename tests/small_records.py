"""Records of a stand's results, as small as they can be."""

CREATED = "2026-11-21T12:00:00Z"


def calibration(status="valid", valid_until=None, **more):
    record = {
        "format": "truestand.calibration", "version": 1, "status": status, "reasons": [], "created": CREATED,
        "valid_until": valid_until, "software": "truestand", "artefact": {"name": "shaft M", "serial": "S 1"},
        "sensor": {"name": "front", "phi_deg": -41.8, "laser_plane_tilt_deg": 0.1},
        "shaft": {"eccentricity_um": 880.0, "tilt_mrad": 0.4},
        "uncertainty": {"phi_deg": {"U": 0.05, "k": 2.0}, "eccentricity_um": {"U": 1.3, "k": 2.0}},
        "not_identifiable": ["height"],
    }  # fmt: skip
    return record | more


def line(name, value, limit=None, verdict=None, flank="left", tooth=None, **more):
    told = {"name": name, "flank": flank, "tooth": tooth, "value_um": value, "U_um": None if value is None else 1.5,
            "limit_um": limit, "grade": None, "coverage": 1.0, "status": "measured", "verdict": verdict,
            "capable": True, "standard": None}  # fmt: skip
    return told | more


def inspection(*lines, verdict="does_not_conform", part="gear", serial="7"):
    return {
        "format": "truestand.inspection", "version": 1, "verdict": verdict, "reasons": ["F_p left is too large"],
        "part": {"kind": "gear", "name": part, "serial": serial, "order": "A 12", "operator": "olga"},
        "characteristics": list(lines or GEAR), "calibration": {}, "scan": {}, "created": CREATED,
    }  # fmt: skip


GEAR = (
    line("F_p", 41.0, 35.0, "does_not_conform"),
    line("f_Halpha", -0.3, 12.0, "conforms", tooth=3),
    line("F_beta", None, 16.0, "undecided", coverage=None, status="not_measurable"),
    {"name": "d_a", "flank": None, "tooth": None, "value_mm": 52.01, "U_mm": 0.02, "limits_mm": [51.9, None],
     "coverage": 0.9, "status": "partial", "verdict": "conforms", "standard": "drawing"},
)  # fmt: skip


def verification():
    change = {"name": "eccentricity", "value_um": 3.0, "U_um": 1.0, "limit_um": 10.0, "verdict": "conforms"}
    return {"format": "truestand.verification", "version": 1, "verdict": "conforms", "reasons": [], "created": CREATED,
            "changes": [change], "calibration": {}, "scan": {}}  # fmt: skip
