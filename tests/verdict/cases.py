"""The reasons that a single check gives for a calibration."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from calib.calibration import Calibration
from calib.fit_record.request import Settings
from calib.fitting.evaluate import Evaluation
from calib.verdict.case import Case
from calib.verdict.next_commands import NextCommands
from calib.verdict.verdict import Reason

Found = TypeVar("Found", Reason, str)
SESSION = Path("my session")
DIAGNOSE = f"calib diagnose '{SESSION}/calibration'"


def asked(
    check: Callable[[Case], Iterable[Found]],
    calibration: Calibration,
    depths: tuple[float, ...] = (),
    evaluation: Evaluation | None = None,
) -> list[Found]:
    """The reasons that one check gives, or its notes."""
    commands = commands_of(calibration)
    return list(check(Case(calibration, depths, commands, evaluation, "other views")))


def commands_of(calibration: Calibration) -> NextCommands:
    """The commands about a calibration of SESSION."""
    settings = calibration.request.settings or Settings()
    return NextCommands(SESSION, SESSION / "calibration", settings)
