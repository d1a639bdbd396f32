"""The report of a target whose points are on no plane: its scene, its charts and its figures."""

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the extra `serve`, which drives Chromium, is not installed")

from mpl_toolkits.mplot3d.art3d import Path3DCollection

from calib.calibration import Calibration
from calib.fitting.fit import fit
from calib.plots.space import space_figure
from calib.report.board_errors import board_errors
from calib.report.evidence import gather_evidence
from calib.report.residual_maps import residual_maps
from calib.report.scene import session_in_space
from calib.session.session import read_session
from fixtures.point_sessions import corner_of_planes, spatial_scene, write_point_session
from tests.capture.tui.browser import CHROMIUM
from tests.report.chrome import PLACE, RAYS, Page, open_chrome
from tests.report.made import SETTINGS, report_in

PLACES = corner_of_planes(6, 7, 0.03)


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    folder = tmp_path_factory.mktemp("space") / "s"
    return fit(
        read_session(write_point_session(folder, spatial_scene(3, 6, PLACES), 0.05)), SETTINGS
    )


def test_figures_show_points_in_space(calibration: Calibration) -> None:
    evidence = gather_evidence(calibration)
    box = session_in_space(evidence).data["box"]
    np.testing.assert_allclose(np.asarray(box), [PLACES.min(0), PLACES.max(0)])
    collections = space_figure(evidence).axes[0].collections
    counts = [len(c.get_offsets()) for c in collections if isinstance(c, Path3DCollection)]
    assert counts == [len(evidence.points)]
    assert "seen along its z axis" in residual_maps(evidence).caption
    assert "a plane through the point that faces the camera" in board_errors(evidence).caption


@pytest.mark.slow
@pytest.mark.skipif(not CHROMIUM, reason="Chromium is not installed")
def test_the_page_draws_points_in_space(
    calibration: Calibration, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """The scene has a box with points for every view, and the pointer shows the rays of a view."""
    page = report_in(tmp_path_factory.mktemp("report"), calibration).read_text()
    assert f"6 views of a target of {calibration.board.count} points in space" in page

    async def story(page: Page) -> bool:
        x, y, width, height = await page.call(PLACE.format(what=".scene canvas"))
        for step in np.linspace(0.3, 0.7, 9):
            await page.mouse("mouseMoved", x + step * width, y + 0.5 * height)
            if await page.call(f"{RAYS} > 0"):
                return True
        return False

    with open_chrome(tmp_path_factory.mktemp("profile")) as chrome:
        shows_rays, complaints, requests = chrome.read(page, tmp_path_factory.mktemp("page"), story)
    assert shows_rays
    assert not complaints
    assert not requests
