"""How long a test waits for what must come, or must end, at some time: promises in seconds are measured by bench/."""

NOT_FOR_EVER = 30.0
"""s."""
