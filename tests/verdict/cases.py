"""The reasons that a single check gives for a calibration."""

from collections.abc import Callable, Iterable
from pathlib import Path

from calib.calibration import Calibration
from calib.fit_record.request import Settings
from calib.fitting.evaluate import Evaluation
from calib.verdict.case import Case
from calib.verdict.next_commands import NextCommands
from calib.verdict.verdict import Reason

SESSION = Path("my session")
DIAGNOSE = f"calib diagnose '{SESSION}/calibration'"


def asked(
    check: Callable[[Case], Iterable[Reason]],
    calibration: Calibration,
    depths: tuple[float, ...] = (),
    evaluation: Evaluation | None = None,
) -> list[Reason]:
    """The reasons that one check gives."""
    settings = calibration.request.settings or Settings()
    commands = NextCommands(SESSION, SESSION / "calibration", settings)
    return list(check(Case(calibration, depths, commands, evaluation, "other views")))
