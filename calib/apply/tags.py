"""Where tags are that a calibrated camera sees through its cover: position and rotation, in metres,
with a covariance.

Sigma counts the noise of the corners, as each picture's own pixels tell it, the uncertainty of the
calibration's rays, and how well the side of the tags is known. It does not count a tag that is not
flat. A camera's curve of tones, and ink that spreads, make black look
smaller or larger than it is: that is measured within the tags, and taken off.
"""

from __future__ import annotations

import math
from dataclasses import replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from calib.apply.located_tags import Located, Reason, Tag, TagPose, Unplaced
from calib.apply.map_uncertainty import frames_along, ray_errors
from calib.apply.tag_pose import SQUARE, Lines, misfit, poses
from calib.calibration import Calibration
from calib.corners.detect import eight_bits
from calib.corners.ink_spread import NO_INK_SPREAD, InkSpread, measure_ink_spread, remove_ink_spread
from calib.corners.markers import black_cells, read_markers, size_of_markers
from calib.corners.tag_outline import edge_vectors, measure_outlines
from calib.errors import InputError, brief
from calib.io.array_arguments import numbers, one_of, picture, pixel_rows
from calib.io.numerals import number
from calib.session.coding import DICTIONARIES
from calib.session.tolerances import SQUARE_SIDE
from calib.threads import single_thread

Array = NDArray[np.float64]

LEAST_NOISE = 1e-4
"""px, of a corner's coordinate."""
ROUGH = 0.5
"""px, of the corners of a tag's outline as OpenCV reads it."""
UNLIKELY = 1e-3
"""Of a pose: below it, its corners do not allow it."""
STRANGE = 13.8
"""chi^2 of two degrees of freedom, beyond which one in a thousand tags comes by chance: then sigma
is as wide as the misfit.
"""
FREEDOM = 2
"""Eight coordinates less six of the pose."""
WIDEST = 1e6
"""px^2, of a corner's covariance: a corner that may be anywhere in a picture was not measured."""
OFF = 0.01
"""Of its side in the picture, root mean square: corners that miss a square's by more are of no flat
square.
"""
OFF_PX = 0.5
"""px, the same of small tags."""
UPSIDE_DOWN = "DICT_APRILTAG_"
"""The families of which OpenCV's upper left is the lower right of the makers' (and Kalibr's)
upright tag.
"""
BORDERS = (1, 2)
"""Cells. One is usual; Kalibr prints two."""
LEAST_SIDE, MOST_SIDE = 5e-5, 100.0
"""m"""


class TagLocator:
    """Finds tags of one size and dictionary in the pictures of one camera."""

    def __init__(
        self,
        calibration: Calibration,
        dictionary: str,
        side: float,
        side_sigma: float | None = None,
        border: int = 1,
    ) -> None:
        """
        Args:
            calibration: of the camera.
            dictionary: as OpenCV calls it, such as DICT_APRILTAG_36h11.
            side: m, of the black square.
            side_sigma: m, how well that is known; by default 0.2 % of it.
            border: cells of black around the bits; 2 on Kalibr's boards.

        Raises:
            InputError: there is no such dictionary, or a tag of no such size.
        """
        if not isinstance(dictionary, str) or dictionary not in DICTIONARIES:
            near = get_close_matches(str(dictionary).upper(), DICTIONARIES, 1)
            raise InputError(
                f"{brief(repr(dictionary))} is no dictionary of tags: write"
                f" {near[0] if near else 'DICT_APRILTAG_36h11, say'}."
            )
        side = number(side, "side")
        if not LEAST_SIDE <= side <= MOST_SIDE:
            raise InputError(
                f"a tag of {1000 * side:g} mm will not do: give the side of its black square, from"
                " 0.05 to 100000 mm."
            )
        spread = (
            SQUARE_SIDE.sigma * side if side_sigma is None else number(side_sigma, "side_sigma")
        )
        if not 0 <= spread < side:
            raise InputError(
                f"a standard deviation of {1000 * spread:g} mm will not do: give 0 or more, and"
                " less than the side."
            )
        self.calibration = calibration
        self.dictionary = dictionary
        self.side = side
        self.border = one_of(border, BORDERS, "border")
        self._relative_sigma = spread / side
        self._errors = ray_errors(calibration)
        pinhole = calibration.camera.intrinsics
        assert pinhole
        self._focal = np.array([pinhole.fx.value, pinhole.fy.value])

    def locate(self, grey: NDArray) -> Located:
        """The tags of a (H, W) uint8 or uint16 picture.

        Raises:
            InputError: the picture is of another size than the calibration's.
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
        numbers, rough = read.numbers[order].tolist(), read.corners[order]
        rough = np.roll(rough, 2, 1) if self.dictionary.startswith(UPSIDE_DOWN) else rough
        twice = {number for number in numbers if numbers.count(number) > 1}
        once = [at for at, number in enumerate(numbers) if number not in twice]
        with single_thread():
            found, growth = (
                self._placed(grey, [numbers[at] for at in once], rough[once])
                if once
                else ([], NO_INK_SPREAD)
            )
        unplaced = [
            *(Unplaced(number, Reason.TWICE) for number in sorted(twice)),
            *(one for one in found if isinstance(one, Unplaced)),
        ]
        return Located(tuple(one for one in found if isinstance(one, Tag)), tuple(unplaced), growth)

    def place(self, corners: Array, covariances: Array) -> list[tuple[TagPose, ...] | Reason]:
        """The poses of tags whose corners were measured, by whatever program; the most probable
        first. Or why there is none.

        Args:
            corners: (T, 4, 2) px: upper left, upper right, lower right, lower left of the upright
                tags. NaN where they are not known.
            covariances: (T, 8, 8) px^2, of x and y of the four.
        """
        corners = numbers(corners, (None, 4, 2), "corners")
        covariances = numbers(covariances, (len(corners), 8, 8), "covariances")
        corners = pixel_rows(corners.reshape(-1, 2)).reshape(-1, 4, 2)
        known = np.isfinite(corners).all((1, 2)) & (np.abs(covariances) < WIDEST).all((1, 2))
        _check_covariances(covariances[known])
        found: list[tuple[TagPose, ...] | Reason] = [Reason.NO_EDGES] * len(corners)
        if not known.any():
            return found
        pixels = corners[known].reshape(-1, 2)
        frames = self._frames(corners[known])
        corner_frames = frames if frames is None else np.repeat(frames, 4, 0)
        lines = Lines.of(self.calibration, pixels, corner_frames)
        errors = self._errors(pixels, corner_frames).reshape(int(known.sum()), 4, 4, -1)
        for row, at in enumerate(np.flatnonzero(known).tolist()):
            own = lines.some(slice(4 * row, 4 * row + 4))
            if not own.seen:
                found[at] = Reason.NO_RAY
                continue
            ways = tuple(
                self._poses(own, covariances[at] + LEAST_NOISE**2 * np.eye(8), errors[row])
            )
            limit = max(
                OFF_PX,
                OFF
                * float(np.linalg.norm(np.roll(corners[at], 1, 0) - corners[at], axis=-1).mean()),
            )
            if frames is not None:
                ways = tuple(pose.rotate(frames[row].T) for pose in ways)
            found[at] = ways if ways and ways[0].off_px <= limit else Reason.NO_SQUARE
        return found

    def _frames(self, corners: Array) -> Array | None:
        """Return (T, 3, 3) rotations from the camera frame to frames that look at the tags with
        (T, 4, 2) px corners. Return None unless the lens is wide: the camera frame does for all
        tags of other lenses.
        """
        if not self.calibration.model()[0].lens.wide:
            return None
        _, directions = self.calibration.rays(corners.reshape(-1, 2))
        middle = directions.reshape(-1, 4, 3).sum(1)
        return frames_along(middle / np.linalg.norm(middle, axis=-1, keepdims=True))

    def _placed(
        self, grey: NDArray, numbers: list[int], rough: Array
    ) -> tuple[list[Tag | Unplaced], InkSpread]:
        outlines = measure_outlines(
            grey, rough, size_of_markers(self.dictionary, self.border), self._bends(rough)
        )
        known = np.isfinite(outlines.corners).all((1, 2))
        growth = measure_ink_spread(
            grey,
            outlines.corners[known],
            [self._black(number) for number in np.array(numbers)[known].tolist()],
        )
        if growth.is_significant:
            outlines = remove_ink_spread(growth, outlines)
        both = zip(
            numbers,
            outlines.corners,
            self.place(outlines.corners, outlines.covariances),
            strict=True,
        )
        found = [
            Unplaced(number, ways) if isinstance(ways, Reason) else Tag(number, own, ways)
            for number, own, ways in both
        ]
        return found, growth if growth.is_significant else NO_INK_SPREAD

    def _black(self, number: int) -> NDArray[np.bool_]:
        """(n, n) cells of the upright tag."""
        cells = black_cells(self.dictionary, number, self.border)
        return cells[::-1, ::-1] if self.dictionary.startswith(UPSIDE_DOWN) else cells

    def _bends(self, rough: Array) -> Array:
        """(T, 4) px, by how much the middles of the edges lie outside of the straight lines between
        their ends, from (T, 4, 2) rough corners; 0 where that cannot be said.
        """
        frames = self._frames(rough)
        corner_frames = frames if frames is None else np.repeat(frames, 4, 0)
        lines = Lines.of(self.calibration, rough.reshape(-1, 2), corner_frames)
        bends = np.zeros(rough.shape[:2])
        placed = {}
        for at in range(len(rough)):
            own = lines.some(slice(4 * at, 4 * at + 4))
            if own.seen and (found := poses(own, self.side, np.eye(8) / ROUGH)):
                placed[at] = found[0]
        if not placed:
            return bends
        middles = (SQUARE + np.roll(SQUARE, -1, 0)) / 2
        points = [
            (self.side * np.concatenate([SQUARE, middles]) @ turn.T + shift)
            @ (np.eye(3) if frames is None else frames[at])
            for at, (turn, shift, _) in placed.items()
        ]
        seen = self.calibration.project(np.concatenate(points)).reshape(len(placed), 2, 4, 2)
        corners, middle = seen[:, 0], seen[:, 1]
        steps, normals = edge_vectors(corners)
        along = 2 * ((middle - corners) * steps).sum(-1) / (steps**2).sum(-1) - 1
        bends[list(placed)] = np.nan_to_num(((middle - corners) * normals).sum(-1) / (1 - along**2))
        return bends

    def _poses(self, lines: Lines, noise: Array, errors: Array) -> list[TagPose]:
        """All poses that (8, 8) px^2 of corners and (4, 4, S) errors of their A (px) and B (px m)
        allow.
        """
        rough = poses(lines, self.side, np.linalg.inv(np.linalg.cholesky(noise)))
        if not rough:
            return []
        by_rays = self._by_rays(lines, errors, *rough[0][:2])
        whiten = np.linalg.inv(np.linalg.cholesky(noise + by_rays @ by_rays.T))
        every = poses(lines, self.side, whiten)
        if not every:
            return []
        grown = every[0][2] / FREEDOM if every[0][2] > STRANGE else 1.0
        made = [
            self._pose(lines, noise * grown, errors, whiten, turn, shift)
            for turn, shift, _ in every
        ]
        spreads = [np.linalg.slogdet(one.covariance)[1] / 2 for one in made]
        weights = np.array(
            [
                spread - cost / (2 * grown)
                for spread, (_, _, cost) in zip(spreads, every, strict=True)
            ]
        )
        odds = np.exp(weights - weights.max())
        odds[odds < UNLIKELY] = 0.0
        shares = odds / odds.sum()
        ranked = sorted(zip(made, shares.tolist(), strict=True), key=lambda pair: -pair[1])
        return [replace(one, probability=share) for one, share in ranked if share]

    def _by_rays(self, lines: Lines, errors: Array, turn: Array, shift: Array) -> Array:
        """(8, S) px of misfit, for each of the rays' errors."""
        by_line = misfit(lines, self.side, turn, shift).by_line / np.tile(self._focal, 2)
        return np.asarray((by_line @ errors).reshape(8, -1))

    def _pose(
        self, lines: Lines, noise: Array, errors: Array, whiten: Array, turn: Array, shift: Array
    ) -> TagPose:
        here = misfit(lines, self.side, turn, shift)
        gain = (
            np.linalg.pinv(whiten @ here.by_pose) @ whiten
        )  # (6, 8): what a misfit moves the pose by, less its sign
        by_all = np.column_stack(
            [self._by_rays(lines, errors, turn, shift), here.by_size * self._relative_sigma]
        )
        off = math.sqrt(float((here.px**2).sum()) / 4)
        return TagPose(turn, shift, gain @ noise @ gain.T, -gain @ by_all, off, 1.0)


def _check_covariances(covariances: Array) -> None:
    """Raise InputError where (T, 8, 8) px^2 are not symmetric, or a variance is negative."""
    least = np.linalg.eigvalsh(covariances).min(initial=0.0)
    size = 1e-9 + 1e-6 * np.abs(covariances).max(initial=0.0)
    if least < -size or (np.abs(covariances - covariances.swapaxes(1, 2)) > size).any():
        raise InputError("covariances are not symmetric with variances of 0 px^2 or more.")
