"""The sentences of the verdict on numbers that differ from view to view."""

from dataclasses import asdict, replace

import pytest

from calib.calibration import Calibration
from calib.calibration_content import AddedEffect
from calib.effects.varying import PrincipalPointOfView
from calib.fit_record.history import DiagnosisRecord, Family, History
from calib.verdict.case import Case
from calib.verdict.differing_views import differing_views
from tests.verdict.cases import commands_of

STABILISER = "switch the image stabiliser off, and record again."


@pytest.mark.parametrize(
    ("members", "sentence"),
    [
        (
            {},
            "the principal point differs in every view, and the maps are of the mean: "
            + STABILISER,
        ),
        (
            {"principal_point": 0.8, "board_scale": 0.2},
            "most likely the principal point differs in every view, and the maps are of the mean: "
            + STABILISER,
        ),
        (
            {"board_scale": 0.8, "principal_point": 0.2},
            "something differs from view to view: most likely the print of the board, else the"
            " principal point, which differs in every view in this calibration. The maps are of the"
            " mean. If it is the first, use one board, on a stiff and dry back.",
        ),
    ],
    ids=["alone", "the first of a family", "the second of a family"],
)
def test_an_accepted_number_stands_alone_only_without_a_family(
    good: Calibration, members: dict[str, float], sentence: str
) -> None:
    families = [asdict(Family("what differs from view to view", members, ""))] if members else []
    calibration = replace(
        good,
        effects=(AddedEffect(PrincipalPointOfView(), {}),),
        history=History(diagnosis=DiagnosisRecord({"families": families})),
    )
    case = Case(calibration, (), commands_of(calibration), None, "")
    reason = next(iter(differing_views(case)))
    assert reason.sentence == sentence
    assert reason.suspects == (tuple(members) or ("principal_point",))
