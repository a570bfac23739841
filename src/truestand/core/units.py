"""Units at the border. Inside everything is mm, rad and s; these convert on the line that reads or writes."""

from math import degrees, radians

UM_PER_MM = 1000.0


def um(mm: float) -> float:
    """Micrometres from millimetres."""
    return mm * UM_PER_MM


def mm_from_um(value: float) -> float:
    """Millimetres from micrometres."""
    return value / UM_PER_MM


def mrad(rad: float) -> float:
    """Milliradians from radians."""
    return rad * 1000.0


__all__ = ["UM_PER_MM", "degrees", "mm_from_um", "mrad", "radians", "um"]
