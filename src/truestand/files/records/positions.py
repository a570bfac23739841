"""The block ``positions`` of calibration.json: what several clampings of the shaft told apart."""

import math
from typing import Any

from truestand.core.calibration import Harmonic, Positions, Separated, StepAxis

Record = dict[str, Any]


def positions_record(p: Positions) -> Record:
    """The block, um, mrad and degrees."""
    return {
        "clamped_deg": [math.degrees(a) for a in p.clamped],
        "scans": list(p.scans),
        "axes": [
            {
                "surface": a.surface,
                "x_um": 1000.0 * a.x,
                "y_um": 1000.0 * a.y,
                "slope_x_mrad": 1000.0 * a.slope_x,
                "slope_y_mrad": 1000.0 * a.slope_y,
                "height_mm": a.height,
                "U_um": 1000.0 * a.U,
            }
            for a in p.axes
        ],
        "form": [_separated(s) for s in p.form],
        "bearing": [_separated(s) for s in p.bearing],
        "inseparable": list(p.inseparable),
    }


def read_positions(p: Any) -> Positions | None:
    """The block read back; None where a record has none."""
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
    return {
        "surface": s.harmonic.surface,
        "upr": s.harmonic.upr,
        "amplitude_um": 1000.0 * s.harmonic.amplitude,
        "phase_deg": math.degrees(s.harmonic.phase),
        "U_um": 1000.0 * s.U,
    }


def _read_separated(s: Any) -> Separated:
    harmonic = Harmonic(s["surface"], int(s["upr"]), s["amplitude_um"] / 1000.0, math.radians(s["phase_deg"]))
    return Separated(harmonic, s["U_um"] / 1000.0)


def _read_axis(a: Any) -> StepAxis:
    x, y, slope_x, slope_y, U = (a[k] / 1000.0 for k in ("x_um", "y_um", "slope_x_mrad", "slope_y_mrad", "U_um"))
    return StepAxis(a["surface"], x, y, slope_x, slope_y, a["height_mm"], U)
