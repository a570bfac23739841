"""The reference shaft as its drawing and certificate describe it."""

from dataclasses import dataclass

from truestand.core.errors import BadRecipe


@dataclass(frozen=True, slots=True)
class Cylinder:
    """One step of the shaft; heights in mm above the shoulder between the first two cylinders."""

    name: str
    diameter: float
    bottom: float
    top: float
    diameter_U: float | None = None
    """mm, k = 2, from the certificate."""
    coaxiality_U: float | None = None
    """mm, k = 2: sideways offset of this cylinder's axis from the first one's."""

    @property
    def radius(self) -> float:
        """mm."""
        return self.diameter / 2

    @property
    def length(self) -> float:
        """mm."""
        return self.top - self.bottom

    @property
    def middle(self) -> float:
        """mm: height halfway up."""
        return (self.bottom + self.top) / 2


@dataclass(frozen=True, slots=True)
class Certificate:
    """Where the artefact's numbers come from."""

    id: str | None = None
    laboratory: str | None = None
    date: str | None = None
    valid_until: str | None = None
    temperature: float | None = None
    """degrees Celsius."""


@dataclass(frozen=True, slots=True)
class Artefact:
    """Coaxial cylinders from below, the first one the base."""

    cylinders: tuple[Cylinder, ...]
    name: str = "shaft"
    certificate: Certificate | None = None
    serial: str | None = None

    def __post_init__(self) -> None:
        if not self.cylinders:
            raise BadRecipe("found no cylinder, need at least one; add a [[cylinder]] with diameter_mm, from_mm, to_mm")
        for c in self.cylinders:
            if not c.diameter > 0 or not c.top > c.bottom:
                raise BadRecipe(
                    f"cylinder {c.name!r}: found diameter {c.diameter:g} mm from {c.bottom:g} to {c.top:g} mm, "
                    "need a positive diameter and to_mm above from_mm"
                )
        for lower, upper in zip(self.cylinders, self.cylinders[1:], strict=False):
            if upper.bottom < lower.top - 1e-9:
                raise BadRecipe(
                    f"cylinder {upper.name!r} starts at {upper.bottom:g} mm, below the end of {lower.name!r} "
                    f"({lower.top:g} mm); list the cylinders from below and let them not overlap"
                )

    @property
    def valid_until(self) -> str | None:
        """The date to which its certificate carries a calibration."""
        return None if self.certificate is None else self.certificate.valid_until

    @property
    def shoulder(self) -> float:
        """Height of the face between the first two cylinders, mm: 0 by rule, where the larger one ends in any case.

        Only with two cylinders or more.
        """
        lower, upper = self.cylinders[:2]
        return lower.top if lower.radius > upper.radius else upper.bottom

    @property
    def base(self) -> Cylinder:
        """The first cylinder, whose axis is the datum."""
        return self.cylinders[0]
