"""Pictures and maps beyond what cv2.remap takes at once, against what it makes of their parts."""

import cv2
import numpy as np
import pytest

from calib.undistortion import remap as module
from calib.undistortion.remap import MAX_SIDE, remap

BORDERS = cv2.BORDER_CONSTANT, cv2.BORDER_REPLICATE
KINDS = cv2.INTER_NEAREST, cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_LANCZOS4


def maps(scattered: bool) -> tuple[np.ndarray, np.ndarray]:
    """(90, 110) px of a picture of 400x300, in and around it."""
    rng = np.random.default_rng(1)
    if scattered:
        x, y = rng.uniform(-60, 460, (90, 110)), rng.uniform(-60, 360, (90, 110))
    else:
        x, y = np.meshgrid(np.linspace(-15, 415, 110), np.linspace(-15, 315, 90))
    # exact when shifted, and no ties
    sideways = (np.round(4 * x) / 4 + 0.125).astype(np.float32)
    downwards = (np.round(4 * y) / 4 + 0.125).astype(np.float32)
    return sideways, downwards


@pytest.mark.parametrize("scattered", [False, True])
@pytest.mark.parametrize("border", BORDERS)
@pytest.mark.parametrize("kind", KINDS)
def test_parts_join_to_the_whole(
    kind: int, border: int, scattered: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The limit is 50 px, and cv2.remap itself is the oracle.

    Beyond the border Lanczos' weights are rounded otherwise: 1 level.
    """
    source = np.random.default_rng(0).integers(0, 255, (300, 400, 3), dtype=np.uint8)
    x, y = maps(scattered)
    at_once = cv2.remap(source, x, y, kind, borderMode=border)
    monkeypatch.setattr(module, "MAX_SIDE", 50)
    monkeypatch.setattr(module, "TILE", 16)
    assert np.abs(np.int16(remap(source, x, y, kind, border)) - at_once).max() <= (
        kind == cv2.INTER_LANCZOS4
    )
    into = np.empty_like(at_once)
    assert remap(source, x, y, kind, border, into) is into
    assert np.abs(np.int16(into) - at_once).max() <= (kind == cv2.INTER_LANCZOS4)


def test_opencv_s_limit_has_its_stated_value() -> None:
    many = np.zeros((MAX_SIDE + 1, 1), np.float32)
    with pytest.raises(cv2.error, match="SHRT_MAX"):
        cv2.remap(np.zeros((2, 2), np.uint8), many, many, cv2.INTER_LINEAR)


@pytest.mark.parametrize("rows", [MAX_SIDE, MAX_SIDE + 1, 100_000])
def test_any_number_of_points_is_interpolated(rows: int) -> None:
    table = np.arange(12, dtype=np.float32).reshape(3, 4)  # linear in both: 4 y + x
    x, y = np.random.default_rng(2).uniform(0, 2, (2, rows, 1)).astype(np.float32)
    assert (
        np.abs(remap(table, x, y, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE) - (4 * y + x)).max() < 0.1
    )  # cv2 counts in 1/32 px


def test_a_picture_40000_px_wide() -> None:
    source = np.arange(40_000, dtype=np.float32)[None].repeat(3, 0)
    x, y = np.meshgrid(np.arange(39_990, -10, -1, dtype=np.float32), np.ones(1, np.float32))
    assert np.array_equal(
        remap(source, x, y, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE), np.maximum(x, 0)
    )
