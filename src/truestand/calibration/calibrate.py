"""The calibration: one scan of the artefact in; where the sensor stands and how the shaft runs out."""

from dataclasses import replace

from truestand.calibration.height import with_height
from truestand.calibration.paper import calibrate_paper
from truestand.calibration.refine import Refined, refine
from truestand.calibration.result import calibration_of
from truestand.calibration.segment import Segments, segment
from truestand.calibration.start import rough_stand
from truestand.core.artefact import Artefact
from truestand.core.calibration import Calibration, Method
from truestand.core.scan import Scan


def calibrate(scan: Scan, artefact: Artefact, method: Method = "stand") -> Calibration:
    """Where the sensor stands relative to the shaft, how the shaft runs, and how well that is known.

    ``method`` is ``"stand"``, the exact model (docs/theory.md), or ``"paper"``, the published procedure of Klarák et
    al. 2022, kept faithful so that anyone can reproduce it and see the difference.

    Source: Klarák et al., Sensors 2022, 22, 5306; uncertainty by GUM (JCGM 100) and Monte Carlo (JCGM 101).

    Raises:
        NotEnoughData: less than half a turn, too few points, or nothing that fits the drawing.
    """
    segments = segment(scan, artefact)
    return (_published if method == "paper" else _exact)(scan, artefact, segments)


def calibrate_by_both(scan: Scan, artefact: Artefact) -> tuple[Calibration, Calibration]:
    """The calibration by the exact model and by the published method, for a report that shows both.

    Raises:
        NotEnoughData: as ``calibrate``.
    """
    segments = segment(scan, artefact)
    return _exact(scan, artefact, segments), _published(scan, artefact, segments)


def fit_of(scan: Scan, artefact: Artefact, segments: Segments) -> Refined:
    """The exact model fitted to all that the scan shows of the artefact, heights counted from its shoulder.

    Raises:
        NotEnoughData: as ``calibrate``.
    """
    start = rough_stand(scan, segments, artefact)
    fit = refine(scan, segments, artefact, start)
    return with_height(scan, artefact, fit)


def _exact(scan: Scan, artefact: Artefact, segments: Segments) -> Calibration:
    return _with_scan_reasons(calibration_of(scan, artefact, fit_of(scan, artefact, segments)), scan)


def _published(scan: Scan, artefact: Artefact, segments: Segments) -> Calibration:
    return _with_scan_reasons(calibrate_paper(scan, artefact, segments), scan)


def _with_scan_reasons(calibration: Calibration, scan: Scan) -> Calibration:
    """A calibration from a scan that is not proven complete is not to be trusted."""
    return replace(calibration, reasons=(*calibration.reasons, *scan.reasons))
