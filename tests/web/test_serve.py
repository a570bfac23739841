"""``truestand serve`` as a user runs it."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

import truestand
from command import run
from patience import NOT_FOR_EVER
from truestand.files.recipes.recipes import write_starters

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals")


@contextmanager
def serving(folder, *more):
    """The process and its port."""
    write_starters(folder, force=True)
    command = [
        sys.executable,
        "-W",
        "error",
        "-m",
        "truestand",
        "serve",
        "--stand",
        folder / "stand.toml",
        "--port",
        "0",
    ]
    process = subprocess.Popen([*command, *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        line = process.stdout.readline()
        assert line.startswith("truestand: serving "), process.communicate()
        yield process, int(line.rstrip("/\n").rpartition(":")[2])
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def get(port, path):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", path)
    answer = connection.getresponse()
    read = answer.read()
    connection.close()
    return answer.status, read


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serve_prints_its_address_and_ends_cleanly(tmp_path, number):
    with serving(tmp_path) as (process, port):
        status, payload = get(port, "/api/session")
        assert status == 200 and json.loads(payload)["stand"] == tmp_path.name
        process.send_signal(number)
        out, err = process.communicate(timeout=NOT_FOR_EVER)
        assert (process.returncode, out, err) == (0, "", "")


def test_no_private_name_of_a_library_is_used():
    folder = Path(truestand.__file__).parent / "web"
    private = re.compile(r"(?<!\bself)(?<!\bcls)(?<!\btruestand)\._[a-z]\w*")
    found = {path.name: private.findall(path.read_text(encoding="utf-8")) for path in folder.rglob("*.py")}
    assert not {name: parts for name, parts in found.items() if parts}


@posix
def test_serve_ends_with_clients_connected(tmp_path):
    import socket

    with serving(tmp_path) as (process, port):
        crowd = [socket.create_connection(("127.0.0.1", port)) for _ in range(10)]
        crowd[0].sendall(b"GET / HT")
        began = time.monotonic()
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=NOT_FOR_EVER)
        assert time.monotonic() - began < NOT_FOR_EVER and process.returncode == 0, err
        for one in crowd:
            one.close()


def test_a_taken_port_is_reported_in_one_line(tmp_path):
    with serving(tmp_path) as (_, port):
        done = run("serve", "--stand", tmp_path / "stand.toml", "--port", port)
    assert done.returncode == 2 and "--port" in done.stderr and done.stderr.count("\n") == 1


def test_a_missing_stand_is_reported(tmp_path):
    assert run("serve", "--stand", tmp_path / "none.toml").returncode == 2


def test_half_a_certificate_is_refused(tmp_path):
    write_starters(tmp_path)
    done = run("serve", "--stand", tmp_path / "stand.toml", "--tls-key", tmp_path / "k.pem")
    assert done.returncode == 2 and "need both" in done.stderr


def test_help_has_an_example():
    assert "truestand serve --stand stand.toml --open" in run("serve", "--help").stdout


def used(pid):
    """MB resident and s of CPU."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6, (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="read from /proc")
def test_idle_server_takes_little_memory_and_cpu(tmp_path):
    with serving(tmp_path) as (process, port):
        for path in ("/", "/api/home", "/api/recipes/gear.toml", "/api/openapi.json", "/vendor/plotly.min.js") * 3:
            get(port, path)
        before, began = used(process.pid)[1], time.monotonic()
        time.sleep(20)
        memory, after = used(process.pid)
        share = (after - before) / (time.monotonic() - began)
    print(f"{memory:.0f} MB, {100 * share:.2f} % of a core")
    assert memory < 200 and share < 0.05
