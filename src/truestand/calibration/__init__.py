"""One or several scans of the artefact in, a calibration out."""
