"""A server in a thread of its own, with a loop of its own: started, told its port, stopped with nothing left open."""

import asyncio
import threading

PATIENCE = 10.0
"""s for a server to start or end."""


class ServerThread:
    """What the servers share. They run ``_serve`` until ``_ended``."""

    def __init__(self) -> None:
        self.address = ""
        """Where a driver finds it, known once it started: the ``address`` of its recipe."""
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._trouble: BaseException | None = None

    async def _serve(self, started: threading.Event) -> None:
        raise NotImplementedError

    def start(self) -> None:
        """Serve from now on.

        Raises:
            OSError: the port is taken.
        """
        started = threading.Event()
        self._ended.clear()
        self._thread = threading.Thread(target=self._run, args=(started,), name=type(self).__name__, daemon=True)
        self._thread.start()
        if not started.wait(PATIENCE) or self._trouble is not None:
            self.stop()
            raise OSError(f"{type(self).__name__}: can't serve ({self._trouble or 'no start'})") from self._trouble

    def stop(self) -> None:
        """Close the port and all connections."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join(PATIENCE)
            self._thread = None

    def _run(self, started: threading.Event) -> None:
        try:
            asyncio.run(self._serve(started))
        except (OSError, RuntimeError) as wrong:
            self._trouble = wrong
            started.set()
