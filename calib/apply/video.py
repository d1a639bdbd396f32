"""Undistort videos frame by frame. The result has no sound."""

import secrets
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from calib.apply.undistorter import Undistorter
from calib.errors import InputError
from calib.io.output_folder import OutputFolder
from calib.io.videos import (
    CODECS,
    VIDEOS,
    breaks_off,
    convert_command,
    open_video,
    promised_frames,
    stored_frames,
)
from calib.progress import Progress


def straightened_name(path: Path) -> str:
    """Return the name of an undistorted picture or video: that of the original, but a video of a
    type that OpenCV may not write becomes .mp4.
    """
    suffix = path.suffix.lower()
    return f"{path.stem}.mp4" if suffix in VIDEOS and suffix not in CODECS else path.name


def straighten_video(
    path: Path, output: OutputFolder, undistorter: Undistorter, progress: Progress
) -> tuple[Path, str]:
    """Write the undistorted video, with the frame rate of the original.

    An earlier file of that name stays complete until the last frame is written.

    Returns:
        The path of the new video, and a sentence if the last frames of the original are missing;
        else an empty text.
    """
    target = output.path / straightened_name(path)
    capture = open_video(path)
    promised = promised_frames(capture, path)
    temporary = target.with_name(f".refracal-{secrets.token_hex(8)}{target.suffix}")
    width, height = undistorter.size
    writer = cv2.VideoWriter()
    straight = np.empty((height, width, 3), np.uint8)
    advance = progress.task(path.name, max(1, promised))
    frames = 0
    try:
        while True:
            success, frame = capture.read()
            if not success:
                break
            try:
                undistorter.undistort(frame.astype(np.uint8, copy=False), straight)
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
            if not frames:
                rate = capture.get(cv2.CAP_PROP_FPS) or 25.0
                if not writer.open(
                    str(temporary),
                    cv2.VideoWriter.fourcc(*CODECS[target.suffix.lower()]),
                    rate,
                    (width, height),
                ):
                    raise InputError(
                        f"{target} cannot be written: choose another folder, or give the video as"
                        " .avi."
                    )
            writer.write(straight)
            frames += 1
            advance(frames, "")
        writer.release()
        if not frames:
            raise InputError(
                f"{path} holds no frame that can be decoded: replace it, or convert it by"
                f" `{convert_command(path)}`."
            )
        _check_stored(temporary, target, frames)
        written = output.take(temporary, target.name)
        if breaks_off(frames, promised):
            return written, (
                f"{path} breaks off after {frames} of {promised} frames, which were straightened:"
                " copy it again for all of them."
            )
        return written, ""
    except OSError as error:
        raise InputError(
            f"{target} cannot be written ({error.strerror}): choose another folder."
        ) from error
    finally:
        capture.release()
        writer.release()
        with suppress(OSError):
            temporary.unlink()


def _check_stored(temporary: Path, target: Path, frames: int) -> None:
    """Check that all frames are on the disk: OpenCV's writer does not say that a disk is full.
    InputError if some are not.
    """
    stored = stored_frames(temporary)
    if stored < frames:
        raise InputError(
            f"{target} cannot be written, the disk took {stored} of {frames} frames: free some"
            " space there, or choose another folder."
        )
