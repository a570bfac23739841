"""plan.json (CONTRACT.md): where to put the sensors, and what comes of it; um, mm and degrees."""

from math import degrees
from typing import Any

from truestand.core.units import um
from truestand.files.recipes.recipes import position_keys
from truestand.files.records.record import SOFTWARE, Record
from truestand.planning.plan import Expected, Plan
from truestand.planning.target import View


def plan_record(plan: Plan, created: str) -> Record:
    """The record of a plan."""
    worst = plan.worst
    return {
        "format": "truestand.plan",
        "version": 1,
        "part": plan.part.name,
        "complete": plan.complete,
        "views": [_view(view) for view in plan.views],
        "coverage": plan.coverage,
        "characteristics": [_expected(e) for e in plan.expected],
        "worst": None if worst is None else {"name": worst.name, "flank": worst.flank, "section": worst.section,
                                             "U_of_limits": worst.share},
        "unseen": list(plan.unseen),
        "fewer_views": None if plan.fewer is None else _fewer(plan.fewer),
        "assumed": list(plan.assumed),
        "tried": {"places": len(plan.search.candidates), "housing_touches": plan.search.touching,
                  "shaft_not_in_view": plan.search.blind, "compared": len(plan.tried)},
        "software": SOFTWARE,
        "created": created,
    }  # fmt: skip


def _view(view: View) -> Record:
    place = view.mount.place
    return {
        "name": view.mount.sensor.name,
        "device": view.mount.sensor.device,
        "phi_deg": _rounded(degrees(place.phi)),
        "standoff_mm": _rounded(place.standoff),
        "height_mm": _rounded(place.height),
        "laser_plane_offset_mm": _rounded(place.plane_offset),
        "azimuth_deg": _rounded(degrees(place.azimuth)),
        "position": {key: _rounded(v) for key, v in position_keys(view.scan.stand.sensor.position).items()},
        "clearance_mm": _rounded(view.mount.clearance),
    }


def _expected(e: Expected) -> Record:
    return {
        "name": e.name,
        "flank": e.flank,
        "section": e.section,
        "U_um": None if e.U is None else um(e.U),
        "largest_U_um": None if e.largest is None else um(e.largest),
        "limit_um": _limit_um(e),
        "U_of_limits": e.share,
        "status": e.status,
        "capable": e.capable,
        "mostly": e.mostly,
    }


def _limit_um(e: Expected) -> float | None:
    """The upper limit; of two limits, half of what lies between them."""
    low, high = e.limits or (None, None)
    if high is None:
        return None
    return um(high if low is None else (high - low) / 2)


def _fewer(plan: Plan) -> Record:
    """What one view less would come to."""
    lost = [e for e in plan.asked if e.status != "measured" or not e.capable]
    named: list[dict[str, Any]] = [{"name": e.name, "flank": e.flank, "section": e.section} for e in lost]
    return {
        "views": [_view(view) for view in plan.views],
        "coverage": plan.coverage,
        "U_of_limits": None if plan.worst is None else plan.worst.share,
        "not_measured_or_not_capable": named,
    }


def _rounded(value: float) -> float:
    return round(value, 6) + 0.0
