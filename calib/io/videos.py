"""Open video files with FFmpeg, which refuses frames of more than 268 million px before it
allocates memory for them. OpenCV's other readers do not.
"""

from pathlib import Path

import cv2

from calib.io.bag_names import refuse_bag
from calib.io.files import check_regular, reading
from calib.io.shell import shell_line

CODECS = {".avi": "MJPG", ".mp4": "mp4v", ".m4v": "mp4v", ".mov": "mp4v", ".mkv": "mp4v"}
"""The codec that is written for each suffix; every OpenCV has these, for any frame rate."""
UNINDEXED = (".mpg", ".mpeg", ".mts", ".m2ts", ".ts")
"""Streams whose number of frames is a guess from their size and first times, which may be double.
"""
VIDEOS = (*CODECS, *UNINDEXED, ".webm", ".3gp", ".wmv", ".ogv")
"""The suffixes of the videos that are read."""
OTHER_VIDEOS = (".h264", ".h265", ".hevc", ".mjpeg", ".flv", ".vob", ".asf", ".mxf", ".insv")
"""Suffixes of videos that are not read: streams without times, and rare types."""
ESTIMATE = 0.05
"""The relative error of the number of frames in a video's header: some containers only estimate it.
"""


def open_video(path: Path) -> cv2.VideoCapture:
    """Return the video, which gives its frames as stored; InputError if there is no such file, or
    it is a recording of ROS.
    """
    refuse_bag(path)
    check_regular(path)
    with reading(path):
        path.open("rb").close()
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    return video


def promised_frames(video: cv2.VideoCapture, path: Path) -> int:
    """Return the number of frames that the header of a video's file promises; 0 if it has none."""
    if path.suffix.lower() in UNINDEXED:
        return 0
    return max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT)))


def convert_command(path: Path) -> str:
    """Return the command of FFmpeg that converts a video into one that OpenCV reads."""
    name = f"{path.stem}-converted.mp4" if path.suffix.lower() == ".mp4" else f"{path.stem}.mp4"
    return shell_line("ffmpeg", "-i", path, path.with_name(name))


def stored_frames(path: Path) -> int:
    """Return the number of frames that a video's file has, which are not decoded; 0 if it cannot be
    opened.
    """
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG, [cv2.CAP_PROP_FORMAT, -1])
    frames = 0
    while video.grab():
        frames += 1
    video.release()
    return frames


def breaks_off(frames: int, promised: int) -> bool:
    """True if the frames are fewer than the header promises, beyond the error of an estimate."""
    return frames < (1 - ESTIMATE) * promised - 1


def list_videos(folder: Path) -> tuple[Path, ...]:
    """Return the videos of a folder, sorted by name, without hidden files."""
    return tuple(
        sorted(
            p
            for p in folder.iterdir()
            if p.suffix.lower() in VIDEOS and not p.name.startswith(".") and not p.is_dir()
        )
    )
