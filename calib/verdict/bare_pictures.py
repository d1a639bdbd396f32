"""Check: the pictures in bare/ were taken through the cover, so their lens contains the cover."""

from collections.abc import Iterator

from calib.session.parameter_names import CAMERA
from calib.verdict.case import Case
from calib.verdict.thresholds import EXPLAINED, WORSE_THAN_BARE
from calib.verdict.verdict import Reason


def bare_pictures(case: Case) -> Iterator[Reason]:
    if taken_through_cover(case):
        bare = case.rms_px["pinhole"]
        cover = case.rms_px["cover"]
        sentence = (
            f"the camera alone explains the pictures through the cover ({bare:.3f} px) better than"
            f" the cover does ({cover:.3f} px): were the pictures in bare/ taken with the cover on?"
            " Take them anew without it, or else check the cover's numbers."
        )
        yield Reason(sentence, case.next.capture(), CAMERA.pinhole)


def taken_through_cover(case: Case) -> bool:
    """Return True if the lens of bare/ explains pictures in which the declared cover would be
    visible.
    """
    errors, noise = case.rms_px, case.calibration.noise_px
    if "cover" not in errors or noise is None:
        return False
    return (
        case.calibration.outcome.intrinsics_from == "bare"
        and errors["pinhole"] <= EXPLAINED * noise
        and errors["cover"] > WORSE_THAN_BARE * errors["pinhole"]
    )
