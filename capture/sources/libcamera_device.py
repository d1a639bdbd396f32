"""The cameras that libcamera sees, and its bindings, which come with the system and are imported
when they are needed.
"""

import os
from collections.abc import Sequence
from typing import Any

from calib.io.numerals import whole_number
from capture.errors import CaptureError
from capture.sources.registry import ListedCamera

FORMATS = ("R8", "YUV420", "NV12")
"""The formats that begin with a plane of grey values, the smallest first."""
MISSING = (
    "The libcamera bindings are not installed: run sudo apt install -y python3-libcamera, and make"
    " the environment by the system's own python3 -m venv --system-site-packages; or use rpicam:0,"
    " which needs none."
)


def bindings() -> Any:
    os.environ.setdefault("LIBCAMERA_LOG_LEVELS", "*:ERROR")
    try:
        import libcamera
    except ImportError as error:
        raise CaptureError(MISSING) from error
    return libcamera


def find(cameras: Sequence[Any], place: str) -> Any:
    """Return the camera with this number, or with this text in its id."""
    number = whole_number(place)
    if number is not None and number < len(cameras):
        return cameras[number]
    for camera in cameras:
        if not place.isdecimal() and place in camera.id:
            return camera
    cameras_here = (
        ", ".join(f"libcamera:{number} ({camera.id})" for number, camera in enumerate(cameras))
        or "none: check the cable"
    )
    raise CaptureError(f"libcamera:{place} is not there; cameras of this machine: {cameras_here}.")


def list_camera(number: int, camera: Any) -> ListedCamera:
    configuration = camera.generate_configuration([bindings().StreamRole.Viewfinder]).at(0)
    modes = []
    for pixels in configuration.formats.pixel_formats:
        if str(pixels) in FORMATS:
            modes += [
                f"{pixels} {size.width}x{size.height}"
                for size in configuration.formats.sizes(pixels)
            ]
    return ListedCamera(f"libcamera:{number}", camera.id, tuple(modes))
