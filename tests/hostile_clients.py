"""50 hostile clients: ``python hostile_clients.py PORT COOKIE CSRF`` runs them until its input ends."""

import os
import socket
import sys
import threading
from contextlib import suppress
from types import SimpleNamespace


class Hostile(threading.Thread):
    """A client that does one bad thing again and again until it is told to stop."""

    def __init__(self, port, over, do, client):
        super().__init__(daemon=True)
        self.port, self.over, self.do, self.client = port, over, do, client

    def run(self):
        while not self.over.is_set():
            with suppress(OSError), socket.create_connection(("127.0.0.1", self.port), timeout=2.0) as connection:
                self.do(connection, self)
            self.over.wait(0.05)

    def trickle(self, connection, data, pause=0.2):
        for k in range(0, len(data), 1):
            if self.over.wait(pause):
                return
            connection.sendall(data[k : k + 1])


def slowloris(connection, me):
    me.trickle(connection, f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{me.port}\r\n".encode() + b"X: y\r\n" * 1000)


def silent(connection, me):
    me.over.wait(60)


def slow_body(connection, me):
    head = f"POST /api/jobs HTTP/1.1\r\nHost: 127.0.0.1:{me.port}\r\nContent-Length: 5000\r\n"
    connection.sendall(f"{head}Cookie: truestand={me.client.cookie}\r\nX-CSRF-Token: {me.client.csrf}\r\n\r\n".encode())
    me.trickle(connection, b" " * 5000)


def huge_body(connection, me):
    head = f"PUT /api/recipes/a.toml HTTP/1.1\r\nHost: 127.0.0.1:{me.port}\r\nTransfer-Encoding: chunked\r\n"
    connection.sendall(f"{head}Cookie: truestand={me.client.cookie}\r\nX-CSRF-Token: {me.client.csrf}\r\n\r\n".encode())
    while not me.over.is_set():
        connection.sendall(b"10000\r\n" + b"x" * 65536 + b"\r\n")


def garbage(connection, me):
    while not me.over.is_set():
        connection.sendall(os.urandom(65536))


def endless_head(connection, me):
    connection.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{me.port}\r\n".encode())
    while not me.over.is_set():
        connection.sendall(b"X: " + b"y" * 1000 + b"\r\n")


def never_reads_a_file(connection, me):
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    for _ in range(20):
        connection.sendall(f"GET /vendor/plotly.min.js HTTP/1.1\r\nHost: 127.0.0.1:{me.port}\r\n\r\n".encode())
    me.over.wait(60)


def upgrade(connection, me):
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    connection.sendall(
        f"GET /api/live HTTP/1.1\r\nHost: 127.0.0.1:{me.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        f"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: {'a' * 22}==\r\n\r\n".encode()
    )


def never_reads_live(connection, me):
    upgrade(connection, me)
    me.over.wait(60)


def pings_and_never_reads(connection, me):
    upgrade(connection, me)
    while not me.over.is_set():
        connection.sendall((b"\x89\xfd\x00\x00\x00\x00" + b"p" * 125) * 100)


def talks_on_the_live_socket(connection, me):
    upgrade(connection, me)
    while not me.over.is_set():
        connection.sendall(b"\x81\xfe\x0f\xa0\x00\x00\x00\x00" + b"t" * 4000)


BAD = [slowloris, silent, slow_body, huge_body, garbage, endless_head, never_reads_a_file, never_reads_live,
       pings_and_never_reads, talks_on_the_live_socket]  # fmt: skip


def main(port, cookie, csrf):
    over, client = threading.Event(), SimpleNamespace(cookie=cookie, csrf=csrf)
    threads = [Hostile(int(port), over, BAD[k % len(BAD)], client) for k in range(50)]
    for thread in threads:
        thread.start()
    print("all there", flush=True)
    sys.stdin.read()
    over.set()
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
