"""Sensor drivers, one file each; ``recipe.open_sensor`` opens them by name."""
