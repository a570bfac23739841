"""The virtual stand as devices: a table and sensors behind the protocols of real ones."""
