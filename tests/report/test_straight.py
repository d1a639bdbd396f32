"""The picture before and after: straight lines in space, through a known cover and undistorted
again.
"""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch

from calib.calibration import Calibration
from calib.calibration_content import AddedEffect
from calib.effects.board_shape import BoardShape
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.report.evidence import gather_evidence
from calib.report.straight import lines_across, straight_html
from tests.report.conftest import Reported

Lines = list[np.ndarray]


def paths(html: str, kind: str) -> list[Lines]:
    """Return the lines of each panel, (n, 2) px."""
    outlines = re.findall(rf'<path class="{kind}" d="([^"]*)"', html)
    return [
        [np.array([at.split() for at in line.split("L")], float) for line in path.split("M")[1:]]
        for path in outlines
    ]


def most_bent(lines: Lines) -> float:
    """px from the chord between the ends."""
    worst = []
    for line in lines:
        direction = (line[-1] - line[0]) / np.linalg.norm(line[-1] - line[0])
        worst.append(np.abs((line - line[0]) @ [-direction[1], direction[0]]).max())
    return float(max(worst))


def test_lines_that_bend_become_straight(reported: Reported) -> None:
    """And the pictures are in the page, small."""
    html = straight_html(gather_evidence(reported.calibration), reported.session)
    bent, straight = paths(html, "bent")
    assert len(bent) == len(straight) == 18, "nine rows and nine columns"
    assert most_bent(bent) > 50, "of 3280 px: to be seen"
    assert most_bent(straight) < 0.2, "places are written to a tenth of a pixel"
    assert re.findall(r'aria-label="([^:"]+)', html) == ["As taken", "Undistorted"]
    assert len(re.findall(r"data:image/jpeg", html)) == 2
    assert "Stripes: what the camera does not see." in html
    assert len(html) < 300_000


def test_lines_are_where_the_model_sees_straight_lines_of_the_board(
    small_calibration: Calibration,
) -> None:
    """Against points that are projected onto each row's and column's continuation in space, 6.4 mm
    apart: some 15 px.
    """
    evidence = gather_evidence(small_calibration)
    turn, at = cv2.Rodrigues(small_calibration.poses[0, :3])[0], small_calibration.poses[0, 3:]
    lattice = small_calibration.board.points().reshape(9, 9, 2)
    lines = list(lines_across(evidence, 0))
    assert len(lines) == 18
    for line, true_line in zip(lines, (*lattice, *lattice.swapaxes(0, 1)), strict=True):
        reach = np.linspace(-8, 8, 401)[:, None] * (true_line[-1] - true_line[0]) + true_line[0]
        pixels = small_calibration.project(
            np.column_stack([reach, np.zeros(len(reach))]) @ turn.T + at
        )
        pixels = pixels[np.isfinite(pixels).all(-1)]
        for point in line.distorted:
            first, second = pixels[np.sort(np.linalg.norm(pixels - point, axis=-1).argsort()[:2])]
            step = (second - first) / np.linalg.norm(second - first)
            assert abs((point - first) @ [-step[1], step[0]]) < 0.02, (
                "the field's splines keep 0.002 px"
            )
        assert np.ptp(line.distorted, 0).max() > 1500, "across the picture"


def test_the_drawn_bend_is_the_real_one_times_the_stated_factor(
    small_calibration: Calibration,
) -> None:
    html = straight_html(gather_evidence(small_calibration), None)
    match = re.search(r"bend by up to ([\d.]+) px.*enlarged (\d+) times", html)
    assert match
    bend, factor = float(match[1]), int(match[2])
    (bent, _), (straight, _) = paths(html, "bent"), paths(html, "straight")
    worst = 0.0
    for drawn, ends in zip(bent, straight, strict=True):
        direction = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        worst = max(worst, float(np.abs((drawn - ends[0]) @ [-direction[1], direction[0]]).max()))
    assert worst == pytest.approx(factor * bend, rel=0.05), "the bend is said with two digits"


def test_corners_lie_on_their_lines(small_calibration: Calibration) -> None:
    """Corners with 0.05 px of noise, undistorted: beside straight lines by about as much, and by
    more if the cover is forgotten.
    """
    match = re.search(
        r"corners of this view are ([\d.]+) px \(RMS\) off straight lines",
        straight_html(gather_evidence(small_calibration), None),
    )
    assert match
    assert 0.01 < float(match[1]) < 0.06
    forgot = replace(
        small_calibration,
        amplitudes=3e-5 * np.random.default_rng(1).normal(size=small_calibration.amplitudes.shape),
    )
    worse = re.search(
        r"corners of this view are ([\d.]+) px \(RMS\) off straight lines",
        straight_html(gather_evidence(forgot), None),
    )
    assert worse
    assert float(worse[1]) > 3 * float(match[1])


def test_a_known_bow_does_not_bend_the_lines(small_calibration: Calibration) -> None:
    """Corners of a board with 2 mm of bow, without noise: what the model knows of the board is not
    the lens's fault.
    """
    shape = {"xx": 2e-3, "xy": 5e-4, "yy": -1e-3}
    figures = {
        f"board_shape.{term}": (np.array(size), np.array(1e-5)) for term, size in shape.items()
    }
    described = replace(
        small_calibration,
        effects=(AddedEffect(BoardShape(0.08, 0.08), figures),),
        covariance=np.zeros((0, 0)),
    )
    path, values = described.model()
    points, poses = (
        torch.from_numpy(small_calibration.board.points()),
        torch.from_numpy(small_calibration.poses),
    )
    corners = [
        project(
            path, values, path.place(points, values, pose.expand(len(points), 6), MIDDLE), MIDDLE
        ).numpy()
        for pose in poses
    ]
    described = replace(
        described,
        views=tuple(
            replace(view, corners=seen)
            for view, seen in zip(small_calibration.views, corners, strict=True)
        ),
    )
    first_html = straight_html(gather_evidence(replace(described, effects=())), None)
    alternative = straight_html(gather_evidence(described), None)
    one_left = float(re.findall("corners of this view are ([\\d.e-]+) px", first_html)[0])
    other_left = float(re.findall("corners of this view are ([\\d.e-]+) px", alternative)[0])
    assert other_left < 0.01, (
        "to first order, as the board's flatness is taken away in undistorted pixels"
    )
    assert one_left > 0.2
