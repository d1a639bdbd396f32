"""Check: the declared medium. The smooth cover is also tried with the other one, air or water."""

from collections.abc import Iterator
from functools import lru_cache

from calib.calibration import Calibration
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
    cover, bare_error = case.rms_px.get("cover", 0.0), case.rms_px["pinhole"]
    declared = case.calibration.declared
    stated = declared.cover.medium
    if not stated or case.has_unknown:
        return
    if cover <= max(OTHER_MEDIUM * bare_error, case.left_px):  # it is right
        return
    index = stated.value
    name = "air" if index > HALFWAY else "water"
    error = _error_in(case.calibration, name)
    if error < OTHER_MEDIUM * cover:
        sentence = (
            f"with {name} outside of the cover, the error with the numbers of session.yaml is"
            f" {error:.3f} px; with its outside_index of {index:g} it is {cover:.3f} px. So the"
            f" board was in {name}."
        )
        yield Reason(sentence, case.next.fit(), (declared.cover.medium_name,))


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def _error_in(calibration: Calibration, medium: str) -> float:
    """Return the root mean square error in px of the declared numbers with another medium
    outside.
    """
    declared, observations = calibration.declared, calibration.observations
    cover = declared.cover.replace_numbers({declared.cover.medium_name: Number(MEDIA[medium])})
    path, values = covered_path(declared.intrinsics, cover)
    poses = refine_poses(
        path, values, observations, pinhole_poses(path, values, observations)
    ).blocks
    return residuals(path, values, observations, poses).rms_px
