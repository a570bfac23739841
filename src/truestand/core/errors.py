"""The one tree of errors. Each message says what was found, what was needed and what to do.

They are caught once (``cli/main.py``), printed as one line, and end the command with exit code 2. A number that
can't be trusted is no error: it is a result that says so.
"""


class TruestandError(Exception):
    """Any error that truestand raises on purpose."""


class UnreadableFile(TruestandError):
    """A file that is missing, empty, truncated, binary, of another format or ambiguous."""


class BadRecipe(TruestandError):
    """A configuration (stand.toml, shaft.toml, ...) with a wrong, missing or unknown key."""


class NotEnoughData(TruestandError):
    """A scan that can't answer the question: too few turns, too few points, nothing of the artefact seen."""


class MissingExtra(TruestandError):
    """A feature whose optional dependency isn't installed."""


class WrongDrawing(TruestandError):
    """A part that is not the one its recipe describes; the message says what was seen."""


class DeviceError(TruestandError):
    """A sensor or table that refuses, answers nonsense, or isn't what the recipe says."""


class DeviceLost(DeviceError):
    """A device that doesn't answer, or no longer."""


class LimitExceeded(DeviceError):
    """A motion beyond the limits of the table: refused before anything moves."""


class MoveTimeout(DeviceError):
    """A motion that didn't end in the time it needed."""


class Fault(TruestandError):
    """The stand stopped itself; it stays so until an explicit reset. The message is the reason in plain words."""


class NoSpace(TruestandError):
    """A disk with no room, or no right, for what is to be written."""


class BadStore(TruestandError):
    """A results store that is missing, damaged, busy or newer than this version, or evidence that doesn't fit."""
