"""The verdict on a calibration: a pure function over a tuple of checks.

A new check is a file of its own, and a line here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from calib.calibration import Calibration
from calib.fitting.evaluate import Evaluation
from calib.fitting.provenance import KEY
from calib.threads import single_thread
from calib.verdict.bare_pictures import bare_pictures
from calib.verdict.board_place import board_place
from calib.verdict.case import Case
from calib.verdict.confirmation import contradicted_numbers, unconfirmed_numbers
from calib.verdict.cover_stage import cover_stage, worse_than_none
from calib.verdict.coverage import coverage
from calib.verdict.declared_numbers import declared_numbers
from calib.verdict.depths import depths_asked_for, one_depth
from calib.verdict.ended import not_converged, not_finite
from calib.verdict.fleet_prior import fleet_prior
from calib.verdict.held_out import held_out, overfits
from calib.verdict.medium import medium
from calib.verdict.next_commands import NextCommands
from calib.verdict.orientation import orientation
from calib.verdict.other_medium import other_medium
from calib.verdict.principal_point import principal_point
from calib.verdict.residual import residual
from calib.verdict.sureness import too_few_views, unsure_focal_length, unsure_maps
from calib.verdict.unevenness import unevenness
from calib.verdict.unseen_row import rows_beyond, unseen_row
from calib.verdict.verdict import Reason, Verdict

Check = Callable[[Case], Iterable[Reason]]
CHECKS: tuple[Check, ...] = (
    principal_point,
    board_place,
    unseen_row,
    rows_beyond,
    bare_pictures,
    orientation,
    medium,
    not_converged,
    worse_than_none,
    contradicted_numbers,
    residual,
    cover_stage,
    fleet_prior,
    declared_numbers,
    unconfirmed_numbers,
    unevenness,
    overfits,
    held_out,
    coverage,
    one_depth,
    depths_asked_for,
    too_few_views,
    unsure_maps,
    unsure_focal_length,
)
"""In the order in which their reasons stand; of equally grave ones, the first says what to do next.

What explains others comes first.
"""


def judge(
    calibration: Calibration,
    *,
    depths: Sequence[float] = (),
    folder: Path | None = None,
    session: Path | None = None,
    evaluation: Evaluation | None = None,
    holdout: Path | None = None,
) -> Verdict:
    """Whether to trust a calibration, why not, and what to do next. It reads no files.

    Args:
        depths: m, for which maps are wanted.
        folder: where the calibration lies, for the commands; by default beside its session.
        session: what was fitted, for the commands; by default as the calibration's provenance has
            it.
        evaluation: how it did on other views, those of the session `holdout`.
    """
    session = session or Path(calibration.settings.get(KEY, {}).get("session", "SESSION"))
    commands = NextCommands(session, folder or session / "calibration", calibration.settings)
    case = Case(
        calibration, tuple(dict.fromkeys(depths)), commands, evaluation, str(holdout or "HOLDOUT")
    )
    with single_thread():
        if broken := tuple(not_finite(case)):  # then nothing else can be asked
            return Verdict(broken, commands.fit())
        if not calibration.views:
            return Verdict(
                tuple(other_medium(case)),
                commands.undistort(float(np.median(calibration.corners_at[:, 2]))),
            )
        reasons = tuple(reason for check in CHECKS for reason in check(case))
        depth = next(iter(case.depths), float(np.median(case.distance)))
        return Verdict(
            reasons,
            commands.export(depth),
            (commands.evaluate(), commands.diagnose(), commands.undistort(depth)),
        )
