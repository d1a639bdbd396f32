"""Check: the pixels of the fitted camera are square."""

from collections.abc import Iterator

from calib.session.numbers import unknown_names
from calib.session.parameter_names import CAMERA
from calib.verdict.case import Case
from calib.verdict.thresholds import SQUARE_PIXELS, SQUARE_SIGMAS
from calib.verdict.verdict import Reason


def square_pixels(case: Case) -> Iterator[Reason]:
    """Check intrinsics that no one declared: nearly all sensors have square pixels. A print that is
    stretched along one side, or a picture that is, makes the two focal lengths differ.
    """
    calibration = case.calibration
    declared = calibration.declared
    unknown = unknown_names(declared.intrinsics, declared.cover)
    is_estimated = calibration.outcome.intrinsics_from == "views" or {*CAMERA.focal} <= {*unknown}
    if not is_estimated or not calibration.covariance.size:
        return
    model = calibration.camera_model()
    parameters = model.parameters
    entries = parameters.entries(CAMERA.focal)
    scales = [param.scale for param in parameters.free if param.name in CAMERA.focal]
    fx = float(model.means[CAMERA.fx])
    fy = float(model.means[CAMERA.fy])
    ratio = fx / fy - 1
    slope = [scales[0] / fy, -fx * scales[1] / fy**2]
    block = calibration.covariance[entries][:, entries]
    sigma = float(slope @ block @ slope) ** 0.5
    if abs(ratio) > max(SQUARE_PIXELS, SQUARE_SIGMAS * sigma):
        covered = calibration.cover.shape != "none"
        cause = (
            case.other_shape
            if covered
            else f"the camera looks through a cover (try {case.next.unknown_cover})"
        )
        sentence = (
            f"fx and fy differ by {100 * abs(ratio):.1f} %, {abs(ratio) / sigma:.0f} standard"
            " deviations, and sensors have square pixels: the print is longer along one side than"
            f" declared, or {cause}, or the pictures are stretched; measure the board along both"
            " sides."
        )
        yield Reason(sentence, case.next.diagnose(), CAMERA.focal)
