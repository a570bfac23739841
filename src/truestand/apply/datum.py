"""Where the axis about which a part is judged stands in C, and how well that is known.

C's Z is the axis of the shaft's base. A part sits on the seat (the next cylinder), or is judged about the axis that
both have in common; what the certificate leaves open on their coaxiality, or what several clampings have measured of
it, says how far that axis is off. How well the base's own axis is known stands in the calibration's covariance.
"""

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Literal

from truestand.core.artefact import Cylinder
from truestand.core.assumptions import ASSUMED, COAXIALITY_U, K
from truestand.core.calibration import Calibration, Contribution, StepAxis
from truestand.core.errors import BadRecipe
from truestand.core.frames import Pose, shaft_from_rotor

DatumName = Literal["base", "seat", "common"]

COAXIALITY = "coaxiality of the datum"
CLEARANCE = "bore clearance"
SEAT = "seat"
"""A cylinder of that name is the seat; without one it is the first above the base."""
UNSTATED_SHAFT = Cylinder("base", 0.0, -20.0, 0.0), Cylinder(SEAT, 0.0, 0.0, 20.0)
"""Base and seat where the calibration carries no drawing: 20 mm apart, the seat as long; no diameter is used."""
SLOPE_OF_OFFSET = sqrt(12.0)
"""Over a length L, the slope of a line through evenly spread noise is known to sqrt(12) / L of what its middle is."""


@dataclass(frozen=True, slots=True)
class Datum:
    """The datum axis in C."""

    name: DatumName
    pose: Pose
    """datum_from_shaft: Z along the datum axis, the origin where it passes C's height 0, no twist about Z."""
    U_offset: float
    """mm, k = 2: sideways, in each direction, at ``height``."""
    U_slope: float
    """rad, k = 2, about ``height``."""
    height: float
    """mm: height in C at which ``U_offset`` counts and about which the axis may lean."""
    contributions: tuple[Contribution, ...]
    """Lines of ``U_offset``, largest first, in mm."""
    remark: str
    """Which axis it is and where it is known from."""

    def lines(self, height: float) -> tuple[Contribution, ...]:
        """U (mm, k = 2) of the axis sideways at a height in C: ``contributions`` with what the slope adds there."""
        coaxial = next((c for c in self.contributions if c.name.startswith(COAXIALITY)), None)
        lines = [c for c in self.contributions if c is not coaxial]
        U = hypot(self.U_slope * abs(height - self.height), 0.0 if coaxial is None else coaxial.U)
        if U > 0:
            lines.append(Contribution(COAXIALITY if coaxial is None else coaxial.name, U, U / K, "normal", 1.0))
        return tuple(sorted(lines, key=lambda c: -c.U))

    def expanded(self, height: float) -> float:
        """U (mm, k = 2) of the axis sideways, in each direction, at a height in C."""
        return hypot(*(c.U for c in self.lines(height)))


def datum_of(calibration: Calibration, name: DatumName, bore_clearance: float = 0.0) -> Datum:
    """The datum axis ``name`` of a part that sits on the calibrated shaft with ``bore_clearance`` (mm, diametral).

    base: C's own axis. seat: the next cylinder's. common: through the middles of both (ISO 5459, A-B). An axis that
    several clampings measured is used as it was found; else the cylinders are taken for coaxial, with the
    certificate's U. With clearance the part may sit anywhere within half of it; it is held against tilting by the
    shoulder, so that no slope comes with it.

    Raises:
        BadRecipe: the shaft has no second cylinder.
    """
    clearance = _clearance(bore_clearance)
    if name == "base":
        return _datum(name, (0.0, 0.0, 0.0, 0.0), None, 0.0, 0.0, clearance, "the shaft's base: Z of C")
    base, seat = _cylinders(calibration)
    axis = _measured(calibration, seat)
    at = seat.middle
    U, why = _coaxiality(seat, axis)
    line = Contribution(f"{COAXIALITY}{why}", U, U / K, "normal", 1.0)
    source = "measured by several clampings" if axis is not None else "taken for coaxial with the base"
    x, y, slope_x, slope_y = (0.0, 0.0, 0.0, 0.0) if axis is None else axis.at(at)
    if name == "seat":
        U_slope = U / seat.length * (1.0 if axis is None else SLOPE_OF_OFFSET)
        stands = (x - slope_x * at, y - slope_y * at, slope_x, slope_y)
        return _datum(name, stands, line, U_slope, at, clearance, f"the axis of {seat.name}, {source}")
    low = base.middle
    slope_x, slope_y = x / (at - low), y / (at - low)
    stands = (-slope_x * low, -slope_y * low, slope_x, slope_y)
    # The common axis leaves the base's at its middle, so all that is open on the seat is a slope about there.
    hinge = Contribution(line.name, 0.0, 0.0, "normal", 1.0)
    remark = f"the common axis of base and {seat.name}, {source}"
    return _datum(name, stands, hinge, U / (at - low), low, clearance, remark)


def _datum(
    name: DatumName,
    stands: tuple[float, float, float, float],
    line: Contribution | None,
    U_slope: float,
    height: float,
    clearance: tuple[Contribution, ...],
    remark: str,
) -> Datum:
    """``stands``: where the axis passes height 0 (x, y, mm) and its slopes, in C."""
    lines = sorted((*clearance, *(() if line is None else (line,))), key=lambda c: -c.U)
    pose = shaft_from_rotor(*stands)  # the same question: the frame of an axis, without twist
    return Datum(name, pose, hypot(*(c.U for c in lines)), U_slope, height, tuple(lines), remark)


def _clearance(bore_clearance: float) -> tuple[Contribution, ...]:
    """Rectangular within half the clearance."""
    u = bore_clearance / 2 / sqrt(3.0)
    return (Contribution(CLEARANCE, K * u, u, "rectangular", 1.0),) if u > 0 else ()


def _cylinders(calibration: Calibration) -> tuple[Cylinder, Cylinder]:
    """Base and seat of the calibrated shaft."""
    if calibration.artefact is None:
        return UNSTATED_SHAFT
    base, *further = calibration.artefact.cylinders
    if not further:
        raise BadRecipe(
            f"found a datum on the seat, but {calibration.artefact.name!r} has one cylinder only; "
            'add the seat as a [[cylinder]] of shaft.toml, or say datum = "base"'
        )
    return base, next((c for c in further if c.name == SEAT), further[0])


def _measured(calibration: Calibration, seat: Cylinder) -> StepAxis | None:
    """The seat's axis as several clampings found it; without a drawing, the first step's."""
    axes = () if calibration.positions is None else calibration.positions.axes
    return next((a for a in axes if a.surface == seat.name or calibration.artefact is None), None)


def _coaxiality(seat: Cylinder, axis: StepAxis | None) -> tuple[float, str]:
    """U (mm, k = 2) of the seat's axis at its middle, and what to add to the line's name."""
    if axis is not None:
        return axis.U, ""
    return (COAXIALITY_U, ASSUMED) if seat.coaxiality_U is None else (seat.coaxiality_U, "")
