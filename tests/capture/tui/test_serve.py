"""Who may reach the screen in a browser: this machine by its own name, others by the token alone."""

import http.client
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("textual_serve", reason="the extra `serve` is not installed")

UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
}


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Served:
    """`capture SESSION --serve` in a process of its own."""

    def __init__(self, session: Path, *options: str) -> None:
        self.port = free_port()
        command = [sys.executable, "-m", "capture", str(session), "--serve", "--port", str(self.port), *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        assert self.process.stdout
        self.address = self.process.stdout.readline().strip()

    def status(self, path: str, **headers: str) -> int:
        return self.get(path, **headers)[0]

    def get(self, path: str, **headers: str) -> tuple[int, str, http.client.HTTPMessage]:
        for _ in range(100):
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
            try:
                connection.request("GET", path, headers={name.replace("_", "-"): value for name, value in headers.items()})
                answer = connection.getresponse()
                body = "" if answer.status == 101 else answer.read().decode(errors="replace")
                return answer.status, body, answer.msg
            except ConnectionRefusedError:
                time.sleep(0.1)  # it is still starting
            finally:
                connection.close()
        raise AssertionError(f"nothing is served: {self.address}")

    def end(self) -> tuple[str, str]:
        self.process.send_signal(signal.SIGINT)
        return self.process.communicate(timeout=30)


@pytest.fixture
def local(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path / "session")
    yield served
    served.end()


@pytest.fixture
def open_to_all(tmp_path: Path) -> Iterator[Served]:
    served = Served(tmp_path / "session", "--host", "0.0.0.0")
    yield served
    served.end()


def test_this_machine_needs_no_token_and_other_names_are_refused(local: Served) -> None:
    assert local.address == f"http://127.0.0.1:{local.port}/"
    status, page, _ = local.get("/")
    assert status == 200
    assert "googleapis" not in page  # a Pi may have no network, and nobody else need know
    assert f"ws://127.0.0.1:{local.port}/ws" in page
    assert local.status("/", Host=f"localhost:{local.port}") == 200
    assert local.status("/", Host="evil.example") == 403
    assert local.status("/ws", Host="evil.example", **UPGRADE) == 403
    assert local.status("/ws", Origin="http://evil.example", **UPGRADE) == 403
    assert local.status("/ws", Origin=f"http://127.0.0.1:{local.port}", **UPGRADE) == 101


@pytest.mark.parametrize("path", ["/", "/ws", "/static/js/textual.js", "/download/x", "/nothing"])
def test_without_the_token_nothing_is_served(open_to_all: Served, path: str) -> None:
    headers = UPGRADE if path == "/ws" else {}
    assert open_to_all.status(path, **headers) == 403
    assert open_to_all.status(f"{path}?token=", **headers) == 403
    assert open_to_all.status(f"{path}?token=wrong", **headers) == 403
    assert open_to_all.status(path, Cookie="refracal=wrong", **headers) == 403


def test_the_token_opens_page_and_websocket_and_is_printed_once(open_to_all: Served) -> None:
    found = re.fullmatch(rf"http://0\.0\.0\.0:{open_to_all.port}/\?token=([\w-]{{32}})", open_to_all.address)
    assert found
    token = found[1]
    status, page, headers = open_to_all.get(f"/?token={token}")
    assert status == 200
    assert token not in page
    assert headers["Referrer-Policy"] == "no-referrer"
    cookie = headers["Set-Cookie"].split(";")[0]
    assert "HttpOnly" in headers["Set-Cookie"]
    assert "SameSite=Strict" in headers["Set-Cookie"]
    assert open_to_all.status("/static/js/textual.js", Cookie=cookie) == 200
    assert open_to_all.status("/ws", Cookie=cookie, **UPGRADE) == 101
    assert open_to_all.status("/ws", Cookie=cookie, Origin="http://evil.example", **UPGRADE) == 403
    out, err = open_to_all.end()
    assert token not in out + err


def test_an_address_that_is_taken_is_said(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-m", "capture", str(tmp_path / "session"), "--serve", "--port", port]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert f"127.0.0.1:{port} cannot be served on" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
