"""The one tree of errors. Each message says what was found, what was needed and what to do.

They are caught once, at the door (``cli/main.py``), printed as one line, and end the command with exit code 2.
Doubt is no error: a number that can't be trusted is a result that says so.
"""


class TruestandError(Exception):
    """Any error that truestand raises on purpose."""


class UnreadableFile(TruestandError):
    """A file that is missing, empty, truncated, binary, foreign or ambiguous."""


class BadRecipe(TruestandError):
    """A configuration (stand.toml, shaft.toml, ...) with a wrong, missing or unknown key."""


class NotEnoughData(TruestandError):
    """A scan that can't carry the question: too few turns, too few points, nothing of the artefact seen."""


class MissingExtra(TruestandError):
    """A feature whose optional dependency isn't installed."""


class WrongDrawing(TruestandError):
    """A part that is not the one its recipe describes; the message says what was seen."""
