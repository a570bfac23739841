"""libaravis' fake GigE Vision camera in a process of its own: a device that nobody here wrote.

    python fake_camera.py

It runs until its standard input ends. libaravis offers it on the loopback interface only, that is on 127.0.0.1.
"""

import ctypes
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

LIBRARY = "libaravis-0.8.so.0"
ADDRESS, PORT = "127.0.0.1", 3956


def library():
    try:
        return ctypes.CDLL(LIBRARY)
    except OSError:
        return None


class FakeCamera:
    """The camera's process."""

    address = ADDRESS

    def start(self):
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).resolve())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        assert self._process.stdout.readline().strip() == "running"

    def kill(self):
        with self._process:
            self._process.kill()


@contextmanager
def fake_camera(patience=60.0):
    """It runs. One at a time on this machine: two would both get the port, and each other's packets."""
    import pytest  # the camera's own process does without

    with (Path(tempfile.gettempdir()) / "truestand-fake-camera.lock").open("w") as lock:
        wait_for(lock, time.monotonic() + patience)
        if not is_free():
            pytest.skip(f"{ADDRESS}:{PORT} is taken, by a virtual stand perhaps; libaravis knows no other address")
        camera = FakeCamera()
        try:
            camera.start()
            yield camera
        finally:
            camera.kill()


def is_free():
    """Whether nobody is at the camera's address: libaravis shares it, and each gets the other's packets."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as trial:
        try:
            trial.bind((ADDRESS, PORT))
        except OSError:
            return False
    return True


def wait_for(lock, end):
    import fcntl  # not on Windows, where the camera isn't either

    while True:
        try:
            return fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            assert time.monotonic() < end, "another test run on this machine holds the fake camera"
            time.sleep(0.2)


def main():
    arv = library()
    arv.arv_gv_fake_camera_new.restype = ctypes.c_void_p
    arv.arv_gv_fake_camera_is_running.argtypes = [ctypes.c_void_p]
    camera = arv.arv_gv_fake_camera_new(b"lo", b"GV07")
    print("running" if arv.arv_gv_fake_camera_is_running(camera) else "not running", flush=True)
    sys.stdin.read()


if __name__ == "__main__":
    main()
