"""The pictures of `calib pose`, and its table: a line for each pose, two for a tag whose corners
allow two.
"""

import csv
import io
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.apply.located_tags import Located, TagPose
from calib.apply.tags import TagLocator
from calib.corners.detect import eight_bits
from calib.corners.markers import read_markers
from calib.errors import InputError, NotEnoughDataError, harmless
from calib.io.files import reading
from calib.io.images import list_images, read_grey
from calib.progress import Progress

AXES = ("turn_x", "turn_y", "turn_z", "x", "y", "z")
"""Of a covariance: rad, and m."""
UPPER = tuple((row, column) for row in range(len(AXES)) for column in range(row, len(AXES)))
"""Its entries that are written."""
COLUMNS = (
    *("picture", "tag", "probability", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"),
    *(f"sigma_{axis}_{'rad' if axis.startswith('turn') else 'm'}" for axis in AXES),
    "off_px",
    *(f"cov_{AXES[row]}_{AXES[column]}" for row, column in UPPER),
)
OTHER_BORDER = {1: 2, 2: 1}


@dataclass(frozen=True, slots=True)
class Picture:
    """One that was looked at."""

    path: Path
    located: Located


@dataclass(frozen=True, slots=True)
class Refused:
    """A picture that could not be looked at, as others could."""

    path: Path
    sentence: str


def pictures_of(given: Sequence[Path]) -> list[Path]:
    """Return pictures, and those of folders; InputError where there are none."""
    paths: list[Path] = []
    for one in given:
        with reading(one):
            paths += list_images(one) if stat.S_ISDIR(one.stat().st_mode) else (one,)
    if not paths:
        raise InputError(f"{given[0]} holds no picture: give pictures, or folders of them.")
    return paths


def locate_in_files(
    locator: TagLocator, given: Sequence[Path], progress: Progress
) -> tuple[list[Picture], list[Refused]]:
    """The tags of pictures, and of folders of pictures; and which of these cannot be read, or are
    of another size than the calibration's.

    Raises:
        InputError: none can be looked at, or a path that is given is not there.
        NotEnoughDataError: no picture shows a tag that can be placed.
    """
    paths = pictures_of(given)
    advance = progress.task("Tags", len(paths))
    pictures, refused = [], []
    for done, path in enumerate(paths):
        advance(done, path.name)
        try:
            pictures.append(Picture(path, locator.locate(read_grey(path))))
        except InputError as error:
            sentence = str(error) if str(path) in str(error) else f"{path}: {error}"
            refused.append(Refused(path, sentence))
    advance(len(paths), "")
    if not pictures:
        raise InputError(refused[0].sentence)
    if not any(picture.located.tags for picture in pictures):
        raise NotEnoughDataError(_why(locator, pictures))
    return pictures, refused


def _why(locator: TagLocator, pictures: Sequence[Picture]) -> str:
    """A sentence about pictures in which no tag is placed."""
    read = [(picture, one) for picture in pictures for one in picture.located.unplaced]
    border = OTHER_BORDER.get(locator.border)
    if border:
        others = sum(
            read_markers(eight_bits(read_grey(one.path)), locator.dictionary, border).numbers.size
            for one in pictures
        )
        if others > len(read):
            return (
                f"the tags of {locator.dictionary} here have a border of {border}, not"
                f" {locator.border}: write --border {border}."
            )
    if read:
        picture, one = read[0]
        return f"no tag is placed; tag {one.number} of {picture.path.name}: {one.reason}."
    where = pictures[0].path.name if len(pictures) == 1 else f"any of {len(pictures)} pictures"
    return (
        f"no tag of {locator.dictionary} is seen in {where}: check the dictionary, and show tags"
        " sharp and with a white margin."
    )


def as_table(pictures: Sequence[Picture]) -> str:
    """CSV, in the order of COLUMNS."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for picture in pictures:
        for tag in picture.located.tags:
            for pose in tag.poses:
                writer.writerow(
                    [
                        harmless(str(picture.path)),
                        tag.number,
                        *(f"{number:.9g}" for number in _numbers(pose)),
                    ]
                )
    return text.getvalue()


def _numbers(pose: TagPose) -> list[float]:
    covariance = pose.covariance
    upper = [float(covariance[row, column]) for row, column in UPPER]
    return [
        pose.probability,
        *pose.position.tolist(),
        *pose.rotation.tolist(),
        *pose.sigma.tolist(),
        pose.off_px,
        *upper,
    ]
