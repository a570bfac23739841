"""Users, their passwords and their sessions.

Users stand in ``<store>.users.json``, readable by its owner only, with passwords as scrypt hashes.

Failed logins slow down further ones: from the same address after a few, under the same name after more. A name is
throttled less and for a shorter time, so that nobody can lock another one out for long.

Sessions are in memory only. A visitor's cookie is random; only after a login does the server remember it. The token
against forged writes is the cookie's HMAC under a secret of this process, so it costs no memory either.
"""

import hashlib
import hmac
import json
import os
import re
import secrets
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, get_args

from truestand.core.errors import BadRecipe

Role = Literal["operator", "engineer"]
SCRYPT_COST = {"n": 1 << 14, "r": 8, "p": 5}
"""As OWASP's Password Storage Cheat Sheet has it: 16 MB, about a fifth of a second."""
MIN_PASSWORD_LENGTH, MAX_PASSWORD_LENGTH = 10, 1024
"""NIST SP 800-63B asks for 8 at least."""
FORGET_FAILURES_AFTER_S = 900.0
"""From the last failure on."""
MAX_THROTTLE_KEYS = 10_000
"""The oldest gives way."""
USER_NAME = re.compile(r"[^\W_][\w .@-]{0,63}")
FORMAT = "truestand.users"
COOKIE = "truestand"
IDLE_TIMEOUT_S = 3600.0
MAX_AGE_S = 12 * 3600.0
"""A shift."""
MAX_SESSIONS = 500
"""The one idle for longest gives way."""
_COOKIE_PATTERN = re.compile(r"[A-Za-z0-9_-]{43}")


@dataclass(frozen=True, slots=True)
class User:
    """A user of the page, as the file has it."""

    name: str
    role: Role
    salt: str
    """Hex."""
    hash: str
    """Hex."""
    n: int
    r: int
    p: int


@dataclass(frozen=True, slots=True)
class Principal:
    """Who sends a request."""

    user: str | None
    role: Role | None
    """None: may do nothing."""


NOBODY = Principal(None, None)


@dataclass(frozen=True, slots=True)
class ThrottleRule:
    """How many failures are free, and the longest wait after more, s; it doubles from 1 s."""

    free_failures: int
    max_wait_s: float


THROTTLE_RULES = {"address": ThrottleRule(5, 300.0), "user": ThrottleRule(20, 30.0)}


def users_path(store: Path) -> Path:
    """Beside the store, not in it: the store never forgets."""
    return store.with_name(f"{store.name}.users.json")


def read_users(path: Path) -> dict[str, User]:
    """Users by name; none where there is no file.

    Raises:
        BadRecipe: others can read the file, or it isn't as it was written.
    """
    if not path.exists():
        return {}
    if sys.platform != "win32" and path.stat().st_mode & 0o077:
        raise BadRecipe(f"{path}: others can read it, need mode 0600; run chmod 600 {path}")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        users = [User(**user) for user in content["users"]]
        if content["format"] != FORMAT or not all(user.role in get_args(Role) for user in users):
            raise ValueError
    except (ValueError, KeyError, TypeError) as wrong:
        raise BadRecipe(f"{path}: found no list of users; remove it, and add them again with --add-user") from wrong
    return {user.name: user for user in users}


def write_users(path: Path, users: Mapping[str, User]) -> None:
    """Replace the file as a whole; nobody but its owner can read it at any time."""
    content = {"format": FORMAT, "version": 1, "users": [asdict(u) for u in users.values()]}
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # 0600 from the start
    temporary = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(json.dumps(content, indent=2) + "\n")
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def make_user(name: str, role: Role, password: str, cost: Mapping[str, int] = SCRYPT_COST) -> User:
    """A user with a new salt; ``cost``: scrypt's n, r and p.

    Raises:
        BadRecipe: a name or password that is not allowed.
    """
    if not USER_NAME.fullmatch(name):
        raise BadRecipe(f"found user {name!r}, need a name of letters, digits, . _ @ - and at most 64 characters")
    if not MIN_PASSWORD_LENGTH <= len(password) <= MAX_PASSWORD_LENGTH:
        raise BadRecipe(f"found a password of {len(password)} characters, need {MIN_PASSWORD_LENGTH} or more")
    salt = secrets.token_bytes(16)
    return User(name, role, salt.hex(), _scrypt(password, salt, **cost), **cost)


class Authenticator:
    """Checks passwords, one at a time: a flood of logins takes one hash's memory and one core."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._hashing = threading.Lock()
        self._cached: tuple[object, dict[str, User]] | None = None
        self._had_users = False
        self._unknown_user = User("nobody", "operator", secrets.token_hex(16), "", **SCRYPT_COST)

    @property
    def users(self) -> Mapping[str, User]:
        """As the file has them now.

        Raises:
            BadRecipe: others can read the file, or it isn't as it was written.
        """
        version = _version(self.path)
        self._had_users |= version is not None
        if self._cached is None or self._cached[0] != version:
            self._cached = (version, read_users(self.path))
        return self._cached[1]

    @property
    def login_needed(self) -> bool:
        """Whether there are users or were: with the last one removed nobody may enter, rather than everybody."""
        return bool(self.users) or self._had_users

    def principal(self, name: str | None) -> Principal:
        """What the user of that name may do now; where there never were users, everyone is an engineer.

        Raises:
            BadRecipe: others can read the file, or it isn't as it was written.
        """
        if not self.login_needed:
            return Principal(None, "engineer")
        user = self.users.get(name or "")
        return NOBODY if user is None else Principal(user.name, user.role)

    def check(self, name: str, password: str) -> User | None:
        """The user of that name and password. Takes as long for a name that nobody has."""
        user = self.users.get(name, self._unknown_user)
        with self._hashing:
            digest = _scrypt(password[:MAX_PASSWORD_LENGTH], bytes.fromhex(user.salt), user.n, user.r, user.p)
        is_right = hmac.compare_digest(digest, user.hash)
        return user if is_right and user is not self._unknown_user else None


class Throttle:
    """Failures by (what, which), as in ("user", "anna")."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._failures: dict[tuple[str, str], tuple[int, float]] = {}

    def attempt(self, *keys: tuple[str, str]) -> float:
        """s until the next try is allowed; 0: now, and it counts as a failure until it ``succeeded``."""
        with self._lock:
            wait = max((self._wait(key) for key in keys), default=0.0)
            for key in keys if wait == 0.0 else ():
                count, last = self._failures.pop(key, (0, 0.0))
                forgotten = self._clock() - last > FORGET_FAILURES_AFTER_S
                self._failures[key] = (1 if forgotten else count + 1, self._clock())
            while len(self._failures) > MAX_THROTTLE_KEYS:
                del self._failures[next(iter(self._failures))]
            return wait

    def succeeded(self, *keys: tuple[str, str]) -> None:
        """Take the last attempt back; a user's earlier ones too, an address's not: others may be guessing there."""
        with self._lock:
            for key in keys:
                count, last = self._failures.pop(key, (0, 0.0))
                if count > 1 and key[0] == "address":
                    self._failures[key] = (count - 1, last)

    def _wait(self, key: tuple[str, str]) -> float:
        count, last = self._failures.get(key, (0, 0.0))
        rule, passed = THROTTLE_RULES[key[0]], self._clock() - last
        if count < rule.free_failures or passed > FORGET_FAILURES_AFTER_S:
            return 0.0
        return max(0.0, min(rule.max_wait_s, 2.0 ** min(count - rule.free_failures, 30)) - passed)


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


def _version(path: Path) -> tuple[int, int, int] | None:
    """What differs after a change, even where the clock was set back: written anew, the file is another one."""
    try:
        stat = path.stat()
    except FileNotFoundError:
        return None
    return stat.st_mtime_ns, stat.st_size, stat.st_ino


def _scrypt(password: str, salt: bytes, n: int, r: int, p: int) -> str:
    encoded = password.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(encoded, salt=salt, n=n, r=r, p=p, maxmem=256 * n * r, dklen=32).hex()
