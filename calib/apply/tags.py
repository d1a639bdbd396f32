"""The position and rotation of tags that a calibrated camera sees through its cover, in metres,
with a covariance.

Sigma includes the noise of the corners, which is estimated from each picture's pixels, the
uncertainty of the calibration's rays, and the tolerance of the side of the tags. It does not
include the error of a tag that is not flat. The camera's tone curve, and ink that spreads, make
black look smaller or larger than it is. This spread is measured in the tags and removed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.apply.located_tags import LocatedTags, Tag, TagPose, Unplaced, UnplacedReason
from calib.apply.map_uncertainty import frames_along, ray_errors
from calib.apply.tag_pose import SQUARE, Lines, measure_misfit, poses
from calib.calibration import Calibration, CalibrationSource
from calib.corners.detect import eight_bits
from calib.corners.ink_spread import NO_INK_SPREAD, InkSpread, measure_ink_spread, remove_ink_spread
from calib.corners.markers import black_cells, read_markers, size_of_markers
from calib.corners.tag_outline import edge_vectors, measure_outlines
from calib.errors import InputError, brief, meant
from calib.io.array_arguments import numbers, one_of, picture, pixel_rows
from calib.io.numerals import real_number
from calib.session.coding import DICTIONARIES
from calib.session.tolerances import SQUARE_SIDE
from calib.threads import single_thread

Array = NDArray[np.float64]

MIN_NOISE = 1e-4
"""px: the standard deviation that is added to each coordinate of a corner."""
OUTLINE_SIGMA = 0.5
"""px: the standard deviation of the corners of a tag's outline from OpenCV."""
MIN_SHARE = 1e-3
"""A pose of less relative probability is not allowed by its corners."""
MAX_CHI2 = 13.8
"""chi^2 of two degrees of freedom that one in a thousand tags exceeds by chance: above it, sigma is
scaled to the misfit.
"""
DEGREES_OF_FREEDOM = 2
"""Eight coordinates of corners, less six parameters of the pose."""
MAX_VARIANCE = 1e6
"""px^2: a corner of a larger covariance may be anywhere in a picture, so it was not measured."""
MAX_RELATIVE_MISFIT = 0.01
"""A root mean square misfit relative to the tag's side in the picture: corners with a larger misfit
are not those of a flat square.
"""
MAX_MISFIT_PX = 0.5
"""px: the same limit for small tags."""
UPSIDE_DOWN = "DICT_APRILTAG_"
"""The beginning of the names of families whose upper left corner in OpenCV is the lower right
corner of the makers' (and Kalibr's) upright tag.
"""
BORDERS = (1, 2)
"""The widths of a tag's black border in cells. One is usual; Kalibr prints two."""
MIN_SIDE = 5e-5
"""m: the smallest side of a tag's black square."""
MAX_SIDE = 100.0
"""m: the largest side of a tag's black square."""


class TagLocator:
    """Finds tags of one size and dictionary in the pictures of one camera."""

    def __init__(
        self,
        calibration: CalibrationSource,
        dictionary: str,
        side: float,
        side_sigma: float | None = None,
        border: int = 1,
    ) -> None:
        """
        Args:
            calibration: the camera's calibration, or the path of its file or folder.
            dictionary: OpenCV's name of the dictionary, such as DICT_APRILTAG_36h11.
            side: m, the side of the black square.
            side_sigma: m, the standard deviation of the side; by default 0.2 % of it.
            border: the width of the black border in cells; 2 on Kalibr's boards.

        Raises:
            InputError: there is no such dictionary, or a size is out of range.
        """
        if not isinstance(dictionary, str) or dictionary not in DICTIONARIES:
            near = meant(str(dictionary).upper(), tuple(DICTIONARIES))
            raise InputError(
                f"{brief(repr(dictionary))} is no dictionary of tags: write"
                f" {near or 'DICT_APRILTAG_36h11, say'}."
            )
        side = real_number(side, "side")
        if not MIN_SIDE <= side <= MAX_SIDE:
            raise InputError(
                f"a tag of {1000 * side:g} mm will not do: give the side of its black square, from"
                " 0.05 to 100000 mm."
            )
        spread = (
            SQUARE_SIDE.sigma * side
            if side_sigma is None
            else real_number(side_sigma, "side_sigma")
        )
        if not 0 <= spread < side:
            raise InputError(
                f"a standard deviation of {1000 * spread:g} mm will not do: give 0 or more, and"
                " less than the side."
            )
        calibration = Calibration.of(calibration)
        self.calibration = calibration
        self.dictionary = dictionary
        self.side = side
        self.border = one_of(border, BORDERS, "border")
        self._relative_sigma = spread / side
        self._errors = ray_errors(calibration)
        pinhole = calibration.camera.intrinsics
        assert pinhole
        self._focal = np.array([pinhole.fx.value, pinhole.fy.value])

    def locate(self, grey: NDArray) -> LocatedTags:
        """Return the tags of an (H, W) uint8 or uint16 picture.

        Raises:
            InputError: the picture has another size than the calibration's.
        """
        camera = self.calibration.camera
        grey = picture(grey, camera.width, camera.height)
        if grey.ndim != 2 or grey.dtype.kind != "u":
            raise InputError(
                f"the picture is {grey.dtype} of shape {grey.shape}: give (height, width) grey"
                " values as uint8 or uint16."
            )
        read = read_markers(eight_bits(grey), self.dictionary, self.border)
        order = np.argsort(read.numbers, kind="stable")
        numbers = read.numbers[order].tolist()
        rough = read.corners[order]
        rough = np.roll(rough, 2, 1) if self.dictionary.startswith(UPSIDE_DOWN) else rough
        repeated = {number for number in numbers if numbers.count(number) > 1}
        unique = [at for at, number in enumerate(numbers) if number not in repeated]
        with single_thread():
            tags, growth = (
                self._place_markers(grey, [numbers[at] for at in unique], rough[unique])
                if unique
                else ([], NO_INK_SPREAD)
            )
        unplaced = [
            *(Unplaced(number, UnplacedReason.TWICE) for number in sorted(repeated)),
            *(tag for tag in tags if isinstance(tag, Unplaced)),
        ]
        return LocatedTags(
            tuple(tag for tag in tags if isinstance(tag, Tag)), tuple(unplaced), growth
        )

    def place(
        self, corners: Array, covariances: Array
    ) -> list[tuple[TagPose, ...] | UnplacedReason]:
        """Return, for each of T tags, the poses that its corners allow, the most probable first, or
        the reason why there is none. Any program may have measured the corners.

        Args:
            corners: (T, 4, 2) px: upper left, upper right, lower right, lower left of the upright
                tags. NaN for corners that were not measured.
            covariances: (T, 8, 8) px^2, of x and y of the four corners.
        """
        corners = numbers(corners, (None, 4, 2), "corners")
        covariances = numbers(covariances, (len(corners), 8, 8), "covariances")
        corners = pixel_rows(corners.reshape(-1, 2)).reshape(-1, 4, 2)
        is_given = np.isfinite(corners).all((1, 2)) & (np.abs(covariances) < MAX_VARIANCE).all(
            (1, 2)
        )
        _check_covariances(covariances[is_given])
        results: list[tuple[TagPose, ...] | UnplacedReason] = [UnplacedReason.NO_EDGES] * len(
            corners
        )
        if not is_given.any():
            return results
        pixels = corners[is_given].reshape(-1, 2)
        frames = self._tag_frames(corners[is_given])
        corner_frames = frames if frames is None else np.repeat(frames, 4, 0)
        lines = Lines.of(self.calibration, pixels, corner_frames)
        errors = self._errors(pixels, corner_frames).reshape(int(is_given.sum()), 4, 4, -1)
        for row, at in enumerate(np.flatnonzero(is_given).tolist()):
            tag_lines = lines.select(slice(4 * row, 4 * row + 4))
            if not tag_lines.is_complete:
                results[at] = UnplacedReason.NO_RAY
                continue
            tag_poses = tuple(
                self._find_poses(tag_lines, covariances[at] + MIN_NOISE**2 * np.eye(8), errors[row])
            )
            limit = max(
                MAX_MISFIT_PX,
                MAX_RELATIVE_MISFIT
                * float(np.linalg.norm(np.roll(corners[at], 1, 0) - corners[at], axis=-1).mean()),
            )
            if frames is not None:
                tag_poses = tuple(pose.rotate(frames[row].T) for pose in tag_poses)
            results[at] = (
                tag_poses
                if tag_poses and tag_poses[0].off_px <= limit
                else UnplacedReason.NO_SQUARE
            )
        return results

    def _tag_frames(self, corners: Array) -> Array | None:
        """Return (T, 3, 3) rotations from the camera frame to frames that look at the tags with
        (T, 4, 2) px corners. Return None unless the lens is wide: for other lenses, the camera
        frame serves for all tags.
        """
        if not self.calibration.model()[0].lens.wide:
            return None
        _, directions = self.calibration.rays(corners.reshape(-1, 2))
        middle = directions.reshape(-1, 4, 3).sum(1)
        return frames_along(middle / np.linalg.norm(middle, axis=-1, keepdims=True))

    def _place_markers(
        self, grey: NDArray, numbers: list[int], rough: Array
    ) -> tuple[list[Tag | Unplaced], InkSpread]:
        """Return the tags of these numbers, each with poses or a reason, and the ink spread that
        was removed from their corners.

        Args:
            grey: (H, W)
            numbers: T
            rough: (T, 4, 2) px approximate corners.
        """
        outlines = measure_outlines(
            grey, rough, size_of_markers(self.dictionary, self.border), self._edge_bends(rough)
        )
        measured = np.isfinite(outlines.corners).all((1, 2))
        growth = measure_ink_spread(
            grey,
            outlines.corners[measured],
            [self._black_cells(number) for number in np.array(numbers)[measured].tolist()],
        )
        if growth.is_significant:
            outlines = remove_ink_spread(growth, outlines)
        rows = zip(
            numbers,
            outlines.corners,
            self.place(outlines.corners, outlines.covariances),
            strict=True,
        )
        tags = [
            Unplaced(number, tag_poses)
            if isinstance(tag_poses, UnplacedReason)
            else Tag(number, corners, tag_poses)
            for number, corners, tag_poses in rows
        ]
        return tags, growth if growth.is_significant else NO_INK_SPREAD

    def _black_cells(self, number: int) -> NDArray[np.bool_]:
        """Return the (n, n) cells of the upright tag, true where black."""
        cells = black_cells(self.dictionary, number, self.border)
        return cells[::-1, ::-1] if self.dictionary.startswith(UPSIDE_DOWN) else cells

    def _edge_bends(self, rough: Array) -> Array:
        """Return (T, 4) px: the distance by which the middle of each edge lies outside of the
        straight line between its ends, from (T, 4, 2) px approximate corners; 0 if it cannot be
        computed.
        """
        frames = self._tag_frames(rough)
        corner_frames = frames if frames is None else np.repeat(frames, 4, 0)
        lines = Lines.of(self.calibration, rough.reshape(-1, 2), corner_frames)
        bends = np.zeros(rough.shape[:2])
        poses_by_tag = {}
        for at in range(len(rough)):
            tag_lines = lines.select(slice(4 * at, 4 * at + 4))
            if tag_lines.is_complete and (
                candidates := poses(tag_lines, self.side, np.eye(8) / OUTLINE_SIGMA)
            ):
                poses_by_tag[at] = candidates[0]
        if not poses_by_tag:
            return bends
        middles = (SQUARE + np.roll(SQUARE, -1, 0)) / 2
        points = [
            (self.side * np.concatenate([SQUARE, middles]) @ turn.T + shift)
            @ (np.eye(3) if frames is None else frames[at])
            for at, (turn, shift, _) in poses_by_tag.items()
        ]
        projected = self.calibration.project(np.concatenate(points)).reshape(
            len(poses_by_tag), 2, 4, 2
        )
        corners, middle = projected[:, 0], projected[:, 1]
        steps, normals = edge_vectors(corners)
        position = 2 * ((middle - corners) * steps).sum(-1) / (steps**2).sum(-1) - 1
        bends[list(poses_by_tag)] = np.nan_to_num(
            ((middle - corners) * normals).sum(-1) / (1 - position**2)
        )
        return bends

    def _find_poses(self, lines: Lines, noise: Array, errors: Array) -> list[TagPose]:
        """Return the poses that a tag's rays allow, the most probable first.

        Args:
            lines: the rays of the four corners.
            noise: (8, 8) px^2 covariance of the corners.
            errors: (4, 4, S) errors of A (px) and B (px m) of the rays.
        """
        rough = poses(lines, self.side, np.linalg.inv(np.linalg.cholesky(noise)))
        if not rough:
            return []
        by_rays = self._misfit_by_rays(lines, errors, *rough[0][:2])
        whiten = np.linalg.inv(np.linalg.cholesky(noise + by_rays @ by_rays.T))
        minima = poses(lines, self.side, whiten)
        if not minima:
            return []
        inflation = minima[0][2] / DEGREES_OF_FREEDOM if minima[0][2] > MAX_CHI2 else 1.0
        results = [
            self._make_pose(lines, noise * inflation, errors, whiten, turn, shift)
            for turn, shift, _ in minima
        ]
        spreads = [np.linalg.slogdet(pose.covariance)[1] / 2 for pose in results]
        weights = np.array(
            [
                spread - cost / (2 * inflation)
                for spread, (_, _, cost) in zip(spreads, minima, strict=True)
            ]
        )
        odds = np.exp(weights - weights.max())
        odds[odds < MIN_SHARE] = 0.0
        shares = odds / odds.sum()
        ranked = sorted(zip(results, shares.tolist(), strict=True), key=lambda pair: -pair[1])
        return [replace(pose, probability=share) for pose, share in ranked if share]

    def _misfit_by_rays(self, lines: Lines, errors: Array, turn: Array, shift: Array) -> Array:
        """Return the (8, S) px change of the misfit by each of the rays' errors."""
        by_line = measure_misfit(lines, self.side, turn, shift).by_line / np.tile(self._focal, 2)
        return np.asarray((by_line @ errors).reshape(8, -1))

    def _make_pose(
        self, lines: Lines, noise: Array, errors: Array, whiten: Array, turn: Array, shift: Array
    ) -> TagPose:
        """Return a pose with its errors. Its probability is not known yet, and is 1 here."""
        tag_misfit = measure_misfit(lines, self.side, turn, shift)
        # (6, 8): the change of the pose by a misfit, with the opposite sign
        gain = np.linalg.pinv(whiten @ tag_misfit.by_pose) @ whiten
        by_all = np.column_stack(
            [
                self._misfit_by_rays(lines, errors, turn, shift),
                tag_misfit.by_size * self._relative_sigma,
            ]
        )
        off_px = math.sqrt(float((tag_misfit.px**2).sum()) / 4)
        return TagPose(
            turn=turn,
            position=shift,
            noise=gain @ noise @ gain.T,
            shared=-gain @ by_all,
            off_px=off_px,
            probability=1.0,
        )


def _check_covariances(covariances: Array) -> None:
    """Raise InputError where (T, 8, 8) px^2 are not symmetric, or a variance is negative."""
    smallest = np.linalg.eigvalsh(covariances).min(initial=0.0)
    size = 1e-9 + 1e-6 * np.abs(covariances).max(initial=0.0)
    if smallest < -size or (np.abs(covariances - covariances.swapaxes(1, 2)) > size).any():
        raise InputError("covariances are not symmetric with variances of 0 px^2 or more.")
