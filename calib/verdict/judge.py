"""The verdict on a calibration: a pure function over a tuple of checks.

A new check is a function from a Case to reasons, and a line here.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.calibration import Calibration, CalibrationSource
from calib.errors import RefracalError, brief
from calib.fitting.evaluate import Evaluation
from calib.io.numerals import counted
from calib.io.result_names import DIAGNOSED
from calib.threads import single_thread
from calib.undistortion.crop import has_black_border
from calib.verdict.bare_pictures import bare_pictures, rival_lens
from calib.verdict.board_place import board_place, board_size, cover_size, small_board
from calib.verdict.case import Case
from calib.verdict.confirmation import contradicted_numbers, unconfirmed_numbers
from calib.verdict.convergence import not_converged, not_finite
from calib.verdict.cover_stage import cover_stage, worse_than_none
from calib.verdict.coverage import coverage
from calib.verdict.declared_numbers import declared_numbers
from calib.verdict.depths import one_depth, requested_depths
from calib.verdict.differing_views import differing_views, settled_notes
from calib.verdict.fleet_prior import fleet_prior
from calib.verdict.held_out import held_out, overfits
from calib.verdict.medium import implausible_indices, medium, undecided_medium
from calib.verdict.mixed_settings import misfits, mixed_settings
from calib.verdict.next_commands import HOLDOUT, NextCommands
from calib.verdict.orientation import orientation
from calib.verdict.other_medium import other_medium
from calib.verdict.picture_source import PictureSource
from calib.verdict.principal_point import principal_point
from calib.verdict.residual import residual
from calib.verdict.scatter import scatter
from calib.verdict.square_pixels import square_pixels
from calib.verdict.uncertainty import too_few_views, uncertain_focal_length, uncertain_maps
from calib.verdict.unevenness import unevenness
from calib.verdict.unknown_numbers import unknown_numbers, unknown_shape
from calib.verdict.unseen_row import extra_rows, unseen_row
from calib.verdict.verdict import Reason, Verdict

Check = Callable[[Case], Iterable[Reason]]
CHECKS: tuple[Check, ...] = (
    principal_point,
    board_place,
    board_size,
    cover_size,
    unseen_row,
    extra_rows,
    mixed_settings,
    misfits,
    bare_pictures,
    orientation,
    implausible_indices,
    medium,
    not_converged,
    worse_than_none,
    contradicted_numbers,
    differing_views,
    residual,
    scatter,
    cover_stage,
    fleet_prior,
    declared_numbers,
    unknown_shape,
    unknown_numbers,
    unconfirmed_numbers,
    square_pixels,
    unevenness,
    overfits,
    held_out,
    coverage,
    one_depth,
    requested_depths,
    too_few_views,
    uncertain_maps,
    uncertain_focal_length,
)
"""The checks in the order of their reasons. Of equally grave reasons, the first gives the next
command, so reasons that explain others come first.
"""


def judge(
    calibration: CalibrationSource,
    *,
    depths: Sequence[float] = (),
    folder: Path | None = None,
    session: Path | None = None,
    evaluation: Evaluation | None = None,
    holdout: Path | None = None,
    in_form: bool = False,
) -> Verdict:
    """Judge whether to trust a calibration, why not, and what to do next. No file is read, but
    for a calibration that is given by its path.

    Args:
        depths: m, of the requested maps.
        folder: the calibration's folder in the commands; by default that beside its session.
        session: the fitted session in the commands; by default that of the calibration's
            provenance, or the folder around the calibration's if they were moved together.
        evaluation: the errors on views of the session `holdout`.
        in_form: true if the sentences tell what to change in the form of `capture`, in place of
            session.yaml and options.
    """
    calibration = Calibration.of(calibration)
    depths = tuple(dict.fromkeys(depths))
    commands = replace(NextCommands.of(calibration, folder, session, depths), in_form=in_form)
    if holdout and commands.held_out and holdout.resolve() == commands.held_out.resolve():
        commands = replace(commands, evaluated=True)  # `evaluate` then asks for others
    case = Case(calibration, depths, commands, evaluation, str(holdout or HOLDOUT))
    with single_thread():
        if broken := tuple(not_finite(case)):  # then no other check is possible
            return Verdict(broken, commands.fit())
        has_views = bool(calibration.views)
        depth = case.main_depth if has_views else _median_depth(calibration)
        has_border = has_black_border(calibration.ray_field(), depth)
        commands = replace(commands, black_border=has_border)
        case = replace(case, next=commands)
        if not has_views:
            return Verdict(tuple(other_medium(case)), commands.undistort(depth))
        reasons = _reasons(case)
        if Verdict(reasons, "").next.startswith("calib diagnose "):  # use what it writes
            commands = replace(commands, folder=commands.folder / DIAGNOSED, diagnosable=False)
        diagnosis = calibration.history.diagnosis
        asks_diagnosis = commands.diagnosable and diagnosis is None
        proof = (commands.evaluate(), *([commands.diagnose()] if asks_diagnosis else []))
        settled = tuple(settled_notes(calibration))
        if settled:  # the maps are wrong for a part of the session's pictures
            commands = replace(commands, pictures=None)
        uses = commands.uses(case.main_depth, mapped=case.main_depth in case.depths)
        families = [family.note for family in diagnosis.families] if diagnosis else []
        doubts = (*settled, *undecided_medium(case), *rival_lens(case), *small_board(case))
        notes = (*families, *doubts, *_film_note(case))
        is_tested = calibration.outcome.cross_validation is not None
        return Verdict(reasons, (*uses, *proof)[0], (*proof, *uses), notes, is_tested)


def _median_depth(calibration: Calibration) -> float:
    """Return the median depth of the corners of a calibration without views, m."""
    return float(f"{np.median(calibration.corners_at[:, 2]):.2g}")


def _film_note(case: Case) -> Iterator[str]:
    """Yield a note on the frames of the video that the pictures were taken from, if it is one."""
    if case.next.source is not PictureSource.FILM:
        return
    names = [view.name for view in case.calibration.views]
    frames = sorted([*names, *(picture.name for picture in case.calibration.rejected)])
    yield (
        f"the pictures are {counted(len(frames), 'frame')} of a video, each the sharpest of its"
        f" part of it, and are named by their numbers in it, from {frames[0]} to {frames[-1]}."
        f" The fit uses {len(names)} of them."
    )


def _reasons(case: Case) -> tuple[Reason, ...]:
    """Return the reasons of all checks, the gravest first. A check that fails by a bug is itself a
    reason, so that a calibration keeps its report and the other checks.
    """
    reasons: list[Reason] = []
    bugs: dict[str, Reason] = {}
    for check in CHECKS:
        try:
            reasons += check(case)
        except RefracalError:
            raise
        except Exception as error:
            if "REFRACAL_TRACEBACK" in os.environ:
                raise
            bug = f"{type(error).__name__}: {brief(error)}"
            sentence = (
                f"a check of this verdict failed, which is a bug in calib ({bug}): run the command"
                " again with REFRACAL_TRACEBACK=1 and report what it prints."
            )
            bugs.setdefault(bug, Reason(sentence, case.next.report()))
    reasons.sort(key=lambda reason: (-reason.word.gravity, reason.maps_hold))
    return (*reasons, *bugs.values())
