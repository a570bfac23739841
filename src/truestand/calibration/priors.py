"""What is known before the scan: how the sensor was mounted, what the artefact's certificate says."""

from truestand.calibration.estimate import Prior
from truestand.calibration.model import GEOMETRY, Model
from truestand.calibration.segment import Segments
from truestand.core.artefact import Artefact
from truestand.core.scan import Scan

UNSTATED_COAXIALITY_U = 0.002
"""mm, k = 2: a ground shaft, where the certificate is silent. Said in the budget."""
CLAMPING_U = 0.04
"""rad, k = 2: no shaft runs more tilted than this."""
DRIFT_U = 0.1
"""mm over the scan, k = 2."""
SPEED_U = 0.1
"""Relative, k = 2, of a table without an encoder."""
KNOWN = 1e-10
"""For what is no unknown in this scan."""
MOUNTING = "mounting of the laser plane"
COAXIALITY = "coaxiality of the steps"
LOOSE = "form and static profile"
STATIC_U = 0.1
"""mm, k = 2, of each Legendre coefficient of the static profile: no sensor is less linear. Without it, the polynomials
of a short stretch that the shaft's wobble moves over a longer range could take up its slope, and phi with it."""
SMOOTH = 10.0
"""mm over which a sensor's range error may bend that much; over a share of it, degree n only by that share's nth
power."""


def priors_for(model: Model, scan: Scan, segments: Segments, artefact: Artefact) -> tuple[Prior, ...]:
    """The priors of the stand, the certificate and common sense, each under its name in the budget."""
    sensor = scan.stand.sensor
    at = GEOMETRY.index
    free_speed = scan.angle_source in ("index", "time")
    priors = [
        Prior(MOUNTING, (at("plane_offset"),), sensor.plane_offset_U / 2),
        Prior(MOUNTING, (at("plane_tilt"),), sensor.plane_tilt_U / 2),
        Prior("clamping", (at("tilt_x"), at("tilt_y")), CLAMPING_U / 2),
        Prior("drift", (at("drift"),), DRIFT_U / 2),
        Prior("table speed", (at("speed"),), SPEED_U / 2 if free_speed else KNOWN),
    ]
    for k, band in enumerate(segments.bands):
        cylinder = artefact.cylinders[band.cylinder]
        if k:
            coaxiality = cylinder.coaxiality_U or UNSTATED_COAXIALITY_U
            start = model.axis_slice(k).start
            slope = coaxiality / 2 / cylinder.length
            priors.append(Prior(COAXIALITY, (start, start + 1), coaxiality / 2, considered=True))
            priors.append(Prior(COAXIALITY, (start + 2, start + 3), slope, considered=True))
        own, forms = model.static_slice(k), model.form_slice(k)
        low, high = model.static_spans[k]
        for i, degree in enumerate(model.static_degrees(k), own.start):
            # A step to the base may be wrong in the drawing.
            u = STATIC_U / 2 * min(1.0, (high - low) / SMOOTH) ** degree if degree else 1.0
            priors.append(Prior(LOOSE, (i,), u))
        if forms.stop > forms.start:
            priors.append(Prior(LOOSE, tuple(range(forms.start, forms.stop)), 1.0))
    return tuple(priors)
