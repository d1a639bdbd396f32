"""Access to the screen in a browser: this machine by its own name, others only by the token."""

import http.client
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
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
    """Run `capture SESSION --serve` in a separate process."""

    def __init__(self, session: Path, *options: str) -> None:
        self.port = free_port()
        command = [
            sys.executable,
            "-m",
            "capture",
            str(session),
            "--serve",
            "--port",
            str(self.port),
            *options,
        ]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout
        self.address = self.process.stdout.readline().strip()

    def status(self, path: str, **headers: str) -> int:
        return self.get(path, **headers)[0]

    def get(self, path: str, **headers: str) -> tuple[int, str, http.client.HTTPMessage]:
        for _ in range(100):
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=600)
            try:
                connection.request(
                    "GET",
                    path,
                    headers={name.replace("_", "-"): value for name, value in headers.items()},
                )
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
        return self.process.communicate(timeout=600)


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


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/ws",
        "/static/js/textual.js",
        "/page/page.js",
        "/download/x",
        "/files/x/report.html",
        "/nothing",
    ],
)
def test_without_the_token_nothing_is_served(open_to_all: Served, path: str) -> None:
    headers = UPGRADE if path == "/ws" else {}
    assert open_to_all.status(path, **headers) == 403
    assert open_to_all.status(f"{path}?token=", **headers) == 403
    assert open_to_all.status(f"{path}?token=wrong", **headers) == 403
    assert open_to_all.status(path, Cookie="refracal=wrong", **headers) == 403


def test_the_token_opens_page_and_websocket_and_is_printed_once(open_to_all: Served) -> None:
    result = re.fullmatch(
        rf"http://([\w.-]+):{open_to_all.port}/\?token=([\w-]{{32}})", open_to_all.address
    )
    assert result
    host, token = result.groups()
    assert host != "0.0.0.0"
    with socket.create_connection((host, open_to_all.port), timeout=600):
        pass  # what is printed can be opened
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


def test_an_address_in_use_is_reported(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        command = [
            sys.executable,
            "-m",
            "capture",
            str(tmp_path / "session"),
            "--serve",
            "--port",
            port,
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 2
    assert f"127.0.0.1:{port} cannot be served on" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_no_page_can_frame_it(local: Served) -> None:
    for path, host in (
        ("/", f"127.0.0.1:{local.port}"),
        ("/static/js/textual.js", f"127.0.0.1:{local.port}"),
        ("/", "evil.example"),
    ):
        headers = local.get(path, Host=host)[2]
        assert headers["X-Frame-Options"] == "DENY", path
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"], path


def test_no_script_runs_but_those_that_are_served(local: Served) -> None:
    for path in ("/", "/page/page.js", "/static/js/textual.js"):
        _, body, headers = local.get(path)
        assert "script-src 'self'" in headers["Content-Security-Policy"], path
        if path == "/":
            assert re.findall(r"<script[^>]*>(?!</script>)|\son\w+=", body) == []
            assert re.findall(r'(?:src|href)="(?!/)[^"]*"', body) == [
                f'{kind}="http://127.0.0.1:{local.port}/static/{file}"'
                for kind, file in (("href", "css/xterm.css"), ("src", "js/textual.js"))
            ]
    assert local.status("/page/") == 403  # no list of files
    assert local.status("/page/../serve.py") == 404


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["--port", "99999"],
            (
                "argument --port: '99999' is not a port: write a whole number from 1 to 65535, such"
                " as 8000"
            ),
        ),
        (["--port", "-1"], "is not a port"),
        (["--host", "a..b"], "a..b:8000 cannot be served on"),
        (["--host", "x" * 300], "cannot be served on"),
        (["--apps", "0"], "is not a number of windows"),
    ],
)
def test_an_impossible_address_is_refused_before_it_is_printed(
    options: list[str], says: str, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "capture", str(tmp_path / "session"), "--serve", *options]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 2
    assert done.stdout == ""
    assert says in done.stderr
    assert "Traceback" not in done.stderr


def test_malformed_requests_are_answered_without_a_traceback(open_to_all: Served) -> None:
    for raw in (
        b"GET / HTTP/1.1\r\nHost: a\r\nCookie: refracal=\xff\xe9\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nX: " + b"y" * 200_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: a\r\nOrigin: http://[x\r\n\r\n",
        b"\x16\x03\x01 no http\r\n\r\n",
    ):
        open_to_all.status("/")  # it has begun to listen
        with socket.create_connection(("127.0.0.1", open_to_all.port), timeout=600) as connection:
            connection.sendall(raw)
            assert re.match(rb"HTTP/1\.[01] (400|403) ", connection.recv(100))
    _, err = open_to_all.end()
    assert "Traceback" not in err
    assert "Error" not in err


def apps_of(server: int) -> list[int]:
    """Return the processes that a server has started."""
    result = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError):
            if int(stat.read_text().rpartition(")")[2].split()[1]) == server:
                result.append(int(stat.parent.name))
    return result


def opened(served: Served) -> socket.socket:
    """A window's websocket, which its app has begun to draw to."""
    connection = socket.create_connection(("127.0.0.1", served.port), timeout=600)
    head = "".join(f"{key}: {value}\r\n" for key, value in UPGRADE.items())
    connection.sendall(f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{served.port}\r\n{head}\r\n".encode())
    assert b" 101 " in connection.recv(4096)
    assert connection.recv(1), "the app draws"
    return connection


def wait_for(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + 600
    while not holds():
        assert time.monotonic() < end, "it never came"
        time.sleep(0.1)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_a_second_window_ends_the_first_and_a_killed_server_ends_both(local: Served) -> None:
    local.status("/")
    first = opened(local)
    (app,) = apps_of(local.process.pid)
    with first, opened(local):
        wait_for(lambda: app not in apps_of(local.process.pid))
        (second,) = apps_of(local.process.pid)
        local.process.kill()
        wait_for(
            lambda: (
                not Path(f"/proc/{second}").exists()
                or " Z " in Path(f"/proc/{second}/stat").read_text()
            )
        )


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are looked up in /proc")
def test_messages_of_any_kind_end_with_their_window(local: Served) -> None:
    local.status("/")
    with opened(local) as window:
        for text in (
            "[",
            '["stdin", 5]',
            '["stdin", "' + "x" * 50_000 + '"]',
            '["resize", {"width": 1e8, "height": 100000000}]',
            '["resize", {"width": "a", "height": null}]',
            '["resize"]',
            "{}",
            "[]",
        ):
            window.sendall(frame(text.encode()))
    wait_for(lambda: not apps_of(local.process.pid))
    _, err = local.end()
    assert "Traceback" not in err


def frame(payload: bytes) -> bytes:
    """Encode a message as a browser sends it: masked, here by zeros."""
    length = (
        bytes([0x80 | len(payload)])
        if len(payload) < 126
        else b"\xfe" + len(payload).to_bytes(2, "big")
    )
    return b"\x81" + length + bytes(4) + payload


def test_the_requested_window_size_is_limited() -> None:
    from capture.serve import _size

    assert _size({"width": "100", "height": 30}) == {"width": 100, "height": 30}
    assert _size({"width": 1e8, "height": "100000000000000"}) == {"width": 500, "height": 200}
    assert _size({"width": None, "height": "x"}) == {"width": 80, "height": 24}
    assert _size({"width": 1, "height": -5}) == {"width": 20, "height": 5}


def test_an_address_of_one_interface_is_printed_as_it_is_and_without_a_network_the_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from capture.listening import reachable_address

    assert [reachable_address(host) for host in ("192.168.1.5", "fe80::1", "pi.local")] == [
        "192.168.1.5",
        "fe80::1",
        "pi.local",
    ]

    def unreachable(*_: object) -> None:
        raise OSError("Network is unreachable")

    monkeypatch.setattr(socket.socket, "connect", unreachable)
    assert reachable_address("0.0.0.0") == socket.gethostname()
