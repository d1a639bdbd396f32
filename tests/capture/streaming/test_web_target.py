"""The stream over HTTP: nothing without the token, pictures that OpenCV reads, viewers that take
nothing, and the view that a request changes.
"""

import http.client
import json
import socket
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the extra `serve` is not installed")

from calib.calibration import Calibration
from calib.errors import InputError
from capture.streaming import web_target
from capture.streaming.straightener import Straightener
from capture.streaming.view import StreamView
from capture.streaming.web_target import WebTarget
from tests.capture.streaming.listening import HANGS_S, Remarks, wait_until

PATHS = ("/", "/stream.mjpg", "/state", "/page/stream.js", "/page/page.js", "/nothing")


class Served:
    """A target that serves one straight picture again and again, from a thread."""

    def __init__(self, calibration: Calibration, picture: np.ndarray) -> None:
        self.remarks = Remarks()
        self.straightener = Straightener(calibration, StreamView(0.5))
        self.target = WebTarget(
            "127.0.0.1", 0, self.straightener.change, self.state, self.remarks.tell
        )
        self.depth_image: str | None = None
        self.shown = 0
        self._picture = picture
        self._over = threading.Event()

    def state(self) -> Mapping[str, object]:
        view = self.straightener.view
        numbers = {"depth": view.depth, "crop": view.crop, "scale": view.scale}
        return {"view": numbers, "depth_image": self.depth_image, "counts": ""}

    @contextmanager
    def running(self) -> Iterator["Served"]:
        with self.target:
            thread = threading.Thread(target=self._show)
            thread.start()
            try:
                yield self
            finally:
                self._over.set()
                thread.join(HANGS_S)

    def _show(self) -> None:
        while not self._over.wait(0.002):
            self.target.show(self.straightener.straighten(self._picture))
            self.shown += 1

    def connection(self) -> http.client.HTTPConnection:
        return http.client.HTTPConnection(str(urlsplit(self.target.address).netloc), timeout=600)

    def ask(self, path: str, body: str | None = None, **headers: str) -> tuple[int, str]:
        """Return the status and the text of an answer."""
        connection = self.connection()
        try:
            connection.request("GET" if body is None else "POST", path, body, headers)
            answer = connection.getresponse()
            return answer.status, answer.read().decode()
        finally:
            connection.close()

    @property
    def query(self) -> str:
        return urlsplit(self.target.address).query


@pytest.fixture
def served(calibration: Calibration, pictures: list[np.ndarray]) -> Iterator[Served]:
    with Served(calibration, pictures[0]).running() as running:
        yield running


@pytest.mark.parametrize("path", PATHS)
def test_without_the_token_nothing_is_served(served: Served, path: str) -> None:
    assert served.ask(path)[0] == 403
    assert served.ask(f"{path}?token=x")[0] == 403
    assert served.ask(path, Cookie="refracal-stream=x")[0] == 403
    assert served.ask(path, Cookie=f"refracal={served.query[6:]}")[0] == 403


def test_the_token_opens_the_page_and_stays_as_a_cookie(served: Served) -> None:
    connection = served.connection()
    connection.request("GET", f"/?{served.query}")
    answer = connection.getresponse()
    page = answer.read().decode()
    assert answer.status == 200
    assert "/stream.mjpg" in page
    cookie = str(answer.headers["Set-Cookie"])
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "frame-ancestors 'none'" in str(answer.headers["Content-Security-Policy"])
    connection.close()
    status, state = served.ask("/state", Cookie=cookie.partition(";")[0])
    assert status == 200
    assert json.loads(state)["view"] == {"depth": 0.5, "crop": None, "scale": 1.0}


def test_a_page_of_another_origin_cannot_change_the_view(served: Served) -> None:
    path = f"/view?{served.query}"
    assert served.ask(path, '{"depth": 9}', Origin="http://evil.example")[0] == 403
    assert served.straightener.requested.depth == 0.5


def test_opencv_reads_the_stream(served: Served, pictures: list[np.ndarray]) -> None:
    video = cv2.VideoCapture(served.target.address.replace("/?", "/stream.mjpg?"), cv2.CAP_FFMPEG)
    success, frame = video.read()
    assert success
    expected = Straightener(served.straightener._calibration, StreamView(0.5))
    straight = expected.straighten(pictures[0]).astype(int)
    assert np.abs(frame.astype(int) - straight).mean() < 3, "grey levels, of the JPEG"
    assert video.read()[0]
    video.release()


def test_a_request_changes_the_view(served: Served) -> None:
    path = f"/view?{served.query}"
    assert served.ask(path, '{"depth": 0.3, "crop": 0, "scale": 0.5}')[0] == 200
    served.straightener.wait()
    assert served.straightener.view == StreamView(0.3, 0.0, 0.5)


def test_an_infinite_depth_is_json_for_a_browser(served: Served) -> None:
    served.straightener.change({"depth": float("inf")})
    served.straightener.wait()
    state = served.ask(f"/state?{served.query}")[1]
    assert json.loads(state, parse_constant=pytest.fail)["view"]["depth"] is None


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ('{"depth": -1}', "depth is -1: write metres above 0"),
        ('{"depth": NaN}', "depth is nan"),
        ('{"zoom": 2}', "zoom is not of a view"),
        ("[1]", "write an object with depth, crop or scale"),
        ("{", "The request is not JSON"),
        ("[" * 900, "The request is not JSON"),
    ],
)
def test_a_wrong_request_gets_a_sentence(served: Served, body: str, sentence: str) -> None:
    status, answer = served.ask(f"/view?{served.query}", body)
    assert status == 400
    assert sentence in json.loads(answer)["error"]
    assert served.straightener.requested == StreamView(0.5)


def test_a_large_request_is_refused(served: Served) -> None:
    assert served.ask(f"/view?{served.query}", " " * 5000)[0] == 413


def test_a_viewer_that_takes_nothing_is_disconnected_and_the_others_go_on(
    calibration: Calibration, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_target, "STALL_S", 0.2)
    monkeypatch.setattr(web_target, "JPEG", [cv2.IMWRITE_JPEG_QUALITY, 100])  # fills buffers soon
    with Served(calibration, pictures[0]).running() as served:
        address = urlsplit(served.target.address)
        assert address.hostname
        assert address.port
        with socket.create_connection((address.hostname, address.port)) as silent:
            silent.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            silent.sendall(f"GET /stream.mjpg?{address.query} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
            wait_until(lambda: served.target._viewers, "the viewer")
            shown = served.shown
            wait_until(lambda: not served.target._viewers, "its end")
            assert served.shown > shown, "pictures were shown meanwhile"
        assert "A viewer took no picture for 0 s and is disconnected." in served.remarks.sentences


def test_too_many_viewers_are_refused(
    calibration: Calibration, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_target, "MAX_VIEWERS", 1)
    with Served(calibration, pictures[0]).running() as served:
        first = served.connection()
        first.request("GET", f"/stream.mjpg?{served.query}")
        assert first.getresponse().status == 200
        assert served.ask(f"/stream.mjpg?{served.query}")[0] == 503
        first.close()


def test_nothing_is_encoded_when_nobody_looks(
    calibration: Calibration, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    def imencode(*_: object) -> None:
        raise AssertionError("a picture was encoded")

    monkeypatch.setattr(cv2, "imencode", imencode)
    with Served(calibration, pictures[0]).running() as served:
        wait_until(lambda: served.shown > 3, "a few pictures")


def test_an_occupied_port_is_refused() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        target = WebTarget("127.0.0.1", port, print, dict, print)
        with pytest.raises(
            InputError, match=f"127.0.0.1:{port} cannot be served on .* or port, as --to http:8081"
        ):
            target.__enter__()
