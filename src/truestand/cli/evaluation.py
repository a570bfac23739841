"""Scans as the options of a command say: on which stand, from which table angle."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from truestand.cli.options import radians_or_none
from truestand.cli.terminal import working
from truestand.core.scan import interpret
from truestand.files.recipes.recipes import read_stand
from truestand.files.scans.read import read_recording

if TYPE_CHECKING:
    from truestand.apply.transfer import Transfer
    from truestand.core.calibration import Calibration
    from truestand.core.scan import Scan
    from truestand.core.stand import Stand
    from truestand.station.pipeline import TakeScans


@dataclass(frozen=True, slots=True)
class ScanReader:
    """What ``--stand`` and ``--start-angle-deg`` say."""

    stand: "Stand | None"
    start_angle: float | None
    """rad; None: not stated."""
    quiet: bool

    @property
    def start_stated(self) -> bool:
        """Whether the user stated the table angle of the first profile."""
        return self.start_angle is not None

    def read(self, path: Path, calibrated: "Stand | None" = None) -> "Scan":
        """A scan on the stand of ``--stand``, otherwise on its own, otherwise on that of the calibration."""
        with working(f"Reading {path.name}", self.quiet):
            recording = read_recording(path)
            return interpret(recording, self.stand or recording.stand or calibrated, self.start_angle)

    def taking(self, *paths: Path) -> "TakeScans":
        """Reads them when a job of the pipeline asks for its scans."""
        return lambda calibrated: tuple(self.read(path, calibrated) for path in paths)

    def tied(self, path: Path, calibration: "Calibration") -> "Transfer":
        """A scan of any part, and the calibration as it applies to it."""
        from truestand.apply.transfer import transfer

        return transfer(self.read(path, calibration.stand), calibration, self.start_stated)


def scan_reader(stand: Path | None, start_angle_deg: float | None, quiet: bool) -> ScanReader:
    """The reader, its recipe read before the work begins."""
    described = None if stand is None else read_stand(stand)
    return ScanReader(described, radians_or_none(start_angle_deg), quiet)
