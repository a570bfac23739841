"""The page over https: the same answers, cookies for https only, and the same patience with those who are slow."""

import datetime
import http.client
import ipaddress
import socket
import ssl
import time
from contextlib import suppress

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from patience import NOT_FOR_EVER
from truestand.web import connections
from web_lab import SERVERS, make_state, served


@pytest.fixture(scope="module")
def pem(tmp_path_factory):
    """A certificate of this machine's address, and its key."""
    folder, key = tmp_path_factory.mktemp("tls"), ec.generate_private_key(ec.SECP256R1())
    name, now = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "stand")]), datetime.datetime.now(datetime.UTC)
    own = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1"))])
    made = (
        x509.CertificateBuilder().subject_name(name).issuer_name(name).public_key(key.public_key())
        .serial_number(7).not_valid_before(now).not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(own, critical=False).sign(key, hashes.SHA256())
    )  # fmt: skip
    (folder / "c.pem").write_bytes(made.public_bytes(serialization.Encoding.PEM))
    plain = serialization.NoEncryption()
    (folder / "k.pem").write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain)
    )
    return folder / "c.pem", folder / "k.pem"


def test_https_answers_with_a_secure_cookie(tmp_path, pem):
    with served(make_state(tmp_path), certificate=pem[0], key=pem[1]) as port:
        trusting = ssl.create_default_context(cafile=str(pem[0]))
        connection = http.client.HTTPSConnection("127.0.0.1", port, context=trusting, timeout=20)
        for origin, status in ((f"https://127.0.0.1:{port}", 200), (f"http://127.0.0.1:{port}", 403)):
            connection.request("GET", "/api/session", headers={"Origin": origin})
            answer = connection.getresponse()
            answer.read()
            assert answer.status == status
            if status == 200:
                assert "; secure" in answer.headers["set-cookie"].lower()
        connection.close()


def test_a_slow_https_client_is_dropped(tmp_path, pem, monkeypatch):
    monkeypatch.setattr(connections, "HEAD_TIMEOUT_S", 0.5)
    with served(make_state(tmp_path), certificate=pem[0], key=pem[1]) as port:
        context = ssl.create_default_context(cafile=str(pem[0]))
        with (
            socket.create_connection(("127.0.0.1", port), timeout=20) as plain,
            context.wrap_socket(plain, server_hostname="127.0.0.1") as slow,
        ):
            slow.sendall(b"GET / HTTP/1.1\r\nHo")
            began = time.monotonic()
            with suppress(OSError):
                assert slow.recv(100) == b""
            assert time.monotonic() - began < NOT_FOR_EVER
        assert not SERVERS[port].monitor.activity
