"""Refusals as clients see them: a status, and one line that says what was found, what is needed, what to do."""

from starlette.exceptions import HTTPException


class Problem(HTTPException):
    """A request that is refused; ``detail`` becomes the answer's ``problem``."""
