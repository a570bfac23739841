"""Sessions, in memory only. A visitor's cookie is random; only after a login does the server remember it.

The token against forged writes is the cookie's HMAC under a secret of this process, so it costs no memory either.
"""

import hashlib
import hmac
import re
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

COOKIE = "truestand"
IDLE_TIMEOUT_S = 3600.0
MAX_AGE_S = 12 * 3600.0
"""A shift."""
MAX_SESSIONS = 500
"""The one idle for longest gives way."""
_COOKIE_PATTERN = re.compile(r"[A-Za-z0-9_-]{43}")


@dataclass(slots=True)
class Session:
    """A login."""

    user: str
    began: float
    last_used: float


class Sessions:
    """Logins by the cookie's value."""

    def __init__(self, idle: float = IDLE_TIMEOUT_S, clock: Callable[[], float] = time.monotonic) -> None:
        self._idle, self._clock = idle, clock
        self._secret = secrets.token_bytes(32)
        self._lock = threading.Lock()
        self._sessions: dict[str, Session] = {}

    def begin(self, user: str) -> str:
        """A new session's cookie."""
        cookie, now = new_cookie(), self._clock()
        with self._lock:
            self._remove_expired(now)
            self._sessions[cookie] = Session(user, now, now)
        return cookie

    def end(self, cookie: str | None) -> None:
        """Forget a session, where there is one."""
        with self._lock:
            self._sessions.pop(cookie or "", None)

    def user(self, cookie: str | None, is_use: bool = True) -> str | None:
        """Who this cookie belongs to. ``is_use``: the session is idle no longer."""
        with self._lock:
            session = self._sessions.get(cookie or "")
            if session is None:
                return None
            now = self._clock()
            if self._expired(session, now):
                del self._sessions[cookie or ""]
                return None
            if is_use:
                session.last_used = now
            return session.user

    def csrf(self, cookie: str) -> str:
        """The token that a write under this cookie has to carry."""
        return hmac.new(self._secret, cookie.encode(), hashlib.sha256).hexdigest()

    def is_csrf(self, cookie: str | None, token: str | None) -> bool:
        """Whether that is the token."""
        if cookie is None or token is None or not token.isascii():
            return False
        return hmac.compare_digest(self.csrf(cookie), token)

    def _expired(self, session: Session, now: float) -> bool:
        return now - session.last_used > self._idle or now - session.began > MAX_AGE_S

    def _remove_expired(self, now: float) -> None:
        for cookie in [c for c, s in self._sessions.items() if self._expired(s, now)]:
            del self._sessions[cookie]
        while len(self._sessions) >= MAX_SESSIONS:
            del self._sessions[min(self._sessions, key=lambda c: self._sessions[c].last_used)]


def new_cookie() -> str:
    """256 random bits."""
    return secrets.token_urlsafe(32)


def valid_cookie(cookie: str | None) -> str | None:
    """A cookie's value as this server could have given it, or nothing."""
    return cookie if cookie is not None and _COOKIE_PATTERN.fullmatch(cookie) else None
