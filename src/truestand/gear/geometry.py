"""Geometry of involute gears."""
