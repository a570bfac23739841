"""What a result says in words: a sentence for people with a code for programs."""

from typing import Self


class Message(str):
    """A sentence with its ``code``: codes are stable, sentences are not."""

    __slots__ = ("code",)
    code: str

    def __new__(cls, code: str, text: str) -> Self:
        """The sentence ``text``."""
        message = super().__new__(cls, text)
        message.code = code
        return message

    def __getnewargs__(self) -> tuple[str, str]:  # type: ignore[override]  # of pickle and copy: what __new__ takes
        return self.code, str(self)

    def prefixed(self, beginning: str) -> "Message":
        """The same with a ``beginning`` before the sentence."""
        return Message(self.code, f"{beginning}{self}")


UNTIED = Message(
    "angle_zero_unknown",
    "nothing ties this scan's table angle to the next one's ([table] start = 'unknown', no angle or encoder): "
    "home the table or record its angle",
)
"""Why a calibration is not trusted whose table angle counts from anywhere."""
RECIPE_CHANGED = "recipe_changed"
"""Code of what stand.toml or shaft.toml said otherwise at an inspection than at its calibration."""
