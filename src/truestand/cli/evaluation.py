"""What the commands that evaluate scans share: reading scans, and saying why a calibration is not trusted."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from pathlib import Path

import typer

from truestand.apply.transfer import Transfer, transfer
from truestand.cli.options import UNDECIDED, radians_or_none, view_names
from truestand.cli.terminal import hint, progress
from truestand.core.errors import BadRecipe
from truestand.core.scan import Scan, interpret
from truestand.core.stand import Stand
from truestand.files.recipes.recipes import read_stand
from truestand.files.records.calibration_record import read_calibration
from truestand.files.scans.read import read_recording
from truestand.station.pipeline import TakeScans


@dataclass(frozen=True, slots=True)
class ScanReader:
    """Reads scans as ``--stand`` and ``--start-angle-deg`` say."""

    stand: Stand | None
    start_angle: float | None
    """rad; None: not stated."""
    quiet: bool
    views: tuple[str, ...] = ()
    """Of the scans, in their order; empty: they say themselves, or the stand has one sensor."""

    @property
    def start_stated(self) -> bool:
        """Whether the user stated the table angle of the first profile."""
        return self.start_angle is not None

    def read(self, path: Path, calibrated: Stand | None = None, view: str | None = None) -> Scan:
        """A scan on the stand of ``--stand``, otherwise on its own, otherwise on that of the calibration."""
        with progress(f"Reading {path.name}", self.quiet):
            recording = read_recording(path)
            return interpret(recording, self.stand or recording.stand or calibrated, self.start_angle, view)

    def when_asked(self, *paths: Path) -> TakeScans:
        """Reads these scans when a job of the pipeline asks for them.

        Raises:
            BadRecipe: not one view for each.
        """
        if self.views and len(self.views) != len(paths):
            raise BadRecipe(
                f"found --view {','.join(self.views)} for {len(paths)} scans, need one name each, in their order"
            )
        views = self.views or (None,) * len(paths)
        return lambda calibrated: tuple(self.read(p, calibrated, v) for p, v in zip(paths, views, strict=True))

    def transferred(self, path: Path, calibration: Path) -> Transfer:
        """A scan of any part, and the calibration as it applies to it."""
        known = read_calibration(calibration)
        (scan,) = self.when_asked(path)(known.whole_stand)
        return transfer(scan, known, self.start_stated)


def scan_reader(stand: Path | None, start_angle_deg: float | None, quiet: bool, views: str | None = None) -> ScanReader:
    """The reader, its recipe read before the work begins; ``views``: names of the scans' views, *front,rear*."""
    described = None if stand is None else read_stand(stand)
    names = view_names(views) or ()
    return ScanReader(described, radians_or_none(start_angle_deg), quiet, names)


def print_witness(transferred: Transfer, quiet: bool) -> None:
    """Print what the shaft in view of a scan says of the zero of the table's angle."""
    witness = transferred.witness
    if witness is not None and transferred.calibration.angle_zero == "witness":
        turn, U = degrees(witness.angle_shift), degrees(witness.angle_U)
        surfaces = ", ".join(witness.surfaces)
        hint(f"table angle tied by the shaft in view ({surfaces}): {turn:+.4f} deg, U = {U:.4f} deg", quiet)


def end_if_untrusted(reasons: Sequence[str], quiet: bool) -> None:
    """Print why a result is untrusted and end with exit code 3; do nothing where there is no reason."""
    for reason in reasons:
        hint(f"untrusted: {reason}", quiet)
    if reasons:
        raise typer.Exit(UNDECIDED)
