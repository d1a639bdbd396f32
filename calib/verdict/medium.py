"""Air declared where there is water, or water where there is air: the smooth cover is tried with the other."""

from collections.abc import Iterator
from dataclasses import replace

from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.optics.build import covered_path
from calib.session.schema import Number
from calib.verdict.case import Case
from calib.verdict.thresholds import OTHER_MEDIUM
from calib.verdict.verdict import Reason

MEDIA = {"air": 1.0, "water": 1.333}
HALFWAY = 1.17


def medium(case: Case) -> Iterator[Reason]:
    cover, bare = case.rms_px.get("cover", 0.0), case.rms_px["pinhole"]
    declared = case.calibration.declared
    if cover <= max(OTHER_MEDIUM * bare, case.left_px):  # a cover that explains so much has the right medium
        return
    index = declared.cover.parameters["outside_index"].value
    name = "air" if index > HALFWAY else "water"
    other = replace(declared.cover, parameters={**declared.cover.parameters, "outside_index": Number(MEDIA[name])})
    path, values = covered_path(declared.intrinsics, other)
    poses = refine_poses(path, values, case.observations, pinhole_poses(case.observations, values)).blocks
    left = residuals(path, values, case.observations, poses).rms_px
    if left < OTHER_MEDIUM * cover:
        said = (
            f"with {name} outside of the cover, the numbers of session.yaml leave {left:.3f} px, and with its outside_index of {index:g} "
            f"{cover:.3f} px: the board was in {name}."
        )
        yield Reason(said, case.next.fit(), ("cover.outside_index",))
