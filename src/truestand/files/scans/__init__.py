"""Scans: a reader for each format."""
