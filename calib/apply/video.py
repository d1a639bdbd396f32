"""Undistort videos frame by frame. The result has no sound."""

import secrets
from contextlib import suppress
from pathlib import Path

import cv2
import numpy as np

from calib.apply.undistorter import Undistorter
from calib.errors import InputError
from calib.io.output_folder import OutputFolder
from calib.io.videos import VIDEOS, breaks_off, open_video, promised_frames
from calib.progress import Progress


def straighten_video(
    path: Path, output: OutputFolder, undistorter: Undistorter, progress: Progress
) -> tuple[Path, str]:
    """Write the undistorted video under its own name, with the frame rate of the original.

    An earlier file of that name stays complete until the last frame is written.

    Returns:
        The path of the new video, and a sentence if the last frames of the original are missing;
        else an empty text.
    """
    target = output.path / path.name
    capture = open_video(path)
    promised = promised_frames(capture)
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
                    cv2.VideoWriter.fourcc(*VIDEOS[target.suffix.lower()]),
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
                f"{path} holds no frame that can be decoded: convert it to mp4 or avi, or"
                " replace it."
            )
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
