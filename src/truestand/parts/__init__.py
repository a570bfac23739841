"""Any other part: turned parts and comparison with CAD, and the one door, ``inspect``."""
