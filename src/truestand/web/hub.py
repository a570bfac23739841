"""From one publisher to any number of listeners: each gets the newest message of every kind, never a backlog.

Publishing costs the publisher a lock and nothing else, however many listen and however slow they are.
"""

import asyncio
import threading


class Hub:
    """The newest message of each kind."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._newest: dict[str, tuple[int, str]] = {}
        self._version = 0
        self._wake_pending = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self.listeners: set[Listener] = set()

    def publish(self, kind: str, message: str | None) -> None:
        """Replace the newest message of a kind, from any thread; None removes it."""
        with self._lock:
            self._version += 1
            if message is None:
                self._newest.pop(kind, None)
                return
            self._newest[kind] = (self._version, message)
            if self._loop is None or self._wake_pending:
                return
            self._wake_pending = True
            self._loop.call_soon_threadsafe(self._wake)

    def listen(self) -> "Listener":
        """Add a listener; called in the event loop."""
        self._loop = asyncio.get_running_loop()
        listener = Listener(self)
        self.listeners.add(listener)
        return listener

    def leave(self, listener: "Listener") -> None:
        """Remove a listener."""
        self.listeners.discard(listener)

    def newer(self, seen: int) -> tuple[int, list[str]]:
        """The messages that came after version ``seen``, the oldest first, and the version to ask with next."""
        with self._lock:
            return self._version, [m for version, m in sorted(self._newest.values()) if version > seen]

    def _wake(self) -> None:
        with self._lock:
            self._wake_pending = False
        for listener in self.listeners:
            listener.published.set()


class Listener:
    """A consumer that takes messages at its own pace."""

    def __init__(self, hub: Hub) -> None:
        self._hub, self._seen = hub, 0
        self.published = asyncio.Event()
        """Set where there may be something new."""

    async def next(self) -> list[str]:
        """Wait for messages newer than the last call's; the first call gets what is there."""
        while True:
            self.published.clear()
            self._seen, messages = self._hub.newer(self._seen)
            if messages:
                return messages
            await self.published.wait()
