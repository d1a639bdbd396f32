"""Check: the declared principal point lies in the picture, and not in that of another sensor
mode.
"""

from collections.abc import Iterator

from calib.session.camera import Camera, Intrinsics
from calib.session.parameter_names import CAMERA
from calib.verdict.case import Case
from calib.verdict.thresholds import CROPPED, FIELD, OTHER_SIZE, SAME_SIZE
from calib.verdict.verdict import Reason, Trust

SENSOR_MODES = (
    *(
        (3280, 2464),
        (1640, 1232),
        (2592, 1944),
        (1296, 972),
        (4056, 3040),
        (2028, 1520),
        (2028, 1080),
        (1332, 990),
    ),
    *(
        (4608, 2592),
        (2304, 1296),
        (1536, 864),
        (1456, 1088),
        (1280, 800),
        (2064, 1552),
        (4000, 3000),
        (6000, 4000),
    ),
    *(
        (3840, 2160),
        (1920, 1080),
        (1280, 720),
        (1920, 1200),
        (1600, 1200),
        (1280, 960),
        (1024, 768),
        (800, 600),
        (640, 480),
    ),
)
"""Widths and heights in px of the modes of Raspberry Pi's cameras (v2, v1, HQ, 3, Global Shutter),
of common sensors, and of video.
"""
SCALES = (2, 3, 4, 1 / 2, 1 / 3, 1 / 4)
"""Scales of binned and resized pictures."""


def principal_point(case: Case) -> Iterator[Reason]:
    camera, k = case.calibration.camera, case.calibration.declared.intrinsics
    offset = max(
        abs(k.cx.value / (camera.width - 1) - 0.5), abs(k.cy.value / (camera.height - 1) - 0.5)
    )
    suspects = CAMERA.pinhole
    if size := other_mode(camera, k):
        sentence = (
            f"these look like the intrinsics of {size[0]}x{size[1]}, and the pictures have"
            f" {camera.width}x{camera.height}: their principal point, ({k.cx.value:.0f},"
            f" {k.cy.value:.0f}), is the middle of that size. Give those of this mode."
        )
        yield Reason(sentence, case.next.fit(), suspects, Trust.DO_NOT_USE)
    elif offset > 0.5:
        sentence = (
            f"the principal point, ({k.cx.value:.0f}, {k.cy.value:.0f}), is outside of the picture"
            f" of {camera.width}x{camera.height}: were cx and cy changed over, or is the picture a"
            " cut-out?"
        )
        yield Reason(
            sentence,
            case.next.fit(),
            suspects[2:],
            Trust.DO_NOT_USE if offset > CROPPED else Trust.CARE,
        )


def other_mode(camera: Camera, k: Intrinsics) -> tuple[int, int] | None:
    """Return the most likely picture size of the intrinsics if it is not that of the camera, or
    None.
    """
    centred = (2 * k.cx.value + 1, 2 * k.cy.value + 1)
    if _relative_difference(centred, (camera.width, camera.height)) < OTHER_SIZE:
        return None
    scaled = [(round(camera.width * scale), round(camera.height * scale)) for scale in SCALES]
    fitting = [
        size
        for size in (*scaled, *SENSOR_MODES)
        if _relative_difference(centred, size) < SAME_SIZE
        and FIELD[0] < k.fx.value / size[0] < FIELD[1]
    ]
    return min(fitting, key=lambda size: _relative_difference(centred, size), default=None)


def _relative_difference(first: tuple[float, float], size: tuple[int, int]) -> float:
    return max(abs(length / reference - 1) for length, reference in zip(first, size, strict=True))
