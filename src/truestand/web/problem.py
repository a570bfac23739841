"""Refusals as clients see them: a status, and one line that says what was found, what is needed, what to do."""


class Problem(Exception):
    """A request that is refused."""

    def __init__(self, status: int, message: str, retry_after: int | None = None) -> None:
        super().__init__(message)
        self.status, self.message, self.retry_after = status, message, retry_after

    @property
    def headers(self) -> dict[str, str]:
        """Beyond the usual ones."""
        return {} if self.retry_after is None else {"Retry-After": str(self.retry_after)}
