"""A recorded folder: files of pictures of fringes, which a camera saw through glass."""

from pathlib import Path

import cv2
import pytest

from calib.fringes.decode import decode_fringes, screen_points
from capture.sources.registry import open_source
from fixtures.covered_screen import BINNING, PLAN, SCREEN, CoveredCamera, place_errors_of
from fixtures.point_sessions import screen_scene
from fixtures.synthetic import HEIGHT, WIDTH


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_recorded_folder_is_decoded(tmp_path: Path, suffix: str) -> None:
    """JPEG of quality 90, or PNG; noise of 2 grey levels, a blur of 1.5 px, gamma 2.2."""
    made = screen_scene(1, 1, 16, 10)
    camera = CoveredCamera(
        width=WIDTH // BINNING,
        height=HEIGHT // BINNING,
        jpeg=None,
        path=made.path,
        values=made.values,
        pose=made.poses[0],
    )
    for number, picture in enumerate(camera.photograph(SCREEN, PLAN.draw())):
        file = tmp_path / f"{number:04d}{suffix}"
        cv2.imwrite(str(file), picture, [cv2.IMWRITE_JPEG_QUALITY, 90])
    with open_source(f"folder:{tmp_path}") as source:
        frames = [frame.pixels for frame in source]
    points = screen_points(decode_fringes(frames, PLAN))
    errors = place_errors_of(made, 0, points)
    print(f"{len(points.pixels)} points, {errors.rms_px:.4f} px, {errors.deviation:.2f} sigma")
    assert len(points.pixels) > 300
    assert errors.rms_px < 0.02
    assert 0.8 < errors.deviation < 1.25
