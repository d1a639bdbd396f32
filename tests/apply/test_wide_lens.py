"""A lens of 220 degrees measures points and locates tags in front of the camera, beside it and
behind it.
"""

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from calib.apply.map_uncertainty import frames_along, predicted_sigma, ray_errors
from calib.apply.measure import BoardPose, Measurer, UnmeasuredReason
from calib.apply.tag_pose import SQUARE
from calib.apply.tags import TagLocator
from calib.calibration import Calibration
from calib.fitting.fit import fit
from calib.fitting.fit_result import with_fit
from calib.inference.calibration_model import full_model
from calib.session.session import read_session
from calib.undistortion.grids import Array
from fixtures.wide import AngleLens

LENS = AngleLens(220)
DISTANCE = 0.5
"""m"""
NOISE = 0.1
"""px"""
SIDE = 0.2
"""m, of tags."""

each_angle = pytest.mark.parametrize("degrees", [20.0, 85.0, 90.0, 105.0])
"""From the axis."""


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """A fitted calibration without a covariance."""
    folder = tmp_path_factory.mktemp("wide") / "session"
    return fit(read_session(LENS.write_session(folder, LENS.views(1, 14), "fisheye")))


@pytest.fixture(scope="module")
def calibration(bare: Calibration) -> Calibration:
    """The same calibration with the covariance of its lens, as after a diagnosis."""
    model = full_model(bare)
    joint = model.fit(bare.observations, torch.from_numpy(bare.poses))
    return with_fit(bare, model, joint, bare.observations)


def direction(degrees: float) -> Array:
    """Return the (3,) unit direction to the right, this far from the axis."""
    angle = np.radians(degrees)
    return np.array([np.sin(angle), 0.0, np.cos(angle)])


def facing(degrees: float) -> Array:
    """Return the (6,) T_camera_board of a plane that faces the camera from this direction."""
    turn = frames_along(direction(degrees)[None])[0].T
    return np.concatenate([Rotation.from_matrix(turn).as_rotvec(), DISTANCE * direction(degrees)])


@each_angle
def test_a_point_on_a_plane_is_where_its_ray_goes(calibration: Calibration, degrees: float) -> None:
    """The sigma from the pixel's noise is the noise over px per radian, times the distance."""
    pixel = calibration.project(direction(degrees)[None])
    measured = Measurer(calibration, NOISE).on_planes(
        pixel, [BoardPose.exactly(facing(degrees))], [0]
    )
    assert measured.reasons == (UnmeasuredReason.MEASURED,)
    assert np.abs(measured.points[0] - DISTANCE * direction(degrees)).max() < 1e-9
    outwards = np.array([np.cos(np.radians(degrees)), 0.0, -np.sin(np.radians(degrees))])
    step = 0.01
    ends = calibration.project(np.array([direction(degrees + step), direction(degrees - step)]))
    per_radian = np.linalg.norm(ends[0] - ends[1]) / np.radians(2 * step)
    sigma = np.sqrt(outwards @ measured.noise[0] @ outwards)
    assert sigma == pytest.approx(NOISE / per_radian * DISTANCE, rel=1e-3)
    assert np.isfinite(measured.shared).all()


def test_a_plane_in_front_is_not_seen_behind(calibration: Calibration) -> None:
    pixels = calibration.project(np.array([direction(80.0), direction(100.0)]))
    measured = Measurer(calibration, NOISE).on_planes(pixels, [BoardPose.facing(1.0)], [0, 0])
    assert measured.reasons == (UnmeasuredReason.MEASURED, UnmeasuredReason.NO_POINT)


@each_angle
def test_two_views_meet_in_a_point(calibration: Calibration, degrees: float) -> None:
    """The board stands still, and the camera moves up by 0.2 m."""
    point, up = DISTANCE * direction(degrees), np.array([0.0, -0.2, 0.0])
    pixels = calibration.project(np.stack([point, point - up]))
    boards = [BoardPose.exactly(np.zeros(6)), BoardPose.exactly(np.array([0, 0, 0, *-up]))]
    measured = Measurer(calibration, NOISE).triangulate(pixels, boards, [0, 1], [0, 0])
    assert measured.reasons == (UnmeasuredReason.MEASURED,)
    assert np.abs(measured.points[0] - point).max() < 1e-9


@each_angle
def test_a_tag_is_located(bare: Calibration, degrees: float) -> None:
    """Exact corners give the pose. The covariance agrees with central differences by corners."""
    tilted = cv2.Rodrigues(np.array([0.5, -0.3, 0.2]))[0]
    turn = frames_along(direction(degrees)[None])[0].T @ tilted
    corners = bare.project(SIDE * SQUARE @ turn.T + DISTANCE * direction(degrees))
    locator = TagLocator(bare, "DICT_APRILTAG_36h11", SIDE, side_sigma=0.0)

    def pose(at: Array) -> tuple[Array, Array, Array]:
        (poses,) = locator.place(at[None], NOISE**2 * np.eye(8)[None])
        assert isinstance(poses, tuple)
        return poses[0].turn, poses[0].position, poses[0].noise

    rotation, position, covariance = pose(corners)
    assert np.abs(rotation - turn).max() < 1e-6
    assert np.abs(position - DISTANCE * direction(degrees)).max() < 1e-6
    step = 0.01
    columns = []
    for coordinate in range(8):
        offset = np.eye(8)[coordinate].reshape(4, 2) * step
        forward_turn, forward_position, _ = pose(corners + offset)
        backward_turn, backward_position, _ = pose(corners - offset)
        spin = Rotation.from_matrix(forward_turn @ backward_turn.T).as_rotvec()
        columns.append(np.concatenate([spin, forward_position - backward_position]) / (2 * step))
    by_corners = np.stack(columns, -1)
    expected = (NOISE**2 + 1e-8) * by_corners @ by_corners.T
    assert np.abs(covariance - expected).max() < 0.01 * np.abs(expected).max()


def test_maps_have_a_sigma_where_a_pinhole_sees(calibration: Calibration) -> None:
    field = predicted_sigma(calibration)
    assert field
    nodes = np.stack(np.meshgrid(field.nodes_x, field.nodes_y), -1).reshape(-1, 2)
    _, directions = calibration.rays(nodes)
    finite = np.isfinite(field.variance).all(-1).ravel()
    assert (finite == (directions[:, 2] > 1e-3)).all()


def test_errors_of_rays_turn_with_their_frames(calibration: Calibration) -> None:
    """An angle in a frame along the ray is the undistorted pixel's motion over its slope."""
    errors = ray_errors(calibration)
    degrees = 40.0
    pixel = calibration.project(direction(degrees)[None])
    in_frame = errors(pixel, frames_along(direction(degrees)[None]))[0]
    plain = errors(pixel)[0]
    assert plain.shape == in_frame.shape
    assert in_frame.size
    cosine = np.cos(np.radians(degrees))
    assert np.allclose(plain[0] * cosine**2, in_frame[0], rtol=1e-9, atol=0), "radial"
    assert np.allclose(plain[1] * cosine, in_frame[1], rtol=1e-9, atol=0), "tangential"


def test_errors_of_rays_are_known_behind_the_camera(calibration: Calibration) -> None:
    """The errors are as large as those in front of the camera, near a corner."""
    errors = ray_errors(calibration)
    sizes = []
    for degrees in (60.0, 100.0):
        ray = direction(degrees)[None]
        error = errors(calibration.project(ray), frames_along(ray))[0]
        assert np.isfinite(error).all()
        sizes.append(np.sqrt((error[:2] ** 2).sum()))
    assert 0.1 < sizes[1] / sizes[0] < 10
