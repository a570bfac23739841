"""Scans of one part by several sensors, rolled up into one cloud."""

from dataclasses import replace

from truestand.apply.transfer import Transfer, transfer
from truestand.core.calibration import Calibration
from truestand.core.errors import BadRecipe
from truestand.core.message import UNTIED, Message
from truestand.core.scan import Scan
from truestand.core.surface import Surface, apply_calibration


def roll_views(
    scans: tuple[Scan, ...], calibration: Calibration, start_stated: bool = False, clamped_again: bool = False
) -> tuple[Surface, ...]:
    """One surface a scan, all in C of the calibration's first view; each with the calibration of its own view as it
    stands there, and the reasons why nothing may be decided. Together they are one cloud, and one part to ``inspect``.

    ``start_stated``: the table angle of the scans' first profiles was given (``start_angle`` of ``interpret``);
    ``clamped_again``: a view may have several scans, between which the part was clamped again (``inspect``).

    Raises:
        BadRecipe: two scans of one view, or one of a view of which the calibration is not.
    """
    return tuple(placed(t, calibration) for t in transfer_views(scans, calibration, start_stated, clamped_again))


def transfer_views(
    scans: tuple[Scan, ...], calibration: Calibration, start_stated: bool = False, clamped_again: bool = False
) -> tuple[Transfer, ...]:
    """Each scan with its table angle tied to the calibration's.

    Raises:
        BadRecipe: as ``roll_views``.
    """
    if not clamped_again:
        demand_one_each(scans)
    return tuple(transfer(scan, calibration, start_stated) for scan in scans)


def demand_one_each(scans: tuple[Scan, ...]) -> None:
    """Refuse several scans of one view.

    Raises:
        BadRecipe: two scans of one view.
    """
    names = [scan.view for scan in scans]
    if len(set(names)) < len(names):
        raise BadRecipe(f"found scans of the views {', '.join(names)}, need another view for each; see --view")


def placed(transferred: Transfer, calibration: Calibration) -> Surface:
    """A scan rolled up into C of the calibration's first view.

    What speaks against using the views together speaks against each; but a scan that shaft in view has tied to its own
    view's zero is tied to all: the azimuth between views holds whatever their zeros differed by.
    """
    own, known = transferred.calibration, calibration.for_scan(transferred.scan)
    of_scan = (r for r in own.reasons if r not in known.reasons)
    named = (Message(r.code, f"view {own.name!r}: {r}") for r in of_scan) if calibration.views else of_scan
    reasons = (*(r for r in calibration.reasons if r.code != UNTIED.code), *named)
    own = replace(in_first_frame(own, calibration), reasons=tuple(dict.fromkeys(reasons)))
    return apply_calibration(transferred.scan, own)


def in_first_frame(own: Calibration, calibration: Calibration) -> Calibration:
    """The calibration of one view as it stands in C of the first view of a ``calibration``."""
    return replace(own, shaft_from_rotor=calibration.shaft_from_rotor @ own.first_from_table, joint=calibration.joint)
