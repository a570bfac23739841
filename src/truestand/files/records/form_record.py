"""form.json (CONTRACT.md): an associated feature with its form, mm and rad."""

from collections.abc import Sequence

import numpy as np

from truestand.core.arrays import Array
from truestand.core.message import Message
from truestand.core.units import UM_PER_MM
from truestand.files.records.record import SOFTWARE, Record, messages_record
from truestand.form.form import Form


def form_record(
    form: Form, created: str, source_sha256: str, run_out: float | None = None, reasons: Sequence[Message] = ()
) -> Record:
    """The record of an associated feature.

    Of calibrated scans: ``run_out`` (mm) about C's axis, and the ``reasons`` why their calibration is untrusted.
    """
    reasons = [*reasons, *form.reasons]
    return {
        "format": "truestand.form",
        "version": 2,
        "status": "untrusted" if reasons else "valid",
        "reasons": messages_record(reasons),
        "remarks": messages_record(form.remarks),
        "feature": form.feature,
        "point": form.point.tolist(),
        "direction": None if form.direction is None else form.direction.tolist(),
        "radius": form.radius,
        "half_angle": form.half_angle,
        "rms": form.rms,
        "form": form.form,
        "reference": form.reference,
        "filter": None if form.low_pass is None else {"kind": form.low_pass.kind, "cutoff_upr": form.low_pass.cutoff},
        "n": form.n,
        "U": form.U,
        "k": 2.0,
        "noise": form.noise,
        "noise_floor": form.noise_floor,
        "run_out": run_out,
        "certificate": None
        if form.certificate is None
        else {
            "contacts": form.certificate.contacts.tolist(),
            "outside": form.certificate.outside.tolist(),
            "forces": form.certificate.forces.tolist(),
            "imbalance": form.certificate.imbalance,
            "scope": form.certificate.scope,
        },
        "source": {"sha256": source_sha256},
        "software": SOFTWARE,
        "created": created,
    }


def deviations_csv(points: Array, form: Form) -> str:
    """Every point (n, 3) mm with its deviation in um, a line each; empty where it was not seen.

    After a filter the deviation is that of the filtered profile.
    """
    rows = np.column_stack([points, form.deviation * UM_PER_MM])
    lines = (",".join("" if np.isnan(v) else f"{v:.6f}" for v in row) for row in rows)
    return "\n".join(("x_mm,y_mm,z_mm,deviation_um", *lines, ""))
