"""Which columns of a table are coordinates, and in which units: by their names, or as the caller says."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truestand.core.arrays import Array
from truestand.core.errors import BadRecipe, UnreadableFile
from truestand.core.message import Message
from truestand.files.text import MM_PER_UNIT

AXES = ["x", "y", "z"]
ANGLES, RADII = ("angle", "theta", "phi"), ("radius", "r", "rho")
"""Names of polar columns."""
RAD_PER_UNIT = {"rad": 1.0, "deg": np.pi / 180}
MOST_COLUMNS = 16
"""Without names: of more, x, y and z can't be the first three; they are points side by side."""
LEAST_COUNTED = 6
"""Numbers that rise all along: by chance those of one file in 720 do."""
MOST_MM = 1e9
"""From the origin, where a double still tells 0.0002 um apart: beyond lie marks of points that were not seen."""
MOST_TURNS = 3
"""Of a roundness trace. An arc of 19 degrees that is named as radians would have more."""
_BESIDE_UNITS = {
    *("all", "the", "length", "lengths", "coordinate", "coordinates", "points", "values", "unit", "units", "einheit"),
    *("einheiten", "is", "are", "in", "x", "y", "z", "xyz", *RAD_PER_UNIT, "degrees", "columns"),
}
"""Words of a line that tells a unit and nothing else."""
_NAMES_UNIT = re.compile(
    r"(?<![a-z])(um|u|nm|pm|cm|dm|km|thou|angstrom|ft|feet|foot|inch|inches|zoll|mils?|microns?|micro(metre|meter)s?|centi(metre|meter)s?"
    r"|(metre|meter)s?)(?![a-z])|[\[(/](m|in)\b|1\s*/\s*\d+\s*mm|\b(units?|einheit(en)?)\s*[:=;]"
    r"|^\W*my\W*$|[\[(/]\s*my\b|\b(all|xyz|in) my\W*$"
)
"""What may be the unit of the numbers below, and is not mm."""


@dataclass(frozen=True, slots=True)
class PointFile:
    """Points of a file, and what was taken for granted about them."""

    points: Array
    """(n, 3) mm; NaN: not seen."""
    remarks: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True)
class Choice:
    """What the caller says of a table's columns."""

    wanted: list[str] | None = None
    """By names or numbers from 1; None: by their names, or the first."""
    unit: str | None = None
    """mm, um or m, of columns whose names give none."""
    planar: bool = False
    """Whether points of a plane will do: x and y, or polar by their names."""
    file: str = ""

    def points(
        self, names: Sequence[str], columns: "Sequence[NDArray[Any]] | NDArray[Any]", heading: Sequence[str] = ()
    ) -> PointFile:
        """The points of columns (n,) by their names; 0 for what points of a plane don't have.

        ``heading``: comments and titles in lower case, which may tell a unit.

        Raises:
            UnreadableFile: a column that is missing or twice there, or may be another without names; a unit that is
                not known or contradicts ``unit``; numbers too large.
            BadRecipe: not as many columns as a point has.
        """
        unnamed = self.wanted is None and list(names) == numbered(len(names))
        if unnamed:
            self._refuse_unplaced(columns)
        at = [self._index(names, one) for one in self.wanted or self._usual(names)]
        if len(set(at)) != len(at) or not (2 if self.planar else 3) <= len(at) <= 3:
            need = "two or three, of x, y and z, such as 2,3" if self.planar else "three, of x, y and z, such as 2,3,4"
            raise BadRecipe(f"found --columns {','.join(self.wanted or [])}, need {need}")
        chosen = [names[i] for i in at]
        polar = len(at) == 2 and _split(chosen[0], RAD_PER_UNIT)[0] in ANGLES
        factors = [self._angle_factor(chosen[0])] if polar else []
        factors += self._factors(chosen[polar:], heading)
        with np.errstate(over="ignore", invalid="ignore"):  # a signalling NaN is a NaN, and no warning
            values = [np.multiply(columns[i], f, dtype=np.float64) for i, f in zip(at, factors, strict=True)]
            if polar:
                angle, radius = values
                self._refuse_many_turns(chosen[0], angle)
                values = [radius * np.cos(angle), radius * np.sin(angle)]
        points = np.column_stack(values if len(values) == 3 else [*values, np.zeros(len(values[0]))])
        largest = np.fmax.reduce(np.abs(points), axis=1)
        absurd = np.flatnonzero(largest > MOST_MM)
        if absurd.size:
            raise UnreadableFile(
                f"{self.file}: found {largest[absurd[0]]:.3g} mm in point {absurd[0] + 1} ({absurd.size} such points), "
                f"need {MOST_MM:g} at most; write nan for what was not seen, or check the unit"
            )
        return PointFile(points, _first_three_taken(len(names)) if unnamed and len(names) > 3 else ())

    def _refuse_unplaced(self, columns: "Sequence[NDArray[Any]] | NDArray[Any]") -> None:
        """Refuse columns without names whose first ones need not be x, y and z."""
        count, need = len(columns), "x y and perhaps z" if self.planar else "x y z"
        if not (2 if self.planar else 3) <= count <= MOST_COLUMNS:
            raise UnreadableFile(f"{self.file}: found {count} numbers a point, need {need}; export a point a line")
        if count > 3 and _counts(columns[0]):
            raise UnreadableFile(
                f"{self.file}: found {count} columns without names, the first rising like a number or a time, "
                "need x y z; pass --columns 2,3,4, or --columns 1,2,3 if it is x"
            )

    def _usual(self, names: Sequence[str]) -> list[str]:
        """The columns that hold the points where nobody says which: by their names, else the first."""
        if list(names) == numbered(len(names)):
            return numbered(min(len(names), 3))
        found = stems(names)
        polar = [name for group in (ANGLES, RADII) for name in group if name in found]
        if self.planar and len(polar) == 2 and not found.issuperset(AXES[:2]):
            return polar
        return AXES[:2] if self.planar and "z" not in found else AXES

    def _index(self, names: Sequence[str], wanted: str) -> int:
        """Where a column stands that is named, with or without its unit, or given by its number."""
        units = RAD_PER_UNIT if wanted in ANGLES else MM_PER_UNIT
        found = [i for i, name in enumerate(names) if wanted in (str(i + 1), name, _split(name, units)[0])]
        if len(found) != 1:
            also = ", angle_deg and radius_mm" if self.planar else ""
            raise UnreadableFile(
                f"{self.file}: found {len(found) or 'no'} column{'s' * (len(found) > 1)} {wanted!r} among "
                f"{listed(names)}, need one; name x, y and z{also} in the header (x_mm, x_um, x_m; x alone is mm), or "
                "pass --columns and --unit"
            )
        return found[0]

    def _refuse_many_turns(self, name: str, angle: Array) -> None:
        """Refuse angles (n,) rad of more turns than a trace has, if they are named so: they are degrees."""
        seen = angle[np.isfinite(angle)]
        turns = float(np.ptp(seen)) / (2 * np.pi) if seen.size else 0.0
        stem, unit = _split(name, RAD_PER_UNIT)
        if unit == "rad" and turns > MOST_TURNS:
            raise UnreadableFile(
                f"{self.file}: found {turns:.3g} turns in the column {name!r}, need {MOST_TURNS} at most; name it "
                f"{stem}_deg if it counts degrees"
            )

    def _angle_factor(self, name: str) -> float:
        unit = _split(name, RAD_PER_UNIT)[1]
        if unit is None:
            raise UnreadableFile(f"{self.file}: found the column {name!r}, need its unit: {name}_deg or {name}_rad")
        return RAD_PER_UNIT[unit]

    def _factors(self, chosen: Sequence[str], heading: Sequence[str]) -> list[float]:
        """From each column to mm."""
        units = [_split(name, MM_PER_UNIT)[1] for name in chosen]
        if self.unit is None and None in units and any("_" in name for name in chosen):
            raise UnreadableFile(
                f"{self.file}: found the columns {listed(chosen)}, need a unit (_mm, _um, _m) on each; name it or pass "
                "--unit"
            )
        unit = self.unit or self._told_unit(heading, needed=None in units)
        if unit is not None and not {unit, None}.issuperset(units):
            found, instead = (f"--unit {unit}", "leave --unit out") if self.unit else (f"{unit!r} above", "pass --unit")
            raise UnreadableFile(
                f"{self.file}: found {found} and the columns {listed(chosen)}, need the same; {instead}"
            )
        return [MM_PER_UNIT[named or unit or "mm"] for named in units]

    def _told_unit(self, heading: Sequence[str], needed: bool) -> str | None:
        """The unit that a heading tells; None: it tells none.

        Raises:
            UnreadableFile: it is ``needed``, and the heading names one that may be another thing's.
        """
        told = {unit for line in heading for unit in units_told(line)}
        if len(told) == 1:
            return told.pop()
        unclear = [line for line in heading if _NAMES_UNIT.search(line) or units_told(line)]
        if unclear and needed:
            raise UnreadableFile(
                f"{self.file}: found {unclear[0].strip()[:60]!r} above the numbers, need the coordinates' unit; pass "
                "--unit mm, um or m"
            )
        return None


def _first_three_taken(count: int) -> tuple[Message, ...]:
    text = f"the first 3 of {count} columns without names were taken for x, y and z; --columns says which they are"
    return (Message("columns_without_names", text),)


def _counts(column: "NDArray[Any]") -> bool:
    """Whether numbers (n,) rise all along, or are whole and never fall, as numbers of points and times do."""
    column = column[np.isfinite(column)].astype(np.float64)
    steps, whole = np.diff(column), bool((column == np.rint(column)).all())
    return len(column) >= LEAST_COUNTED and bool((steps >= 0).all() if whole else (steps > 0).all())


def units_told(line: str) -> set[str]:
    """The units in a line (lower case) that tells nothing else, as ``units: um`` and ``xyz_um`` do."""
    words = set(re.findall(r"[^\W\d_]+", line))
    units = words & MM_PER_UNIT.keys()
    return units if words <= units | _BESIDE_UNITS and not re.search(r"\d", line) else set()


def numbered(count: int) -> list[str]:
    """Names of columns that have none: their numbers from 1."""
    return [str(i + 1) for i in range(count)]


def stems(names: Sequence[str]) -> set[str]:
    """What the names begin with, up to an ending that may be a unit."""
    return {name.partition("_")[0] for name in names}


def listed(names: Sequence[str]) -> str:
    """Some names for a message."""
    return repr(", ".join(names)[:100])


def _split(name: str, units: Mapping[str, float]) -> tuple[str, str | None]:
    """A name without its unit, and the unit; None where it has none of ``units``."""
    stem, _, unit = name.rpartition("_")
    return (stem, unit) if stem and unit in units else (name, None)
