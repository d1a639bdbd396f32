"""Import from mrcal: a .cameramodel with the optimization inputs that it was fitted from, or a file
of corners.

A .cameramodel is a Python literal. Its `optimization_inputs` are a .npz as base85 text, with the
observations of all cameras of the solve. observations_board is (N, rows, columns, 3): x, y and a
weight, which is 0 or negative for an outlier. indices_frame_camintrinsics_camextrinsics has the
frame and the camera of each of the N.
"""

import ast
import base64
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.corners.corners_file import read_corners
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError, brief
from calib.importing.session_draft import SessionDraft
from calib.io.arrays import decode_npz
from calib.io.camera_names import choose_camera
from calib.io.files import read_file
from calib.session.board import Board
from calib.session.camera import Camera

MAX_BYTES = 256 << 20
"""The file of a thousand views has ten million."""


def from_corners(
    path: Path, board: Board, size: tuple[int, int], camera: str | None = None
) -> SessionDraft:
    """Import corners that mrgingham or another detector wrote.

    Args:
        path: the corners file.
        board: the board.
        size: the pictures' width and height, px.
        camera: the camera of a pair to import, as the pictures' names say it.
    """
    try:
        views = {view.name: view for view in read_corners(path, board)}
        chosen = choose_camera(tuple(views), camera)
        return SessionDraft(path, board, Camera(*size), views=tuple(views[name] for name in chosen))
    except InputError as error:
        raise InputError(
            str(error).replace("correct board in session.yaml", "correct --board")
        ) from error


def from_cameramodel(path: Path, *, names_of_frames: bool = False) -> SessionDraft:
    """Import the observations of the model's own camera.

    Args:
        path: the file.
        names_of_frames: call each view after its frame of the solve, as all cameras do, and not
            after its picture.
    """
    model = read_cameramodel(path)
    if "optimization_inputs" not in model:
        raise InputError(
            f"{path} holds no optimization inputs, so no corners: give the file as"
            " mrcal-calibrate-cameras wrote it, or import the corners with"
            " `calib import mrcal-corners`."
        )
    try:
        arrays = _arrays(model["optimization_inputs"])
        return _draft(path, model, arrays, names_of_frames=names_of_frames)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{path}: its optimization inputs are damaged ({brief(error)}): write the file again"
            " with mrcal."
        ) from error


def read_cameramodel(path: Path) -> dict[str, Any]:
    """Return the content of a .cameramodel, a Python literal."""
    data = read_file(path, MAX_BYTES)
    try:
        model = ast.literal_eval(data.decode())
    except (ValueError, SyntaxError, MemoryError, RecursionError, TypeError):
        model = None
    if not isinstance(model, dict) or not {"lensmodel", "intrinsics", "imagersize"} <= set(model):
        raise InputError(f"{path} is not a .cameramodel: give a file that mrcal wrote.")
    return model


def _arrays(text: bytes) -> dict[str, NDArray[Any]]:
    return decode_npz(base64.b85decode(text))


def _draft(
    path: Path, model: dict[str, Any], arrays: dict[str, NDArray[Any]], *, names_of_frames: bool
) -> SessionDraft:
    camera = model["icam_intrinsics"]
    observations = np.asarray(arrays["observations_board"], np.float64)
    indices = arrays["indices_frame_camintrinsics_camextrinsics"]
    if (
        observations.ndim != 4
        or observations.shape[3] != 3
        or indices.shape != (len(observations), 3)
    ):
        raise ValueError(
            f"observations of shape {observations.shape} for indices of shape {indices.shape}"
        )
    selected = np.flatnonzero(indices[:, 1] == camera)
    width, height = map(int, model["imagersize"])
    board = Board(
        observations.shape[2], observations.shape[1], float(arrays["calibration_object_spacing"])
    )
    inliers = observations[selected][observations[selected, ..., 2] > 0]
    if not np.isfinite(inliers).all():
        raise ValueError("a corner that counts has no finite position")
    largest_weight = inliers[:, 2].max(initial=0.0)
    if largest_weight <= 0:
        raise NotEnoughDataError(
            f"{path} has no corner of its camera {camera} that counts: calibrate again with mrcal."
        )
    names = _names(selected, indices[:, 0], None if names_of_frames else arrays.get("imagepaths"))
    usable = (observations[selected, ..., 2] > 0).any((1, 2))
    views = tuple(
        _view(names[i], observations[i].reshape(-1, 3), largest_weight)
        for i in selected[usable].tolist()
    )
    return SessionDraft(
        path, board, Camera(width, height), views=views, remarks=_remarks(model, arrays)
    )


def _view(name: str, observations: NDArray[np.float64], largest_weight: float) -> View:
    weight = np.where(observations[:, 2] > 0, observations[:, 2], 0) / largest_weight
    return View(name, np.where(weight[:, None] > 0, observations[:, :2], np.nan), weight)


def _names(
    selected: NDArray[np.intp], frames: NDArray[Any], paths: NDArray[Any] | None
) -> dict[int, str]:
    """Return for each selected observation its picture's file name, or its frame's number if there
    is no name, or if two pictures would share it.
    """
    if paths is not None and paths.shape == frames.shape and paths.dtype.kind == "U":
        names = {
            i: "_".join(Path(str(paths[i])).name.split()).lstrip("#") for i in selected.tolist()
        }
        if all(names.values()) and len(set(names.values())) == len(names):
            return names
    return {i: f"frame{int(frames[i]):04d}" for i in selected.tolist()}


def _remarks(model: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> tuple[str, ...]:
    """Return lines for session.yaml: what mrcal estimated and a session does not state."""
    remarks = []
    if model["lensmodel"].startswith(("LENSMODEL_OPENCV", "LENSMODEL_PINHOLE")):
        fx, fy, cx, cy, *lens = map(float, model["intrinsics"])
        intrinsics = f"{{fx: {fx!r}, fy: {fy!r}, cx: {cx!r}, cy: {cy!r}, distortion: {lens}}}"
        remarks.append(f"mrcal's own {model['lensmodel']}, for camera.intrinsics: {intrinsics}")
    warp = arrays.get("calobject_warp")
    if warp is not None and warp.shape == (2,):
        remarks.append(
            f"mrcal found the board warped by {1000 * warp[0]:.2f} mm along x and"
            f" {1000 * warp[1]:.2f} mm along y."
        )
    return tuple(remarks)
