"""What the codecs raise."""


class Malformed(Exception):
    """Bytes that are no message of the protocol. Never leaves ``devices``: drivers count it or say it in own words."""
