"""Who may log in: ``<store>.users.json``, readable by its owner only. Passwords are kept as scrypt hashes."""

import hashlib
import hmac
import json
import os
import re
import secrets
import sys
import tempfile
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, get_args

from truestand.core.errors import BadRecipe

Role = Literal["operator", "engineer"]
ROLES: tuple[Role, ...] = get_args(Role)
COST = {"n": 1 << 14, "r": 8, "p": 5}
"""scrypt, as OWASP's Password Storage Cheat Sheet has it: 16 MB, about a fifth of a second."""
SHORTEST, LONGEST = 10, 1024
"""Characters of a password; NIST SP 800-63B asks for 8 at least."""
NAME = re.compile(r"[^\W_][\w .@-]{0,63}")
FORMAT = "truestand.users"


@dataclass(frozen=True, slots=True)
class User:
    """One who may log in."""

    name: str
    role: Role
    salt: str
    """Hex."""
    hash: str
    """Hex."""
    n: int
    r: int
    p: int


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
        told = json.loads(path.read_text(encoding="utf-8"))
        found = [User(**one) for one in told["users"]]
        if told["format"] != FORMAT or not all(u.role in ROLES for u in found):
            raise ValueError
    except (ValueError, KeyError, TypeError) as wrong:
        raise BadRecipe(f"{path}: found no list of users; remove it, and add them again with --add-user") from wrong
    return {user.name: user for user in found}


def write_users(path: Path, users: Mapping[str, User]) -> None:
    """As a whole, and never for other eyes than the owner's."""
    told = {"format": FORMAT, "version": 1, "users": [asdict(u) for u in users.values()]}
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")  # 0600 from the start
    temporary = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(json.dumps(told, indent=2) + "\n")
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def make_user(name: str, role: Role, password: str, cost: Mapping[str, int] = COST) -> User:
    """A user with a fresh salt; ``cost``: scrypt's n, r and p.

    Raises:
        BadRecipe: a name or password that won't do.
    """
    if not NAME.fullmatch(name):
        raise BadRecipe(f"found user {name!r}, need a name of letters, digits, . _ @ - and at most 64 characters")
    if not SHORTEST <= len(password) <= LONGEST:
        raise BadRecipe(f"found a password of {len(password)} characters, need {SHORTEST} or more")
    salt = secrets.token_bytes(16)
    return User(name, role, salt.hex(), _scrypt(password, salt, **cost), **cost)


class Gatekeeper:
    """Checks passwords, one at a time: a flood of logins takes one hash's memory and one core."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._hashing = threading.Lock()
        self._read: tuple[object, dict[str, User]] | None = None
        self._guarded = False
        self._nobody = User("nobody", "operator", secrets.token_hex(16), "", **COST)

    @property
    def users(self) -> Mapping[str, User]:
        """As the file has them now."""
        version = _version(self.path)
        self._guarded |= version is not None
        if self._read is None or self._read[0] != version:
            self._read = (version, read_users(self.path))
        return self._read[1]

    @property
    def login_needed(self) -> bool:
        """Whether there are users or were: with the last one removed nobody may enter, rather than everybody."""
        return bool(self.users) or self._guarded

    def check(self, name: str, password: str) -> User | None:
        """The user of that name and password. Takes as long for a name that nobody has."""
        user = self.users.get(name, self._nobody)
        with self._hashing:
            found = _scrypt(password[:LONGEST], bytes.fromhex(user.salt), user.n, user.r, user.p)
        right = hmac.compare_digest(found, user.hash)
        return user if right and user is not self._nobody else None


def _version(path: Path) -> tuple[int, int, int] | None:
    """What differs after a change, even where the clock was set back: written anew, the file is another one."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino


def _scrypt(password: str, salt: bytes, n: int, r: int, p: int) -> str:
    told = password.encode("utf-8", "surrogatepass")
    return hashlib.scrypt(told, salt=salt, n=n, r=r, p=p, maxmem=256 * n * r, dklen=32).hex()
