"""The description of an accepted effect: declared numbers with their increments, and the
parameters of the effect itself.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.diagnosis.finding import ParameterEstimate
from calib.effects.board_flex import BoardFlex
from calib.effects.effect import Effect
from calib.effects.rolling_shutter import RollingShutter
from calib.effects.varying import FROM_VIEW, Varying
from calib.fit_record.history import AcceptedEffect, EffectEstimate
from calib.fitting.declared import comparisons, effect_comparisons
from calib.inference.fitted_model import ModelFit
from calib.inference.varying_numbers import first_after_step
from calib.optics.board_polynomials import term_name
from calib.optics.flex_bend import FLEX_TERMS
from calib.optics.params import Param
from calib.optics.view_blocks import CENTRE, FLEX, FOCAL, MOTION, block_columns

NUMBERS_OF_VIEW = {
    FOCAL: (Param("focal", "", 1e-3),),
    CENTRE: (Param("cx", "px", 1.0), Param("cy", "px", 1.0)),
    FLEX: tuple(Param(term_name(term), "m", 1e-3) for term in FLEX_TERMS),
    MOTION: (
        *(Param(f"turn.{axis}", "rad", 1e-3) for axis in "xyz"),
        *(Param(f"move.{axis}", "m", 1e-3) for axis in "xyz"),
    ),
}
"""The numbers in each block of a view's own parameters."""


LARGE = 4.0
"""A view stands out if it has more than so many times its even part of the squares. Where
each of thirty views has six normal numbers, the largest has 2.5 times, and in one of a hundred
sessions a view has 4.
"""
LARGEST_VIEWS = 3
"""The largest number of views that are named."""


def spread_of(effect: Effect, fit: ModelFit) -> dict[str, ParameterEstimate]:
    """Return the root mean square over views of the deviations of numbers that differ, with its
    standard deviation; for numbers of single views, that of so many normal ones.
    """
    model, joint = fit.model, fit.joint
    if effect.per_view:
        columns = block_columns(model.path.view_blocks)[effect.per_view]
        sizes = (joint.poses[:, columns].numpy() ** 2).mean(0) ** 0.5
        certainty = (2 * len(joint.poses)) ** 0.5
        return {
            param.name: ParameterEstimate(float(size), float(size / certainty), param.unit)
            for param, size in zip(NUMBERS_OF_VIEW[effect.per_view], sizes, strict=True)
        }
    if not isinstance(effect, Varying):
        return {}
    scatter = float(np.std(effect.pattern))
    return {
        number: ParameterEstimate(
            scatter * abs(float(joint.values[unknown.param.name])),
            scatter * float(joint.sigma_of(unknown.param.name)),
            unknown.param.unit,
        )
        for number, unknown in zip(effect.numbers, effect.effect_parameters, strict=True)
    }


def first_changed(effect: Effect, names: Sequence[str]) -> str | None:
    """Return the name of the first view after a change at one view; None for another effect."""
    if not isinstance(effect, Varying) or effect.varies != FROM_VIEW:
        return None
    return names[first_after_step(effect.pattern)]


def describe_estimates(accepted: AcceptedEffect, calibration: Calibration) -> list[str]:
    """Return a text for each number; for parameters of single views, their root mean square.

    Args:
        accepted: an effect with the estimates of the diagnosis; for a field, its root mean square.
        calibration: the calibration with the effect.
    """
    effect = accepted.name
    if accepted.varies and effect not in (BoardFlex.name, RollingShutter.name):
        start = f", from {accepted.from_file} on" if accepted.from_file else ""
        return [
            f"{name} differs by {_as_text(size)} (root mean square over views{start})"
            for name, size in accepted.spread.items()
        ]
    texts = [number.summed for number in comparisons(calibration) if number.effect == effect]
    for number in effect_comparisons(calibration):
        if number.effect == effect:
            texts.append(f"{number.name} {number.estimated}")
    for name, estimate in accepted.parameters.items():
        if name.endswith(".rms"):
            texts.append(f"{name} {_as_text(estimate)}")
    for added in calibration.effects:
        if added.effect.name == effect and added.effect.per_view:
            texts += _describe_view_parameters(added.effect.per_view, calibration)
    return texts


def _as_text(estimate: EffectEstimate) -> str:
    return str(ParameterEstimate(estimate.value, estimate.sigma, estimate.unit))


def _describe_view_parameters(block: str, calibration: Calibration) -> list[str]:
    """Return the root mean square of the views' own parameters, and the views of most of it."""
    path, _ = calibration.model()
    values = calibration.poses[:, block_columns(path.view_blocks)[block]]
    names = [view.name for view in calibration.views]
    if block == FLEX:
        largest = largest_views(names, values)
        return [
            f"boards bend by {1e3 * _rms(values):.2g} mm (root mean square over views and"
            f" terms){largest}"
        ]
    shutter = calibration.camera.shutter
    seconds = 1.0
    unit = "readout"
    if shutter and shutter.readout:
        seconds = shutter.readout
        unit = "second"
    rotation = np.degrees(_rms(values[:, :3])) / seconds
    translation = 1e3 * _rms(values[:, 3:]) / seconds
    points = calibration.board.points()
    radius = float(np.std(points, axis=0).max())
    largest = largest_views(names, values * np.repeat([radius, 1.0], 3))
    return [
        f"boards turn by {rotation:.2g} degrees and move by {translation:.2g} mm in a {unit} (root"
        f" mean square over views){largest}"
    ]


def largest_views(names: Sequence[str], sizes: NDArray[np.float64]) -> str:
    """Return words for the views whose own numbers are far larger than those of the rest, with
    their parts of the sum of squares: ", most in 0046.png (41 %)". Empty if there are none.

    Args:
        names: the files of the views.
        sizes: (V, k) the numbers of each view, in one unit.
    """
    squares = (sizes**2).sum(1)
    parts = squares / max(float(squares.sum()), np.finfo(np.float64).tiny)
    order = np.argsort(-parts, kind="stable")[:LARGEST_VIEWS]
    texts = [f"{names[i]} ({100 * parts[i]:.0f} %)" for i in order if parts[i] > LARGE / len(names)]
    return f", most in {', '.join(texts)}" if texts else ""


def _rms(vectors: NDArray[np.float64]) -> float:
    """Return the root mean square length of (V, k) vectors."""
    return float(np.sqrt((vectors**2).sum(1).mean()))
