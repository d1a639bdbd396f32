"""Check: the pictures in bare/ show the lens alone, and as it is under the cover."""

from collections.abc import Iterator

from calib.session.numbers import camera_numbers
from calib.session.parameter_names import CAMERA
from calib.verdict.case import Case
from calib.verdict.thresholds import EXPLAINED, WORSE_THAN_BARE
from calib.verdict.verdict import Reason

MIN_DIFFERENCE = 3.0
"""Standard deviations of a declared number from which another lens differs in it."""


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


def lens_advice(case: Case) -> str:
    """Return what to do if the lens differs from that of bare/, which numbers of the cover imitate;
    empty if the lens is not from bare/.
    """
    if case.calibration.outcome.intrinsics_from != "bare":
        return ""
    return (
        " Or the lens is not as it was in bare/: take those pictures again, with the focus, the"
        " zoom and the picture size as they are under the cover."
    )


def rival_lens(case: Case) -> Iterator[str]:
    """Yield a note where even glass with another lens explains the views as well as uneven glass
    with the declared one.
    """
    lens = case.calibration.outcome.rival_lens
    declared = case.calibration.declared.intrinsics
    if not (lens and declared):
        return
    stated = camera_numbers(declared)
    changes = [
        f"{name} {value:.1f} in place of {stated[name].value:.1f} px"
        for name, value in lens.items()
        if abs(value - stated[name].value) > MIN_DIFFERENCE * stated[name].sigma
    ]
    is_bare = case.calibration.outcome.intrinsics_from == "bare"
    source = "bare/" if is_bare else case.next.description
    yield (
        "even glass and another lens explain these pictures as well as uneven glass and the lens of"
        f" {source}: {', '.join(changes)}. The maps are the same, but the numbers of camera and"
        " cover are not. Check that the focus, the zoom and the picture size are those of the"
        " pictures through the cover."
    )


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
