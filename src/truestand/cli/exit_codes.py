"""Exit codes of all commands."""

DONE = 0
"""Done, conforms, holds."""
FAILS = 1
"""Does not conform, does not hold."""
WRONG_USE = 2
"""Wrong use, or input that can't be read."""
UNDECIDED = 3
"""Undecided or untrusted: what was written says why."""
INTERRUPTED = 130
"""Broken off by the user."""
