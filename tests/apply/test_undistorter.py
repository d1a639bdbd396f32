"""Pictures and points through a cover, against the rays themselves."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.errors import InputError
from fixtures.known import known, lens_alone
from fixtures.synthetic import scene

W, H = 410, 308


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    """The paper's camera with an eighth of its pixels, behind uneven glass."""
    return known(scene(1, views=1, grid=(8, 8), amplitude=3e-5), W, H)


def behind(undistorter: Undistorter, pixels: np.ndarray, depth: np.ndarray | float) -> np.ndarray:
    """(N, 3) m: what a bare pinhole camera of the undistorter's matrix sees at pixels and
    depths.
    """
    k = undistorter.camera_matrix
    tangents = (pixels - k[:2, 2]) / k[[0, 1], [0, 1]]
    return np.asarray(
        np.column_stack([tangents, np.ones(len(pixels))])
        * np.broadcast_to(depth, len(pixels))[:, None]
    )


def every(step: int) -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(0, W, step), np.arange(0, H, step)), -1).reshape(-1, 2)


@pytest.mark.parametrize("crop", [None, 0.0, 0.3, 1.0])
def test_undistorted_and_distorted_points_agree_with_the_rays(
    calibration: Calibration, crop: float | None
) -> None:
    undistorter = Undistorter(calibration, 0.5, crop=crop)
    pixels = np.random.default_rng(0).uniform([0, 0], [W - 1, H - 1], (500, 2))
    depth = np.random.default_rng(1).uniform(0.15, 3.0, 500)
    straight = undistorter.undistort_points(pixels, depth)
    assert np.abs(undistorter.project(behind(undistorter, straight, depth)) - pixels).max() < 0.005
    assert np.abs(undistorter.distort_points(straight, depth) - pixels).max() < 1e-5
    origins, directions = undistorter.rays(pixels)
    met = origins + directions * ((depth - origins[:, 2]) / directions[:, 2])[:, None]
    assert np.abs(met - behind(undistorter, straight, depth)).max() < 0.005 / 319.8 * 3.0


def test_points_that_the_camera_does_not_see_are_nan(calibration: Calibration) -> None:
    undistorter = Undistorter(calibration, 0.5)
    pixels = np.array([[200.0, 150.0], [-20.0, 150.0], [200.0, 150.0], [200.0, 150.0]])
    depth = np.array([0.5, 0.5, np.nan, 0.005])
    for points in (
        undistorter.undistort_points(pixels, depth),
        undistorter.distort_points(pixels, depth),
    ):
        assert np.isfinite(points).all(1).tolist() == [True, False, False, False]


def expected(undistorter: Undistorter, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coordinates of every fifth pixel of the picture and, by projecting, of the
    camera's pixels.
    """
    width, height = undistorter.size
    pixels = np.stack(np.meshgrid(np.arange(0, width, 5), np.arange(0, height, 5)), -1).reshape(
        -1, 2
    )
    return pixels, undistorter.project(
        behind(undistorter, pixels, depth[pixels[:, 1], pixels[:, 0]])
    )


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"crop": 0.0},
        {"crop": 1.0, "size": (300, 400)},
        {"camera_matrix": np.array([[500.0, 0, 120], [0, 450, 90], [0, 0, 1]]), "size": (320, 240)},
    ],
    ids=["own", "valid only", "all that is seen", "own matrix"],
)
@pytest.mark.parametrize("kind", ["one depth", "depth image"])
def test_every_pixel_shows_the_point_that_its_ray_meets(
    calibration: Calibration, options: dict[str, object], kind: str
) -> None:
    """Ramps: a picture of its own coordinates is a map, to the resolution of linear
    interpolation.
    """
    size: tuple[int, int] = options.get("size", (W, H))  # type: ignore[assignment]
    depth = np.full(size[::-1], 0.4, np.float32)
    if kind == "depth image":
        depth = np.random.default_rng(0).uniform(0.12, 4.0, size[::-1]).astype(np.float32)
        depth[::7], depth[:, ::9] = np.nan, 0
    undistorter = Undistorter(calibration, 0.4 if kind == "one depth" else depth, **options)  # type: ignore[arg-type]
    ramp_y, ramp_x = np.indices((H, W), np.float32) + 10
    shown = np.stack([undistorter.undistort(ramp) for ramp in (ramp_x, ramp_y)], -1) - 10
    pixels, camera_pixels = expected(undistorter, depth)
    column, row = pixels.T
    in_picture = (camera_pixels > 0).all(1) & (camera_pixels < [W - 1, H - 1]).all(1)
    valid = undistorter.valid[row, column]
    assert (valid | ~in_picture | ~(depth[row, column] > 0)).all(), (
        "a pixel that is seen counts as valid"
    )
    assert (shown[row, column][~valid] == -10).all(), "what is not valid is 0"
    tolerance = (
        0.01 if int(cv2.__version__[0]) >= 5 else 0.04
    )  # OpenCV 4 rounds to a 32nd of a pixel
    assert np.abs(shown[row, column] - camera_pixels)[in_picture & valid].max() < tolerance
    assert (in_picture & valid).sum() > 1000
    if options.get("crop") == 0.0:
        assert undistorter.valid[depth > 0].all()


def test_crop_one_shows_every_pixel_and_no_more(calibration: Calibration) -> None:
    undistorter = Undistorter(calibration, 0.5, crop=1.0)
    straight = undistorter.undistort_points(every(1).astype(np.float64))
    assert straight.min(0) == pytest.approx([0, 0], abs=0.05)
    assert straight.max(0) == pytest.approx([W - 1, H - 1], abs=0.05)


def test_crop_agrees_with_opencv_without_a_cover() -> None:
    """The matrices of a plain lens are those of cv2.getOptimalNewCameraMatrix, which looks at 9x9
    points.
    """
    lens = (-0.2, 0.05, 0.001, -0.001, 0.0)
    bare = lens_alone(scene(1, views=1), W, H, 300, 310, 200, 150, *lens)
    matrix = np.array([[300.0, 0, 200], [0, 310, 150], [0, 0, 1]])
    for alpha in (0.0, 0.4, 1.0):
        theirs, _ = cv2.getOptimalNewCameraMatrix(matrix, np.array(lens), (W, H), alpha)
        ours = Undistorter(bare, 1.0, crop=alpha).camera_matrix
        assert ours[:2] == pytest.approx(theirs[:2], rel=0.01, abs=0.5)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("interpolation", [cv2.INTER_LINEAR, cv2.INTER_CUBIC])
def test_a_stream_reuses_its_buffer(
    calibration: Calibration, kind: type, interpolation: int
) -> None:
    undistorter = Undistorter(calibration, 0.5, interpolation=interpolation)
    frame: np.ndarray = np.full((H, W, 3), 200, kind)
    buffer = np.full_like(frame, 77)
    straight = undistorter.undistort(frame, buffer)
    assert straight is buffer
    assert np.abs(straight[undistorter.valid] - 200.0).max() < 1e-3, (
        "the edge is not darkened by what lies beyond it"
    )
    assert (straight[~undistorter.valid] == 0).all()
    assert not undistorter.valid.all()


def test_maps_at_another_depth_keep_the_camera_matrix(calibration: Calibration) -> None:
    near = Undistorter(calibration, 0.3, crop=0.5)
    far = near.at(2.0)
    assert np.array_equal(near.camera_matrix, far.camera_matrix)
    assert far.depth == 2.0
    assert near.depth == 0.3
    image = near.at(np.full((H, W), 2.0, np.float32))
    both_valid = image.valid & far.valid
    assert both_valid.mean() > 0.9
    assert np.abs(np.asarray(image.maps[0], np.float64) - far.maps[0])[both_valid].max() < 0.01


def test_a_depth_image_nearer_than_near_is_unknown(calibration: Calibration) -> None:
    depth = np.full((H, W), 0.5, np.float32)
    depth[:, : W // 2] = 0.2
    undistorter = Undistorter(calibration, depth, near=0.3)
    assert not undistorter.valid[:, : W // 2].any()
    assert undistorter.valid[:, W // 2 :].mean() > 0.8


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (lambda c: Undistorter(c, 0.0), "write metres above 0"),
        (lambda c: Undistorter(c, np.ones((H, W)), near=np.inf), "near is not finite"),
        (lambda c: Undistorter(c, 0.5, crop=1.5), "is not from 0 to 1"),
        (lambda c: Undistorter(c, 0.5, crop=1.0, camera_matrix=np.eye(3)), "give one of them"),
        (lambda c: Undistorter(c, 0.5, camera_matrix=np.zeros((3, 3))), "camera matrix is not"),
        (lambda c: Undistorter(c, 0.5, size=(1, 5)), "2 px or more"),
        (lambda c: Undistorter(c, np.ones((5, 5))), "depth image is"),
        (lambda c: Undistorter(c, np.ones((H, W), np.uint16)), "depth image is"),
        (lambda c: Undistorter(c, 0.5).at(-1.0), "write metres above 0"),
        (
            lambda c: Undistorter(c, 0.5).undistort(np.zeros((5, 5), np.uint8)),
            "5x5 px where the calibration",
        ),
        (
            lambda c: Undistorter(c, 0.5).undistort(
                np.zeros((H, W), np.uint8), np.zeros((H, W, 3), np.uint8)
            ),
            "does not fit into",
        ),
        (
            lambda c: Undistorter(c, np.ones((H, W))).undistort_points(np.zeros((1, 2))),
            "say at which depth",
        ),
    ],
)
def test_wrong_input_is_one_sentence(
    calibration: Calibration, wrong: Callable[[Calibration], object], says: str
) -> None:
    with pytest.raises(InputError, match=says):
        wrong(calibration)


@pytest.mark.parametrize("size", [(2, 32_767), (40_000, 3)])
def test_a_picture_longer_than_opencv_s_limit_is_undistorted(
    calibration: Calibration, size: tuple[int, int]
) -> None:
    """The picture is a ramp over the camera's own columns: what is seen of it is where it was
    seen.
    """
    undistorter = Undistorter(calibration, 0.5, size=size, crop=0.5)
    ramp = np.arange(W, dtype=np.float32)[None].repeat(H, 0)
    straight = undistorter.undistort(ramp)
    assert straight.shape == size[::-1]
    assert undistorter.valid.any()
    assert (
        np.abs(straight - undistorter.maps[0])[undistorter.valid].max() < 0.05
    )  # cv2 counts in 1/32 px


def test_a_camera_wider_than_opencv_s_limit_is_undistorted() -> None:
    wide = lens_alone(scene(1, views=1), 40_000, 4, 3e4, 3e4, 2e4, 2.0)
    undistorter = Undistorter(wide, 0.5)
    ramp = np.arange(40_000, dtype=np.float32)[None].repeat(4, 0)
    assert np.abs(undistorter.undistort(ramp) - ramp).max() < 0.05


def test_a_picture_that_no_memory_holds_is_refused(calibration: Calibration) -> None:
    with pytest.raises(InputError, match="32767x32767 px is too large for memory"):
        Undistorter(calibration, 0.5, size=(32_767, 32_767))
