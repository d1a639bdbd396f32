"""The two files of a calibration: calibration.yaml is for people, and calibration.npz in the same
folder holds the arrays. Together they are enough to fit again.
"""

import math
from dataclasses import asdict, replace
from os import PathLike
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration_content import AddedEffect, CalibrationContent, Declared, Stage
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View
from calib.effects.serialise import effect_from_yaml, effect_to_yaml
from calib.effects.varying import Varying
from calib.errors import InputError, NotEnoughDataError, brief, wrong_type
from calib.estimation.residuals import reach_board
from calib.fit_record.file_checks import (
    CALIBRATION,
    check_arrays,
    check_joint,
    check_stages,
    read_arrays,
    relief_from_yaml,
)
from calib.fit_record.outcome import Uncertainty
from calib.fit_record.record_file import record_from_yaml
from calib.io.arrays import decode_npz
from calib.io.file_set import find_current
from calib.io.files import npz, reading
from calib.io.images import session_pictures
from calib.io.result_names import CALIBRATION_ARRAYS, CALIBRATION_FILE, RIG_CALIBRATION_FILE
from calib.io.shell import shell_path
from calib.io.yaml_reader import is_opencv, read_yaml
from calib.optics.view_blocks import FLEX, POSE, VIEW_BLOCKS, block_columns
from calib.session.camera import camera_to_yaml
from calib.session.cover_section import cover_to_yaml
from calib.session.point_target import PointTarget
from calib.session.session import (
    fit_pictures_command,
    is_media,
    session_from_mapping,
    session_to_yaml,
)
from calib.threads import single_thread

FORMAT = 2
FILES = (CALIBRATION_FILE, CALIBRATION_ARRAYS)
YAML_SUFFIXES = (".yaml", ".yml")
DERIVED = ("rays.npz", "map_*m.npz", "report.html")
"""Files in a calibration's folder that are made from it."""
MAX_READS = 2
"""Attempts to read the two files. A writer may replace one of them between our two reads."""
SAMPLED_CORNERS = 12
"""Corners of each view whose rays are traced when a file is read; all corners of a thousand views
would take a second.
"""
BEND_TERMS_OF_DEGREE_2 = 3
MIN_LANDED_FRACTION = 0.5
"""Fraction of the sampled corners whose rays must reach the view's board. All corners of a fitted
view do, except outliers.
"""


def read_content(path: str | FilePath) -> CalibrationContent:
    """Read a calibration.yaml, or the one in a folder, with its calibration.npz.

    Raises:
        WrongTypeError: the argument is no path.
        InputError: a file is missing or damaged, or they do not belong together.
    """
    if not isinstance(path, str | PathLike):
        advice = "the path of a calibration's folder or calibration.yaml"
        raise wrong_type("path", path, advice)
    path = FilePath(path)
    with reading(path):
        if is_media(path):
            raise InputError(
                f"{path} is a picture or a video where a calibration is needed:"
                f" `{fit_pictures_command(path)}` makes one."
            )
        path = path / CALIBRATION_FILE if path.is_dir() else path
        document, arrays = _read_pair(path)
    try:
        return _content_of_files(document, arrays, path)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InputError(
            f"{path} is not a whole calibration ({brief(error)}): fit the session again."
        ) from error


def calibration_mapping(content: CalibrationContent, digest: str) -> dict[str, object]:
    """Return the content of calibration.yaml, for arrays with a SHA-256."""
    camera, declared = content.camera, content.declared
    relief = content.relief and {
        "low": list(content.relief.low),
        "high": list(content.relief.high),
        "grid": list(content.relief.grid),
        "beta": content.relief.beta,
        "exact_hit": content.exact_hit,
        "inset": content.relief.inset,
        **({"anchor": list(content.relief.anchor)} if content.relief.anchor else {}),
        **({"size": list(content.relief.size)} if content.relief.size else {}),
    }
    uncertainty = content.outcome.uncertainty
    return {
        "format": FORMAT,
        "refracal": content.refracal,
        "arrays_sha256": digest,
        **session_to_yaml(content.board, camera, content.cover),
        "declared": {
            "camera": camera_to_yaml(replace(camera, intrinsics=declared.intrinsics)),
            "cover": cover_to_yaml(declared.cover),
            "doubted": list(declared.doubted),
        },
        "relief": relief,
        "effects": [effect_to_yaml(added.effect, added.parameters) for added in content.effects],
        "gauge": content.gauge,
        **({} if uncertainty is None else {"uncertainty": asdict(uncertainty)}),
        "settings": content.record(),
        "noise_px": math.nan if content.noise_px is None else content.noise_px,
        "stages": [
            {"name": s.name, "rms_px": s.rms_px, "rmse_cm": s.rmse_cm} for s in content.stages
        ],
        "frames_rejected": [{"file": r.name, "reason": r.reason} for r in content.rejected],
    }


def array_bytes(content: CalibrationContent) -> memoryview:
    """Return the bytes of calibration.npz."""
    board, views = content.board, content.views
    arrays = {
        "amplitudes": content.amplitudes,
        "poses": content.poses,
        "covariance": content.covariance,
        "times_s": np.array(
            [math.nan if view.time_s is None else view.time_s for view in views],
            dtype=np.float64,
        ),
        "pose_ids": np.array([view.pose_id or "" for view in views], dtype=str),
        "names": np.array([view.name for view in views]),
        "corners": (np.array([view.corners for view in views]).reshape(-1, board.count, 2)),
        "weights": np.array([view.weight for view in views]).reshape(-1, board.count),
    }
    if any(view.blur is not None for view in views):
        unknown = np.full((board.count, 2), math.nan)
        arrays["blurs"] = np.array([unknown if view.blur is None else view.blur for view in views])
    if not board.has_grid:
        arrays["target"] = board.points()
        covariances = [view.covariance for view in views if view.covariance is not None]
        if len(covariances) == len(views):
            arrays["point_covariances"] = np.array(covariances).reshape(-1, board.count, 2, 2)
    if content.corners_at.size:
        arrays["corners_at"] = content.corners_at
    return npz(arrays, compressed=False)  # not compressed: the same bytes on every machine


def check_readable(document: dict[str, Any], arrays: memoryview) -> None:
    """Raise NotEnoughDataError if `read_content` would refuse the two files."""
    try:
        _content_of_files(document, decode_npz(bytes(arrays)), FilePath(CALIBRATION_FILE))
    except (InputError, ValueError) as error:
        raise NotEnoughDataError(
            "The views do not determine a number of the camera or cover, so that no calibration is"
            " written: take more views, tilted, near and far, or fit fewer numbers with --free"
            f" ({str(error).rstrip('.')})."
        ) from error


def _read_pair(path: FilePath) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the content of calibration.yaml, and the arrays of the .npz written with it."""
    for _ in range(MAX_READS):
        place = find_current(path)
        if not place.is_file():
            raise InputError(f"{path} does not exist: {_where_to_find(path)}.")
        if is_opencv(place):
            raise InputError(
                f"{path} is a file of OpenCV, of a camera without its cover:"
                f" `calib fit PICTURES --intrinsics {shell_path(path)}` takes its numbers."
            )
        if place.suffix.lower() not in YAML_SUFFIXES:
            raise InputError(
                f"{path} is not a calibration.yaml: give that file, or the folder that calib fit"
                " wrote."
            )
        document = read_yaml(place)
        if document.get("format") != FORMAT:
            version = brief(repr(document.get("format")))
            raise InputError(
                f"{path}: format is {version} where this version of calib reads {FORMAT}: fit the"
                " session again."
            )
        arrays, digest = read_arrays(find_current(path.with_suffix(".npz")))
        if document.get("arrays_sha256", digest) == digest:
            return document, arrays
    raise InputError(
        f"{path} and {path.with_suffix('.npz').name} do not belong together: fit the session again."
    )


def _where_to_find(path: FilePath) -> str:
    """Return advice for a calibration.yaml that does not exist."""
    folder = path.parent
    if (folder / "calibration" / path.name).is_file():
        return f"{folder} is a session; its calibration is {folder / 'calibration'}"
    if (folder / RIG_CALIBRATION_FILE).is_file():
        cameras = sorted(file.parent for file in folder.glob(f"*/{path.name}"))
        names = ", ".join(map(str, cameras))
        return (
            f"{folder} is a rig, for the commands of calib rig: name the calibration of one camera:"
            f" {names}"
        )
    if path.stem != "calibration":
        return "give the folder that calib fit wrote"
    if (folder / "session.yaml").is_file():
        return f"`calib fit {shell_path(folder)}` makes it"
    if session_pictures(folder):
        return f"`{fit_pictures_command(folder)}` makes one of these pictures"
    return "give the folder that calib fit wrote"


def _content_of_files(
    document: dict[str, Any], arrays: dict[str, NDArray[Any]], path: FilePath
) -> CalibrationContent:
    """Return the content of a calibration from its two files.

    Args:
        document: the mapping of calibration.yaml.
        arrays: those of calibration.npz.
        path: calibration.yaml, for messages.

    Raises:
        InputError: board, camera or cover is not described as in a session.yaml.
        LookupError, TypeError, ValueError: the files are not those of a calibration.
    """
    CALIBRATION(document, "")
    target: dict[str, object] = {
        key: document[key] for key in ("board", "target") if key in document
    }
    board, camera, cover = session_from_mapping(
        {**target, "camera": document["camera"], "cover": document["cover"]}, str(path)
    )
    if not board.has_grid:
        pitch = board.pitch if isinstance(board, PointTarget) else None
        board = PointTarget.of(arrays["target"], pitch)
    declared = _declared(document["declared"], target, path)
    if not camera.intrinsics:
        raise ValueError("camera.intrinsics is missing")
    relief = None if document["relief"] is None else relief_from_yaml(document["relief"])
    if relief and cover.shape == "none":
        raise ValueError("there is a relief and no cover")
    view_count = len(arrays["names"])
    effects = _effects(document, view_count)
    check_stages(
        [stage["name"] for stage in document["stages"]],
        has_cover=cover.shape != "none",
        has_views=view_count > 0,
    )
    request, outcome, history = record_from_yaml(document["settings"])
    if "uncertainty" in document:
        outcome = replace(outcome, uncertainty=Uncertainty(**document["uncertainty"]))
    check_joint(
        outcome.joint,
        has_covariance=arrays["covariance"].size > 0,
        has_relief=relief is not None,
    )
    view_blocks = {POSE, *(added.effect.per_view for added in effects)} - {""}
    arrays = arrays | {"poses": _with_all_bend_terms(arrays["poses"], view_blocks)}
    check_arrays(arrays, relief, board, sum(VIEW_BLOCKS[block] for block in view_blocks))
    content = CalibrationContent(
        board=board,
        camera=camera,
        cover=cover,
        relief=relief,
        amplitudes=arrays["amplitudes"],
        exact_hit=bool(document["relief"]["exact_hit"]) if relief else True,
        views=_views(arrays),
        poses=arrays["poses"],
        covariance=arrays["covariance"],
        rejected=tuple(
            RejectedPicture(r["file"], r["reason"]) for r in document["frames_rejected"]
        ),
        stages=tuple(
            Stage(s["name"], float(s["rms_px"]), float(s["rmse_cm"])) for s in document["stages"]
        ),
        noise_px=None if math.isnan(document["noise_px"]) else float(document["noise_px"]),
        gauge=document["gauge"],
        request=request,
        outcome=outcome,
        history=history,
        effects=effects,
        stated=declared,
        refracal=document["refracal"],
        corners_at=arrays.get("corners_at", np.zeros((0, 3))),
    )
    _check_covariance_size(content)
    _check_views(content)
    return content


def _effects(document: dict[str, Any], view_count: int) -> tuple[AddedEffect, ...]:
    """Return the effects of a calibration.

    Raises:
        ValueError: an effect varies over views, but not over these.
    """
    effects = tuple(AddedEffect(*effect_from_yaml(mapping)) for mapping in document["effects"])
    for added in effects:
        if isinstance(added.effect, Varying) and len(added.effect.pattern) != view_count:
            raise ValueError("an effect has a pattern that is not of these views")
    return effects


def _declared(declared: dict[str, Any], target: dict[str, object], path: FilePath) -> Declared:
    """Return what the session declared, from its section."""
    sections = {**target, "camera": declared["camera"], "cover": declared["cover"]}
    _, camera, cover = session_from_mapping(sections, f"{path}: declared")
    if camera.intrinsics is None:
        raise ValueError("camera.intrinsics is missing")
    return Declared(camera.intrinsics, cover, tuple(map(str, declared.get("doubted", ()))))


def _with_all_bend_terms(poses: NDArray[Any], view_blocks: set[str]) -> NDArray[Any]:
    """Return the (V, B) parameters of the views, padded to today's bend terms. Old files hold only
    the terms of degree 2: the missing ones become 0.
    """
    missing = sum(VIEW_BLOCKS[block] for block in view_blocks) - poses.shape[-1]
    if FLEX not in view_blocks or missing != VIEW_BLOCKS[FLEX] - BEND_TERMS_OF_DEGREE_2:
        return poses
    end = block_columns(view_blocks)[FLEX].start + BEND_TERMS_OF_DEGREE_2
    return np.insert(poses, [end] * missing, 0.0, axis=1)


def _views(arrays: dict[str, NDArray[Any]]) -> tuple[View, ...]:
    """Return the views of the arrays."""
    blurs = arrays.get("blurs", np.full((*arrays["weights"].shape, 2), math.nan))
    covariances = arrays.get("point_covariances", [None] * len(arrays["names"]))
    columns = (arrays[key] for key in ("names", "corners", "weights", "times_s", "pose_ids"))
    return tuple(
        View(
            str(name),
            corners,
            weight,
            None if math.isnan(time_s) else float(time_s),
            str(pose_id) or None,
            covariance=covariance,
            blur=blur if np.isfinite(blur).any() else None,
        )
        for name, corners, weight, time_s, pose_id, covariance, blur in zip(
            *columns, covariances, blurs, strict=True
        )
    )


def _check_covariance_size(content: CalibrationContent) -> None:
    """Raise ValueError if the covariance is not of the parameters that the fit estimated."""
    if not content.covariance.size:
        return
    count = content.camera_model().parameters.count
    if len(content.covariance) != count:
        raise ValueError(
            f"covariance is of {len(content.covariance)} parameters where {count} were estimated"
        )


def _check_views(content: CalibrationContent) -> None:
    """Raise ValueError if a view has corners or a pose that no fit could have: too few corners for
    a pose, corners outside the picture, or rays that do not reach the board.
    """
    camera, views = content.camera, content.views
    _, unusable = split_usable_views(views, content.board)
    if unusable:
        raise ValueError(f"{unusable[0].name}: {unusable[0].reason}")
    right_and_bottom = np.array([camera.width, camera.height]) - 0.5
    for view in views:
        corners = view.corners[view.seen]
        if ((corners < -0.5) | (corners > right_and_bottom)).any():
            raise ValueError(f"{view.name} has a corner outside the picture")
    if not views:
        return
    observations = content.observations
    index_in_view = torch.arange(len(observations.view)) - observations.starts[observations.view]
    spacing = (observations.starts.diff()[observations.view] // SAMPLED_CORNERS).clamp(min=1)
    sample = observations.select_rows(index_in_view % spacing == 0)
    path, values = content.model()
    with single_thread():
        reached = reach_board(path, values, sample, torch.from_numpy(content.poses))
    landed = torch.bincount(sample.view[reached], minlength=len(views))
    implausible = landed < MIN_LANDED_FRACTION * sample.starts.diff()
    if implausible.any():
        name = views[int(implausible.int().argmax())].name
        raise ValueError(f"the corners of {name} do not lie on a board at its pose")
