"""Who may use the OPC UA server: the page's users, with the page's roles, asked again with every request."""

import hashlib
import hmac
import secrets
from contextvars import ContextVar
from typing import Any

from asyncua import ua
from asyncua.crypto.permission_rules import USER_TYPES, SimpleRoleRuleset, User, UserRole
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.user_managers import UserManager

from truestand.core.errors import TruestandError
from truestand.web.app_state import AppState
from truestand.web.authentication import NOBODY, Authenticator, Principal

ALLOWED_REQUESTS = frozenset(ua.NodeId(ua.Int32(number)) for number in USER_TYPES)
"""Reading, subscribing, calling: none that changes the address space."""
ANONYMOUS = User(UserRole.Anonymous)
caller: ContextVar[Principal] = ContextVar("caller")
"""Who sent the request that is being answered."""
peer: ContextVar[str] = ContextVar("peer", default="")
"""The address that a login comes from; connections that take over a session begun on another one share the default."""


class PeerRecordingServer(InternalServer):
    """Notes the address where a session begins: asyncua answers each connection in a task of its own."""

    def create_session(self, name: Any, user: User = ANONYMOUS, external: bool = False) -> InternalSession:
        """asyncua names a client's session by its socket's address."""
        if external and name:
            peer.set(str(name[0]))
        return super().create_session(name, user, external)


class OpcUaUserManager(UserManager):
    """Names and passwords as on the page. A login costs a hash the first time, and is throttled as the page's are.

    asyncua asks in the event loop, so that each hash holds the page up for a fifth of a second; one that succeeded is
    remembered for as long as the user is the same.
    """

    def __init__(self, state: AppState) -> None:
        self._state = state
        self._secret = secrets.token_bytes(32)
        self._known: dict[str, bytes] = {}

    def get_user(
        self, iserver: Any, username: str | None = None, password: str | None = None, certificate: Any = None
    ) -> User | None:
        """The session's user; None: refused."""
        try:
            if not self._state.authenticator.login_needed:
                return User(UserRole.User)
            return self._logged_in(username, password) if username and password else None
        except TruestandError:
            return None

    def _logged_in(self, name: str, password: str) -> User | None:
        user = self._state.authenticator.users.get(name)
        credentials = f"{name}\0{user.hash if user else ''}\0{password}".encode("utf-8", "surrogatepass")
        digest = hmac.digest(self._secret, credentials, hashlib.sha256)
        if user is not None and hmac.compare_digest(self._known.get(name, b""), digest):
            return User(UserRole.User, name)
        # apart from the page's: a controller that tries the wrong password again and again locks no browser out
        keys = (("address", f"opcua {peer.get()}"), ("user", name))
        if self._state.throttle.attempt(*keys) > 0 or self._state.authenticator.check(name, password) is None:
            return None
        self._state.throttle.succeeded(*keys)
        self._known[name] = digest
        return User(UserRole.User, name)


class AccessRules(SimpleRoleRuleset):
    """Each request by the role that its session's user has now."""

    def __init__(self, authenticator: Authenticator) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._authenticator = authenticator

    def check_validity(self, user: User, action_type_id: ua.NodeId, body: Any) -> bool:
        """Whether a request may be answered; notes who sent it."""
        try:
            principal = self._authenticator.principal(user.name) if user.role is UserRole.User else NOBODY
        except TruestandError:
            principal = NOBODY
        caller.set(principal)
        return principal.role is not None and action_type_id in ALLOWED_REQUESTS
