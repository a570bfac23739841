"""What is assumed where recipe, certificate and data sheet are silent. Budget lines that rest on it say *(assumed)*.

All U are expanded with k = 2.
"""

K = 2.0
"""Coverage factor of every expanded uncertainty, U = K u (GUM 6.2)."""
COAXIALITY_U = 0.002
"""mm: sideways offset of a ground shaft's steps."""
SCALE_U = 1e-4
"""Relative: scale of the sensor."""
SMOOTH = 10.0
"""mm over which a sensor's range error may change by all of its linearity; over less, by a share of it."""
TEMPERATURE_U, EXPANSION = 2.0, 11.5e-6
"""K, of artefact and part against the certificate's temperature; 1/K, steel."""
BEARING_U = 5e-4
"""mm: once-per-turn error of a good table bearing, which one scan can't tell from eccentricity."""
ANGLE_ZERO_U = 2e-4
"""rad: where a scan starts against the zero of the table's angle."""
