"""The virtual stand in motion: a table and a sensor that are reached over the protocols of the real ones."""
