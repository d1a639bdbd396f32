"""Video files, opened by FFmpeg: it refuses frames of more than 268 million px before it makes room
for them, where OpenCV's own readers do not.
"""

from pathlib import Path

import cv2

from calib.io.files import check_regular, reading

ESTIMATE = 0.05
"""The part of a video's frames by which its header may promise too many: some containers only
estimate their number.
"""


def open_video(path: Path) -> cv2.VideoCapture:
    """Return the video, its frames as stored; InputError where there is no such file."""
    check_regular(path)
    with reading(path):
        path.open("rb").close()
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return video


def promised_frames(video: cv2.VideoCapture) -> int:
    """Return how many frames the header promises; 0 where it does not say."""
    return max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT)))


def breaks_off(frames: int, promised: int) -> bool:
    """True if fewer frames could be read than were promised, by more than an estimate errs."""
    return frames < (1 - ESTIMATE) * promised - 1
