"""The pictures of `calib pose`, and its table. The table has a line for each pose, so two lines for
a tag whose corners allow two poses.
"""

import csv
import io
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.apply.located_tags import LocatedTags, TagPose
from calib.apply.tags import TagLocator
from calib.corners.detect import eight_bits
from calib.corners.markers import read_markers
from calib.errors import InputError, NotEnoughDataError, harmless
from calib.io.files import reading
from calib.io.images import list_images, read_grey
from calib.progress import Progress

AXES = ("turn_x", "turn_y", "turn_z", "x", "y", "z")
"""The axes of a pose's covariance, rad and m."""
UPPER = tuple((row, column) for row in range(len(AXES)) for column in range(row, len(AXES)))
"""The rows and columns of the covariance's upper triangle, which the table has."""
COLUMNS = (
    *("picture", "tag", "probability", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"),
    *(f"sigma_{axis}_{'rad' if axis.startswith('turn') else 'm'}" for axis in AXES),
    "off_px",
    *(f"cov_{AXES[row]}_{AXES[column]}" for row, column in UPPER),
)
OTHER_BORDER = {1: 2, 2: 1}


@dataclass(frozen=True, slots=True)
class TagPicture:
    """A picture with its tags."""

    path: Path
    located: LocatedTags


@dataclass(frozen=True, slots=True)
class Refused:
    """A picture that could not be read, or has the wrong size."""

    path: Path
    sentence: str


def pictures_of(inputs: Sequence[Path]) -> list[Path]:
    """Return the pictures among files and in folders; InputError if there are none."""
    paths: list[Path] = []
    for path in inputs:
        with reading(path):
            paths += list_images(path) if stat.S_ISDIR(path.stat().st_mode) else (path,)
    if not paths:
        raise InputError(f"{inputs[0]} holds no picture: give pictures, or folders of them.")
    return paths


def locate_in_files(
    locator: TagLocator, inputs: Sequence[Path], progress: Progress
) -> tuple[list[TagPicture], list[Refused]]:
    """Locate the tags of pictures, and of folders of pictures. Return the pictures with their tags,
    and the pictures that cannot be read or have another size than the calibration's.

    Raises:
        InputError: no picture can be used, or a path does not exist.
        NotEnoughDataError: no tag of any picture gets a pose.
    """
    paths = pictures_of(inputs)
    advance = progress.task("Tags", len(paths))
    pictures, refused = [], []
    for done, path in enumerate(paths):
        advance(done, path.name)
        try:
            pictures.append(TagPicture(path, locator.locate(read_grey(path))))
        except InputError as error:
            sentence = str(error) if str(path) in str(error) else f"{path}: {error}"
            refused.append(Refused(path, sentence))
    advance(len(paths), "")
    if not pictures:
        raise InputError(refused[0].sentence)
    if not any(picture.located.tags for picture in pictures):
        raise NotEnoughDataError(_explain_no_tag(locator, pictures))
    return pictures, refused


def _explain_no_tag(locator: TagLocator, pictures: Sequence[TagPicture]) -> str:
    """Return a sentence on why no tag of these pictures has a pose."""
    unplaced = [(picture, tag) for picture in pictures for tag in picture.located.unplaced]
    border = OTHER_BORDER.get(locator.border)
    if border:
        count = sum(
            read_markers(
                eight_bits(read_grey(picture.path)), locator.dictionary, border
            ).numbers.size
            for picture in pictures
        )
        if count > len(unplaced):
            return (
                f"the tags of {locator.dictionary} here have a border of {border}, not"
                f" {locator.border}: write --border {border}."
            )
    if unplaced:
        picture, tag = unplaced[0]
        return f"no tag is placed; tag {tag.number} of {picture.path.name}: {tag.reason}."
    where = pictures[0].path.name if len(pictures) == 1 else f"any of {len(pictures)} pictures"
    return (
        f"no tag of {locator.dictionary} is seen in {where}: check the dictionary, and show tags"
        " sharp and with a white margin."
    )


def as_table(pictures: Sequence[TagPicture]) -> str:
    """Return the poses as CSV, with the columns COLUMNS."""
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
                        *(f"{number:.9g}" for number in _cells(pose)),
                    ]
                )
    return text.getvalue()


def _cells(pose: TagPose) -> list[float]:
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
