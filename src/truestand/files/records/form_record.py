"""form.json (CONTRACT.md): an associated feature with its form, mm and rad."""

from truestand.files.records.record import SOFTWARE, Record
from truestand.form.form import Form


def form_record(form: Form, created: str, source_sha256: str, run_out: float | None = None) -> Record:
    """The record of an associated feature; ``run_out`` (mm) about C's axis, for calibrated scans."""
    return {
        "format": "truestand.form",
        "version": 1,
        "feature": form.feature,
        "point": form.point.tolist(),
        "direction": None if form.direction is None else form.direction.tolist(),
        "radius": form.radius,
        "rms": form.rms,
        "form": form.form,
        "reference": form.reference,
        "filter": None if form.cutoff_upr is None else {"kind": "gaussian", "cutoff_upr": form.cutoff_upr},
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
