"""The error of the codecs."""


class Malformed(Exception):
    """Bytes that are no message of the protocol. It never leaves ``devices``."""
