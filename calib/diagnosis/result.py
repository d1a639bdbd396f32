"""A calibration as a fit with effects leaves it."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.calibration import Calibration, Found, Stage
from calib.joint import JointFit
from calib.model import Model
from calib.observations import Observations
from calib.priors import with_estimates
from calib.residuals import residuals

STAGE = "cover+rbf+effects"


@dataclass(frozen=True, slots=True)
class Order:
    """When the views were taken."""

    times: tuple[float, ...]
    """One for each view: s, or its number."""
    from_file: bool
    """Whether frames.csv says so; otherwise the order of the files stands for it."""


def frame_order(calibration: Calibration) -> Order:
    """From the session's frames.csv, if it is where it was and has every view."""
    in_order = Order(tuple(float(index) for index in range(len(calibration.views))), from_file=False)
    session = calibration.settings.get("made_by", {}).get("session")
    if not session:
        return in_order
    try:
        with (Path(session) / "frames.csv").open(newline="", encoding="utf-8") as file:
            said = {Path(row["file"]).name: float(row["time_s"]) for row in csv.DictReader(file)}
        times = tuple(said[Path(view.name).name] for view in calibration.views)
    except (OSError, ValueError, KeyError, TypeError, csv.Error):
        return in_order
    return Order(times, from_file=True) if np.isfinite(times).all() and len(set(times)) > 1 else in_order


def with_fit(calibration: Calibration, model: Model, joint: JointFit, observations: Observations, order: Order) -> Calibration:
    """The calibration with another fit's numbers and effects."""
    assert calibration.camera.intrinsics
    intrinsics, cover = with_estimates(calibration.camera.intrinsics, calibration.cover, joint)
    effects = tuple(
        Found(e, {u.param.name: (joint.values[u.param.name].numpy(), joint.sigma_of(u.param.name).numpy()) for u in e.unknowns})
        for e in model.effects
    )
    missed = residuals(model.path, joint.values, observations, joint.poses)
    stages = tuple(stage for stage in calibration.stages if stage.name != STAGE)
    return replace(
        calibration,
        camera=replace(calibration.camera, intrinsics=intrinsics),
        cover=cover,
        amplitudes=joint.values["relief.amplitudes"].numpy() if calibration.relief else calibration.amplitudes,
        poses=joint.poses.numpy(),
        covariance=joint.covariance.numpy(),
        effects=effects,
        times=np.array(order.times) if effects else np.zeros(0),
        stages=(*stages, Stage(STAGE, missed.rms_px, missed.rmse_cm)) if effects else stages,
        settings=calibration.settings | joint.said(),
    )
