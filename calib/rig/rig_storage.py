"""The files of a calibrated rig. rig_calibration.yaml is for people and rig_calibration.npz holds
the arrays. Each camera's own calibration stands beside them, in a folder of the camera's name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from hashlib import sha256
from os import PathLike
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.calibration_file import DERIVED
from calib.errors import InputError, brief, wrong_type
from calib.fit_record.file_checks import read_arrays
from calib.io.file_set import FileSet, find_current
from calib.io.files import npz, reading
from calib.io.result_names import (
    CALIBRATION_ARRAYS,
    CALIBRATION_FILE,
    RIG_CALIBRATION_ARRAYS,
    RIG_CALIBRATION_FILE,
)
from calib.io.shell import shell_path
from calib.io.yaml_reader import read_yaml
from calib.rig.layout import RigLayout
from calib.rig.rig_content import FoundEffect, RejectedView, RigContent, RigRecord
from calib.rig.rig_geometry import rig_geometry, rig_models
from calib.session.schema import Number

FORMAT = 1


class RigFiles:
    """The files of a rig's result: those of the rig, and those of each camera in a folder of its
    name. They are written together: a reader refuses a rig whose cameras are of another fit.
    """

    def __init__(
        self,
        folder: FilePath,
        names: Sequence[str],
        *,
        overwrite: bool,
        inputs: Sequence[FilePath] = (),
        flag: str = "--overwrite",
    ) -> None:
        self.rig = FileSet(folder, overwrite=overwrite, inputs=inputs, flag=flag)
        self.cameras = {
            name: FileSet(folder / name, overwrite=overwrite, inputs=inputs, flag=flag)
            for name in names
        }
        self._stack = ExitStack()

    def __enter__(self) -> RigFiles:
        with ExitStack() as stack:
            for files in (self.rig, *self.cameras.values()):
                stack.enter_context(files)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        self._stack.close()

    def reserve(self, names: Sequence[str] = ()) -> None:
        """Check that the files may be written, and further ones of the rig's folder."""
        self.rig.reserve([RIG_CALIBRATION_FILE, RIG_CALIBRATION_ARRAYS, *names])
        for files in self.cameras.values():
            files.reserve([CALIBRATION_FILE, CALIBRATION_ARRAYS])

    def write(self, rig: RigContent) -> list[FilePath]:
        """Add the files of a rig, and return their future paths, the rig's own first."""
        self.rig.write(RIG_CALIBRATION_ARRAYS, rig_arrays(rig))
        text = yaml.safe_dump(rig_mapping(rig), sort_keys=False, allow_unicode=True, width=120)
        written = [self.rig.write(RIG_CALIBRATION_FILE, text)]
        written += [rig.calibrations[name].write(files) for name, files in self.cameras.items()]
        return written

    def commit(self) -> None:
        """Make the files the current ones."""
        for files in self.cameras.values():
            files.commit(instead_of=DERIVED)
        self.rig.commit(instead_of=("report.html",))


def read_rig_content(path: str | FilePath) -> RigContent:
    """Read a rig_calibration.yaml, or the one in a folder, with the calibrations beside it.

    Raises:
        WrongTypeError: the argument is no path.
        InputError: a file is missing or damaged, or they do not belong together.
    """
    if not isinstance(path, str | PathLike):
        raise wrong_type("path", path, f"the path of a rig's folder or {RIG_CALIBRATION_FILE}")
    file = FilePath(path)
    with reading(file):
        file = file / RIG_CALIBRATION_FILE if file.is_dir() else file
    if not find_current(file).is_file():
        raise InputError(f"{file} does not exist: give the folder that calib rig fit wrote.")
    document = read_yaml(find_current(file))
    if "together" in document:
        raise InputError(
            f"{file} describes a rig and is no calibration:"
            f" `calib rig fit {shell_path(file)}` makes one."
        )
    if document.get("format") != FORMAT:
        version = brief(repr(document.get("format")))
        raise InputError(
            f"{file}: format is {version} where this version of calib reads {FORMAT}: fit the"
            " rig again."
        )
    arrays, digest = read_arrays(find_current(file.with_suffix(".npz")))
    try:
        return _from_mapping(document, arrays, digest, file)
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"{file} is not a whole rig ({brief(error)}): fit the rig again."
        ) from error


def rig_arrays(rig: RigContent) -> memoryview:
    """Return the bytes of rig_calibration.npz."""
    return npz(
        {
            "mountings": rig.mountings,
            "covariance": rig.covariance,
            "placements": rig.placements,
            "placement_names": np.array(rig.placement_names, dtype=str),
            **{f"views_{name}": places for name, places in rig.of_views.items()},
        },
        compressed=False,
    )


def rig_mapping(rig: RigContent) -> dict[str, object]:
    """Return the content of rig_calibration.yaml."""
    geometry = rig_geometry(rig)
    cameras = {}
    for index, (name, calibration) in enumerate(rig.calibrations.items()):
        mounting = geometry.mounting(index)
        cameras[name] = {
            "calibration": f"{name}/{CALIBRATION_FILE}",
            "arrays_sha256": calibration.digest,
            "rms_px": calibration.stages[-1].rms_px,
            "rms_alone_px": rig.record.alone_px.get(name, calibration.stages[-1].rms_px),
            "views": len(calibration.views),
            "T_camera_reference": mounting.T_camera_reference.tolist(),
            "sigma": mounting.sigma.tolist(),
            "ray_sigma": mounting.ray_sigma.tolist(),
        }
    return {
        "format": FORMAT,
        "refracal": rig.refracal,
        "arrays_sha256": sha256(rig_arrays(rig)).hexdigest(),
        "reference": rig.reference,
        "shared_cover": dict(rig.covers),
        "shared_medium": dict(rig.media),
        "cameras": cameras,
        "baselines": [baseline.as_mapping() for baseline in geometry.baselines],
        "placements": len(rig.placements),
        "measured_baseline_m": _number(rig.record.baseline),
        "source": rig.record.source,
        "outcome": rig.record.outcome,
        "iterations": rig.record.iterations,
        "uncertainty": {
            "method": "placements",
            "placements": len(rig.placements),
            "inflation": rig.record.scatter,
        },
        "effects": [effect.as_mapping() for effect in rig.record.effects],
        "turned": {name: list(views) for name, views in rig.record.turned.items()},
        "frames_rejected": [
            {"camera": r.camera, "file": r.file, "reason": r.reason} for r in rig.record.rejected
        ],
    }


def _number(number: Number | None) -> dict[str, float] | None:
    return {"value": number.value, "sigma": number.sigma} if number else None


def _read_number(entry: Mapping[str, float] | None) -> Number | None:
    return Number(float(entry["value"]), float(entry["sigma"])) if entry else None


def _from_mapping(
    document: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], digest: str, file: FilePath
) -> RigContent:
    cameras = document["cameras"]
    calibrations = {
        name: Calibration.load(file.parent / entry["calibration"])
        for name, entry in cameras.items()
    }
    fits = all(c.digest == cameras[name]["arrays_sha256"] for name, c in calibrations.items())
    if document["arrays_sha256"] != digest or not fits:
        raise InputError(
            f"{file} and the files beside it do not belong together: fit the rig again."
        )
    if document["reference"] not in calibrations:
        raise ValueError("reference is none of the cameras")
    of_views = {name: arrays[f"views_{name}"].astype(np.int64) for name in calibrations}
    placements = arrays["placements"].astype(np.float64)
    for name, places in of_views.items():
        if (
            len(places) != len(calibrations[name].views)
            or not ((places >= 0) & (places < len(placements))).all()
        ):
            raise ValueError(f"the placements of {name} are not those of its views")
    mountings = arrays["mountings"].astype(np.float64)
    if mountings.shape != (len(calibrations), 6):
        raise ValueError("mountings is not of these cameras")
    covers = {str(name): str(first) for name, first in document["shared_cover"].items()}
    media = {str(name): str(first) for name, first in document.get("shared_medium", {}).items()}
    models = rig_models(calibrations, document["reference"], covers, mountings)
    layout = RigLayout.of(tuple(calibrations), models, document["reference"], covers, media)
    covariance = arrays["covariance"].astype(np.float64)
    if covariance.size and covariance.shape != (layout.count, layout.count):
        raise ValueError(f"covariance is not of {layout.count} numbers")
    return RigContent(
        calibrations=calibrations,
        reference=document["reference"],
        mountings=mountings,
        covariance=covariance,
        placements=placements,
        placement_names=tuple(map(str, arrays["placement_names"])),
        of_views=of_views,
        covers=covers,
        media=media,
        record=RigRecord(
            source=str(document["source"]),
            outcome=str(document["outcome"]),
            iterations=int(document["iterations"]),
            scatter=float(document["uncertainty"]["inflation"]),
            turned={name: tuple(map(str, views)) for name, views in document["turned"].items()},
            rejected=tuple(
                RejectedView(str(r["camera"]), str(r["file"]), str(r["reason"]))
                for r in document["frames_rejected"]
            ),
            alone_px={name: float(entry["rms_alone_px"]) for name, entry in cameras.items()},
            baseline=_read_number(document.get("measured_baseline_m")),
            effects=tuple(map(FoundEffect.of_mapping, document.get("effects", ()))),
        ),
        refracal=str(document["refracal"]),
    )
