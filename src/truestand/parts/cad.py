"""Comparison with CAD."""
