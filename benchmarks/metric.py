"""The errors of a calibration in millimetres, beside OpenCV and mrcal on the same views: `python -m
benchmarks.metric`.

The rendered fixtures: calibrated from their 24 training views, tried on 10 held-out ones, whose
    boards were 0.25 to 1.6 m away. Every peer
gets the same detected corners, gives the rays of the held-out corners, and its boards' poses are
refitted to those rays.

- lines: how far the corners of each row and column lie from their straight line in the undistorted
  picture, over what the noise of
  the corners alone leaves (the detected corners minus the true ones, added to a true pinhole
  picture). Ours at the depth of each corner on its board; and of corners found again in the picture
  that was undistorted with the board's depth image.
- distances: between the same corner of the boards of every two held-out views, each measured where
  its ray meets its board, against
  the truth.
"""

import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.apply.measure import Measurer
from calib.apply.triangulate import intersect
from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.commands.console import Bars
from calib.corners.corners_file import write_corners
from calib.corners.detect import find_corners
from calib.corners.detect_all import detect
from calib.corners.view import View
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.io.images import read_grey
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.optics.relief import Relief
from calib.session.camera import Intrinsics
from calib.session.schema import Number
from calib.session.session import Session, read_session

Array = NDArray[np.float64]
FIXTURES = Path(__file__).parent.parent / "fixtures"
DEBIAN = "/usr/bin/python3"
SPLINED = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=10_Ny=8_fov_x_deg=75"
BAND = (0.3, 1.2)
"""m: the second column of distances counts boards whose centre is in it."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Views that were not trained on, with what the renderer knows."""

    session: Session
    views: tuple[View, ...]
    points: Array
    """(V, n, 3) m: the true corners in the camera frame, in the order of the views' own."""
    noise: Array
    """(V, n, 2) px: the detected corners minus the true ones."""

    @property
    def pixels(self) -> Array:
        """(V, n, 2)"""
        return np.stack([view.corners for view in self.views])


@dataclass(frozen=True, slots=True)
class Score:
    lines: float
    """RMS over what noise alone leaves."""
    all_mm: float
    band_mm: float
    median_mm: float
    """The median of all distances."""
    sigma_ratio: float | None = None
    """RMS of the errors over their predicted sigmas."""


def main() -> None:
    console = Console(width=130)
    with Bars() as bars, tempfile.TemporaryDirectory() as scratch:
        for name in ("clean", "bumps"):
            folder = Path(
                shutil.copytree(
                    FIXTURES / name,
                    Path(scratch, name),
                    ignore=shutil.ignore_patterns(".detections.json"),
                )
            )
            fitted = fit(read_session(folder), Settings(), bars)
            calibration = replace(
                fitted, board=replace(fitted.board, square_sigma=0.0)
            )  # the renderer's
            held_out_views = held_out(folder / "holdout")
            rows = {
                "ours": ours(calibration, held_out_views),
                "ours, in linear pictures": in_pictures(
                    calibration, held_out_views, cv2.INTER_LINEAR
                ),
                "ours, in cubic pictures": in_pictures(
                    calibration, held_out_views, cv2.INTER_CUBIC
                ),
            }
            rows["true glass"] = ours(true_glass(calibration, folder), held_out_views)
            rows["OpenCV, 8 coefficients"] = peer(opencv(calibration), calibration, held_out_views)
            if splined := mrcal(calibration, Path(scratch)):
                rows["mrcal splined 10x8"] = peer(splined, calibration, held_out_views)
            console.print(table(name, rows))
    print(
        f"OpenCV {cv2.__version__}"
        + (
            ""
            if splined
            else (
                "; mrcal is not installed: on Debian or Ubuntu, apt-get install mrcal"
                " python3-mrcal."
            )
        )
    )


def held_out(folder: Path) -> HeldOut:
    session = read_session(folder)
    views = detect(session.frames, session.board).views
    with np.load(folder / "truth.npz") as file:
        corners = file["corners"]
        turns = file["rotations"]
        shifts = file["translations"]
        board = file["board"]
    points = np.einsum("vij,nj->vni", turns, board) + shifts[:, None]
    noise = np.stack([view.corners for view in views]) - corners
    for i, view in enumerate(views):
        if np.abs(noise[i]).max() > 2:  # px: a board turned by 180 degrees looks the same
            points[i], noise[i] = points[i, ::-1], view.corners - corners[i, ::-1]
    assert np.abs(noise).max() < 2
    return HeldOut(session, views, points, noise)


def true_glass(calibration: Calibration, folder: Path) -> Calibration:
    with np.load(folder / "truth.npz") as file:
        amplitudes, centres = file["amplitudes"], file["centres"]
    session = read_session(folder)
    return replace(
        calibration,
        camera=session.camera,
        cover=session.cover,
        relief=Relief(tuple(centres.min(0)), tuple(centres.max(0)), amplitudes.shape),
        amplitudes=amplitudes,
        covariance=np.zeros((0, 0)),
    )


def ours(calibration: Calibration, views: HeldOut) -> Score:
    """Score calib.apply.measure, and points undistorted at the depth at which their rays meet the
    board.
    """
    measurer = Measurer(calibration)
    boards = [measurer.board_pose(view) for view in views.views]
    count = calibration.board.count
    measured = measurer.on_planes(
        views.pixels.reshape(-1, 2), boards, np.repeat(np.arange(len(boards)), count).tolist()
    )
    field = calibration.ray_field()
    straight = field.undistort_pixels(views.pixels.reshape(-1, 2), measured.points[:, 2]).reshape(
        views.pixels.shape
    )
    errors, sigmas = [], []
    for first, second in combinations(range(len(boards)), 2):
        for corner in range(0, count, 8):
            metres, sigma = measured.distance(first * count + corner, second * count + corner)
            errors.append(
                metres
                - float(np.linalg.norm(views.points[second, corner] - views.points[first, corner]))
            )
            sigmas.append(sigma)
    ratio = (
        float(np.sqrt(np.mean((np.array(errors) / sigmas) ** 2)))
        if calibration.covariance.size
        else None
    )
    return Score(
        bend(straight) / floor(calibration, views),
        *distances(measured.points.reshape(views.points.shape), views),
        ratio,
    )


def in_pictures(calibration: Calibration, views: HeldOut, interpolation: int) -> Score:
    """Lines only: each picture is undistorted with the depth image of its board's plane, and its
    corners are found once more.
    """
    measurer, camera = Measurer(calibration), calibration.camera
    sideways, downwards = np.meshgrid(
        np.arange(camera.width, dtype=np.float64), np.arange(camera.height, dtype=np.float64)
    )
    undistorter, straight = None, []
    for frame, view in zip(views.session.frames, views.views, strict=True):
        pose = measurer.board_pose(view).pose
        normal = cv2.Rodrigues(pose[:3])[0][:, 2]
        k = (
            Undistorter(calibration, 1.0).camera_matrix
            if undistorter is None
            else undistorter.camera_matrix
        )
        towards = (
            normal[0] * (sideways - k[0, 2]) / k[0, 0]
            + normal[1] * (downwards - k[1, 2]) / k[1, 1]
            + normal[2]
        )
        depth = (normal @ pose[3:]) / np.where(np.abs(towards) < 1e-9, np.nan, towards)
        undistorter = (
            undistorter.at(depth)
            if undistorter
            else Undistorter(calibration, depth, interpolation=interpolation)
        )
        detection = find_corners(undistorter.undistort(read_grey(frame)), calibration.board)
        assert detection, f"no board in the undistorted {frame.name}"
        straight.append(detection.corners)
    return Score(bend(np.stack(straight)) / floor(calibration, views), np.nan, np.nan, np.nan)


def peer(rays: Callable[[Array], Array], calibration: Calibration, views: HeldOut) -> Score:
    """A central model: (N, 2) px to (N, 2) tangents."""
    tangents = np.stack([rays(pixels) for pixels in views.pixels])
    board = np.column_stack([calibration.board.points(), np.zeros(calibration.board.count)])
    points = []
    for subset in tangents:
        _, turn, shift = cv2.solvePnP(board, subset, np.eye(3), None, flags=cv2.SOLVEPNP_IPPE)
        turn, shift = cv2.solvePnPRefineLM(board, subset, np.eye(3), None, turn, shift)
        pose = np.concatenate([np.ravel(turn), np.ravel(shift)])
        directions = np.column_stack([subset, np.ones(len(subset))])
        points.append(
            intersect(np.zeros_like(directions), directions, np.tile(pose, (len(subset), 1)))
        )
    return Score(
        bend(tangents * focal(calibration)) / floor(calibration, views),
        *distances(np.stack(points), views),
    )


def opencv(calibration: Calibration) -> Callable[[Array], Array]:
    board = np.column_stack([calibration.board.points(), np.zeros(calibration.board.count)]).astype(
        np.float32
    )
    corners = [view.corners.astype(np.float32)[:, None] for view in calibration.views]
    size = calibration.camera.width, calibration.camera.height
    _, matrix, lens, *_ = cv2.calibrateCamera(
        [board] * len(corners), corners, size, None, None, flags=cv2.CALIB_RATIONAL_MODEL
    )
    fx = Number(float(matrix[0, 0]))
    fy = Number(float(matrix[1, 1]))
    cx = Number(float(matrix[0, 2]))
    cy = Number(float(matrix[1, 2]))
    path, values = pinhole_path(
        Intrinsics(fx, fy, cx, cy, tuple(Number(float(k)) for k in np.ravel(lens)[:8]))
    )

    def rays(pixels: Array) -> Array:
        """OpenCV's own inversion stops after a few steps; this one goes on."""
        directions = (
            path.trace(torch.from_numpy(pixels), values, MIDDLE).direction.stacked().numpy()
        )
        return np.asarray(directions[:, :2] / directions[:, 2:])

    return rays


def mrcal(calibration: Calibration, scratch: Path) -> Callable[[Array], Array] | None:
    command = shutil.which("mrcal-calibrate-cameras")
    if not command:
        return None
    folder = Path(tempfile.mkdtemp(dir=scratch))
    views = [
        replace(view, name=f"view{i:04d}.png", covariance=None)
        for i, view in enumerate(calibration.views)
    ]
    write_corners(folder / "corners.vnl", views)
    board, camera = calibration.board, calibration.camera
    options: dict[str, list[object]] = {
        "--corners-cache": [folder / "corners.vnl"],
        "--lensmodel": [SPLINED],
        "--focal": [focal(calibration)],
        "--imagersize": [camera.width, camera.height],
        "--object-spacing": [board.square],
        "--object-width-n": [board.columns],
        "--object-height-n": [board.rows],
        "--outdir": [folder],
    }
    words = [str(word) for name, values in options.items() for word in [name, *values]]
    subprocess.run([command, *words, "view*.png"], check=True, capture_output=True)
    code = (
        "import mrcal, numpy, sys; f = sys.argv[1]; m = mrcal.cameramodel(f +"
        " '/camera-0.cameramodel'); "
    )
    code += (
        "v = mrcal.unproject(numpy.load(f + '/pixels.npy'), *m.intrinsics()); numpy.save(f +"
        " '/rays.npy', v[:, :2] / v[:, 2:])"
    )

    def rays(pixels: Array) -> Array:
        np.save(folder / "pixels.npy", pixels)
        subprocess.run([DEBIAN, "-c", code, str(folder)], check=True, capture_output=True)
        return np.asarray(np.load(folder / "rays.npy"), dtype=np.float64)

    return rays


def bend(pixels: Array) -> float:
    """RMS px of (V, n, 2) corners of 9x9 boards across the straight lines through their rows and
    columns.
    """
    lattice = pixels.reshape(len(pixels), 9, 9, 2)
    lines = np.concatenate([lattice, lattice.swapaxes(1, 2)]).reshape(-1, 9, 2)
    spreads = np.linalg.svd(lines - lines.mean(1, keepdims=True), compute_uv=False)[:, 1]
    return float(np.sqrt((spreads**2).mean() / 9))


def floor(calibration: Calibration, views: HeldOut) -> float:
    return bend(focal(calibration) * views.points[..., :2] / views.points[..., 2:] + views.noise)


def distances(points: Array, views: HeldOut) -> tuple[float, float, float]:
    """RMS mm of all and of those in BAND, and the median of all."""
    pairs = list(combinations(range(len(points)), 2))
    separation = np.stack([np.linalg.norm(points[i] - points[j], axis=-1) for i, j in pairs])
    true = np.stack([np.linalg.norm(views.points[i] - views.points[j], axis=-1) for i, j in pairs])
    error = 1e3 * (separation - true)
    depth = views.points.mean(1)[:, 2]
    in_band = [all(BAND[0] <= depth[i] <= BAND[1] for i in pair) for pair in pairs]
    return (
        float(np.sqrt((error**2).mean())),
        float(np.sqrt((error[in_band] ** 2).mean())),
        float(np.median(np.abs(error))),
    )


def focal(calibration: Calibration) -> float:
    assert calibration.camera.intrinsics
    return calibration.camera.intrinsics.fx.value


def table(name: str, rows: dict[str, Score]) -> Table:
    heads = (
        "lines, over noise",
        "distances 0.25-1.6 m, mm RMS",
        f"{BAND[0]:g}-{BAND[1]:g} m",
        "median",
        "error over sigma, RMS",
    )
    made = Table(name, *heads)
    for row, score in rows.items():
        figures = (score.all_mm, score.band_mm, score.median_mm, score.sigma_ratio)
        made.add_row(
            row,
            f"{score.lines:.2f}",
            *("" if n is None or np.isnan(n) else f"{n:.3f}" for n in figures),
        )
    return made


if __name__ == "__main__":
    main()
