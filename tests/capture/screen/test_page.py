"""Who can open the page, and what a page can send."""

import http.client
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the extra `serve` is not installed")

from calib.errors import InputError
from capture.cli import main
from capture.screen.eye import ScreenSize
from capture.screen.page import PatternPage
from capture.screen.points_session import PointsSession
from tests.capture.recordings import noise, write_recording

PATHS = ("/", "/screen", "/page/screen.js", "/nothing")


def ask(address: str, path: str, **headers: str) -> int:
    connection = http.client.HTTPConnection(f"127.0.0.1:{urlsplit(address).port}", timeout=600)
    try:
        connection.request("GET", path, headers=headers)
        return connection.getresponse().status
    finally:
        connection.close()


def test_without_the_token_nothing_is_served() -> None:
    with PatternPage("0.0.0.0", 0) as page:
        query = urlsplit(page.address).query
        assert query.startswith("token=")
        for path in PATHS:
            assert ask(page.address, path) == 403
            assert ask(page.address, f"{path}?token=x") == 403
        assert ask(page.address, f"/?{query}") == 200
        assert ask(page.address, "/page/screen.js", Cookie=f"refracal-screen={query[6:]}") == 200
        assert ask(page.address, f"/?{query}", Origin="http://elsewhere.example") == 403


def test_a_loopback_address_is_served_under_its_own_name_alone() -> None:
    with PatternPage("127.0.0.1", 0) as page:
        assert "token" not in page.address
        assert ask(page.address, "/") == 200
        assert ask(page.address, "/", Host="elsewhere.example") == 403


@pytest.mark.parametrize(
    "screen",
    [
        None,
        {"width": 1920},
        {"width": 1e9, "height": 1080, "refresh_hz": 60},
        {"width": 10**9, "height": 1080, "refresh_hz": 60},
        {"width": 1920, "height": 1080, "refresh_hz": float("nan")},
        {"width": True, "height": 1080, "refresh_hz": 60},
    ],
)
def test_a_screen_that_cannot_be_is_none(screen: object) -> None:
    assert ScreenSize.of({"screen": screen}) is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--screen"], "add --serve"),
        (["--poses", "3"], "--poses belongs to --screen"),
        (["--screen", "--serve", "--poses", "0"], "not a number of poses"),
        (["--screen", "--serve", "--pitch-mm", "0.0001"], "no screen's"),
        (["--screen", "--serve", "--cover-from", "nothing.yaml"], "nothing.yaml"),
        (["--screen", "--serve", "--source", "folder:{recorded}"], "is a recording"),
    ],
)
def test_bad_input_is_one_sentence(
    tmp_path: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = write_recording(tmp_path / "recorded", noise(1))
    filled = [argument.format(recorded=recorded) for argument in arguments]
    try:
        code = main([str(tmp_path / "session"), *filled])
    except SystemExit as ended:
        code = int(str(ended.code))
    assert code == 2
    message = capsys.readouterr().err
    assert words in message
    assert "Traceback" not in message
    assert not (tmp_path / "session" / "session.yaml").exists()


def test_a_folder_with_other_points_is_refused(tmp_path: Path) -> None:
    (tmp_path / "points").mkdir()
    np.savez(tmp_path / "points" / "0000.npz", pixels=np.zeros((3, 2)))
    with pytest.raises(InputError, match="not a pose that this program wrote"):
        PointsSession(tmp_path).__enter__()
    (tmp_path / "session.yaml").write_text(
        "format: 1\nboard: {columns: 9, rows: 6, square_mm: 25}\n"
        "camera: {width: 80, height: 60}\ncover: {shape: none}\n"
    )
    with pytest.raises(InputError, match="describes a board"):
        PointsSession(tmp_path).__enter__()
