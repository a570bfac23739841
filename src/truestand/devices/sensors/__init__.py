"""Sensor drivers, one file each; ``opening.open_sensor`` opens them by name."""
