"""What the text codecs raise."""


class Malformed(Exception):
    """Bytes that are no message of the protocol. Never leaves ``devices``: drivers say so in their own words."""
