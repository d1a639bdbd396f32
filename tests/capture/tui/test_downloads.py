"""The report and the exported files on the device that shows the page: behind the same token as the
page itself, and nothing else of this machine with them.
"""

import http.client
import io
import os
import re
from base64 import b64decode
from pathlib import Path
from zipfile import ZipFile

import cv2
import numpy as np
import pytest

pytest.importorskip("textual_serve", reason="the extra `serve` is not installed")

import asyncio

from aiohttp import ClientSession
from aiohttp.test_utils import make_mocked_request
from aiohttp.web import Response

from calib.cli import main
from capture.offered_files import CHUNK_BYTES, archive_chunks, send_files
from capture.picture_pair import MAX_WIDTH, pair_page
from capture.tui.downloads import OPEN_REPORT, find_downloads
from tests.capture.tui.test_phone_link import Page
from tests.capture.tui.test_serve import Served


def test_an_archive_is_made_in_pieces(tmp_path: Path) -> None:
    contents = {"a.npz": os.urandom(3 * CHUNK_BYTES + 7), "ö b.yaml": b"x: 1\n", "empty.txt": b""}
    contents |= {f"straight_{depth}m/0000.png": depth.encode() for depth in ("0.5", "1")}
    for name, content in contents.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    pieces = list(archive_chunks([tmp_path / name for name in contents]))
    assert max(map(len, pieces)) < 2 * CHUNK_BYTES
    with ZipFile(io.BytesIO(b"".join(pieces))) as archive:
        assert archive.testzip() is None
        written = {name: archive.read(name) for name in archive.namelist()}
        assert written == {f"{tmp_path.name}/{name}": data for name, data in contents.items()}


def test_what_is_older_than_the_fit_or_lies_elsewhere_is_not_offered(tmp_path: Path) -> None:
    calibration = tmp_path / "s" / "calibration" / "calibration.yaml"
    exported = tmp_path / "s" / "export"
    calibration.parent.mkdir(parents=True)
    exported.mkdir()
    (exported / "old.npz").write_text("old")
    os.utime(exported / "old.npz", (1, 1))
    calibration.write_text("format: 1")
    secret = tmp_path / "secret"
    secret.write_text("secret")
    (exported / "link.npz").symlink_to(secret)
    (calibration.parent / "report.html").symlink_to(secret)
    assert list(find_downloads(tmp_path / "s", calibration, [])) == []
    (exported / "map_1m.npz").write_text("new")
    (download,) = find_downloads(tmp_path / "s", calibration, [])
    assert download.files == ((exported / "map_1m.npz").resolve(),)
    assert download.name == "s-export.zip"
    elsewhere = tmp_path / "elsewhere.npz"
    elsewhere.write_text("exported into a folder of the person's own")
    (download,) = find_downloads(tmp_path / "s", calibration, [elsewhere])
    assert download.files == (elsewhere.resolve(),)


def test_straight_pictures_are_offered_by_their_depth_and_one_beside_its_original(
    tmp_path: Path,
) -> None:
    calibration = tmp_path / "s" / "calibration" / "calibration.yaml"
    calibration.parent.mkdir(parents=True)
    calibration.write_text("format: 1")
    pictures = [
        tmp_path / "s" / "export" / f"straight_{depth}m" / "0000.png" for depth in ("0.5", "1")
    ]
    for picture in pictures:
        picture.parent.mkdir(parents=True)
        picture.write_bytes(b"png")
    original = tmp_path / "s" / "frames" / "0000.png"
    (archive,) = find_downloads(tmp_path / "s", calibration, pictures)
    original.parent.mkdir()
    original.write_bytes(b"png")
    archive, pair = find_downloads(tmp_path / "s", calibration, pictures)
    assert archive.label == "Download pictures, 0.5m, 1m (0.0 MB)"
    assert archive.name == "s-straight_0.5m-straight_1m.zip"
    assert pair.label == "See before and after, 0.5m"
    assert pair.name == "before-and-after-0.5m.html"
    assert pair.files == (original.resolve(), pictures[0].resolve())


def test_a_pair_is_a_page_by_itself(tmp_path: Path) -> None:
    """A picture of 16 bits and one in colour, both too wide for a phone, become readable JPEG."""
    original = tmp_path / "a&b.png"
    straight = tmp_path / "straight_0.5m" / original.name
    straight.parent.mkdir()
    cv2.imwrite(str(original), np.full((20, 2 * MAX_WIDTH), 40000, np.uint16))
    cv2.imwrite(str(straight), np.full((20, 2 * MAX_WIDTH, 3), (0, 0, 250), np.uint8))
    page = pair_page(original, straight)
    assert "a&amp;b.png, as the camera took it" in page
    assert "straight at a depth of 0.5 m" in page
    jpegs = [b64decode(data) for data in re.findall(r'src="data:image/jpeg;base64,([^"]*)"', page)]
    pictures = [np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), -1)) for data in jpegs]
    assert [picture.shape for picture in pictures] == [(10, MAX_WIDTH), (10, MAX_WIDTH, 3)]
    assert pictures[1][5, 5, 2] > 240
    request = make_mocked_request("GET", "/files/key/before-and-after-0.5m.html")
    answer = asyncio.run(send_files(request, (original, straight)))
    assert isinstance(answer, Response)
    assert (answer.status, answer.text) == (200, page)
    assert "sandbox" in answer.headers["Content-Security-Policy"]
    original.write_bytes(b"not a picture")
    assert asyncio.run(send_files(request, (original, straight))).status == 404


@pytest.mark.slow
def test_report_and_maps_reach_a_phone_that_has_the_token(session: Path) -> None:
    calibration = str(session / "calibration")
    assert main(["report", calibration, "--no-open"]) == 0
    export = ["export", calibration, "--format", "npz", "--depth", "1"]
    assert main([*export, "-o", str(session / "export")]) == 0
    served = Served(session, "--host", "0.0.0.0")
    token = served.address.rpartition("=")[2]
    try:
        served.status("/")  # it has begun to listen
        asyncio.run(_fetch(served, token, session))
    finally:
        _, err = served.end()
    assert "Traceback" not in err


async def _fetch(served: Served, token: str, session: Path) -> None:
    cookie = f"refracal={token}"
    async with (
        ClientSession(headers={"Cookie": cookie}) as client,
        client.ws_connect(f"http://127.0.0.1:{served.port}/ws", max_msg_size=0) as socket,
    ):
        page = Page(socket)
        await page.ask(view=True)
        await page.see("It is fitted")
        assert page.screen["files"] == [], "nothing before the results are open"
        await page.ask(screen=page.screen["screen"], press="ctrl+o")
        await page.hear(lambda: len(page.screen.get("files", ())) == 2)
        report, maps = page.screen["files"]
        assert report["label"] == OPEN_REPORT
        assert "MB" in maps["label"]
        for path in (report["address"], maps["address"]):
            assert served.status(path) == 403
            assert served.status(path, Cookie="refracal=wrong") == 403
            assert served.status(path, Cookie=cookie, Origin="http://evil.example") == 403
        status, headers, body = _load(served.port, report["address"], cookie)
        assert status == 200
        assert body == (session / "calibration" / "report.html").read_bytes()
        assert headers["Content-Type"].startswith("text/html")
        assert "sandbox allow-scripts; default-src 'none'" in headers["Content-Security-Policy"]
        assert headers["X-Frame-Options"] == "DENY"
        status, headers, body = _load(served.port, maps["address"], cookie)
        assert status == 200
        assert headers["Content-Disposition"] == "attachment"
        with ZipFile(io.BytesIO(body)) as archive:
            assert archive.testzip() is None
            assert sorted(archive.namelist()) == ["export/map_1m.npz", "export/rays.npz"]
            exported = (session / "export" / "map_1m.npz").read_bytes()
            assert archive.read("export/map_1m.npz") == exported
        key = report["address"].split("/")[2]
        for path in (
            "/files/other/report.html",
            f"/files/{key}/../../../session.yaml",
            f"/files/{key}/%2e%2e%2fsession.yaml/x",
            f"/files/{key}",
        ):
            assert _load(served.port, path, cookie)[0] == 404, path
        (session / "calibration" / "report.html").unlink()
        assert _load(served.port, report["address"], cookie)[0] == 404
        await page.hear(lambda: len(page.screen["files"]) == 1)


def _load(port: int, path: str, cookie: str) -> tuple[int, http.client.HTTPMessage, bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=600)
    try:
        connection.request("GET", path, headers={"Cookie": cookie})
        answer = connection.getresponse()
        return answer.status, answer.msg, answer.read()
    finally:
        connection.close()
