"""The picture as taken and undistorted: straight lines in space, through a known cover and
undistorted again.
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
from calib.report import strip
from calib.report.board_lines import BoardLine, grid_lines
from calib.report.evidence import Evidence, gather_evidence
from calib.report.straight import DrawnFrame, straight_html
from tests.report.conftest import Reported

Lines = list[np.ndarray]


def paths(html: str, kind: str) -> list[Lines]:
    """Return the lines of each panel, (n, 2) px."""
    outlines = re.findall(rf'<path class="{kind}" d="([^"]*)"', html)
    return [
        [np.array([at.split() for at in line.split("L")], float) for line in path.split("M")[1:]]
        for path in outlines
        if "L" in path
    ]


def most_bent(evidence: Evidence) -> BoardLine:
    lines = [
        line
        for view in range(len(evidence.calibration.views))
        for line in grid_lines(evidence, view)
    ]
    return max(lines, key=lambda line: line.bend)


def test_straight_lines_lie_along_the_rows_of_both_pictures(reported: Reported) -> None:
    """And the pictures are in the page, small."""
    html = straight_html(gather_evidence(reported.calibration), reported.session)
    panels = paths(html, "straight")
    assert [len(lines) for lines in panels] == [18, 18], "nine rows and nine columns"
    labels = re.findall(r'aria-label="([^:"]+)', html)
    assert labels == ["As taken", "Undistorted", "As taken", "Undistorted"]
    assert len(re.findall(r"data:image/jpeg", html)) == 4
    assert "Dots: the detected corners. Stripes: what the camera does not see." in html
    assert len(html) < 300_000


def test_both_pictures_have_the_same_scale_in_the_middle(small_calibration: Calibration) -> None:
    evidence = gather_evidence(small_calibration)
    frame = DrawnFrame.of(evidence, 0.5)
    middle = frame.middle
    steps = 100.0 * np.array([[0, 0], [-1, 0], [1, 0], [0, -1], [0, 1]])
    drawn = frame.place(evidence.field.undistort_pixels(middle + steps, 0.5))
    assert np.abs(drawn[0] - middle).max() < 1e-6
    width, height = np.linalg.norm([drawn[2] - drawn[1], drawn[4] - drawn[3]], axis=-1)
    assert np.sqrt(width * height) == pytest.approx(200, rel=2e-3)
    window = frame.window(820, 616, np.array([4.0, 4.0]))
    corner = np.array(window.corner) + np.array(window.zoom) * [100, 50]
    assert frame.place(corner[None])[0] == pytest.approx([401.5, 201.5])


def test_lines_are_where_the_model_sees_straight_lines_of_the_board(
    small_calibration: Calibration,
) -> None:
    """Against points that are projected onto each row's and column's continuation in space, 6.4 mm
    apart: some 15 px.
    """
    evidence = gather_evidence(small_calibration)
    turn, at = cv2.Rodrigues(small_calibration.poses[0, :3])[0], small_calibration.poses[0, 3:]
    lattice = small_calibration.board.points().reshape(9, 9, 2)
    lines = list(grid_lines(evidence, 0))
    assert len(lines) == 18
    for line, true_line in zip(lines, (*lattice, *lattice.swapaxes(0, 1)), strict=True):
        reach = np.linspace(-0.1, 1.1, 401)[:, None] * (true_line[-1] - true_line[0]) + true_line[0]
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
        ends = small_calibration.project(
            np.column_stack([true_line[[0, -1]], np.zeros(2)]) @ turn.T + at
        )
        assert line.distorted[[0, -1]] == pytest.approx(ends, abs=0.02)


def test_the_drawn_bend_is_the_real_one_times_the_stated_factor(
    small_calibration: Calibration,
) -> None:
    html = straight_html(gather_evidence(small_calibration), None)
    match = re.search(r"the row bends by ([\d.]+) px.*enlarged (\d+) times", html)
    assert match
    bend, factor = float(match[1]), int(match[2])
    (taken,), (undistorted,) = paths(html, "bent")
    middle = strip.HEIGHT / 2 - 0.5
    length = np.ptp(taken[:, 0])
    evidence = gather_evidence(small_calibration)
    chords = [
        float(np.linalg.norm(line.distorted[-1] - line.distorted[0]))
        for view in range(len(small_calibration.views))
        for line in grid_lines(evidence, view)
        if line.bend == pytest.approx(bend, rel=0.05)
    ]
    drawn = float(np.abs(taken[:, 1] - middle).max()) / factor
    assert any(drawn * chord / length == pytest.approx(bend, rel=0.06) for chord in chords)
    assert np.abs(undistorted[:, 1] - middle).max() < 0.2, "written to a tenth of a pixel"


def test_an_edge_along_a_row_is_straight_in_the_undistorted_strip(
    small_calibration: Calibration,
) -> None:
    """The picture is bright on one side of the row, as the model sees it, and dark on the other."""
    evidence = gather_evidence(small_calibration)
    line = most_bent(evidence)
    camera = small_calibration.camera
    start, chord = line.distorted[0], line.distorted[-1] - line.distorted[0]
    offset = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), -1) - start
    steps = offset @ chord / (chord @ chord)
    normal = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
    shape = line.distorted - start
    bent = np.interp(steps, shape @ chord / (chord @ chord), shape @ normal)
    picture = np.clip(np.round(120 - 40 * (offset @ normal - bent)), 40, 200).astype(np.uint8)

    factor = strip._factor(line.bend * strip.Strip(start, chord, 1).scale)
    taken = strip.Strip(start, chord, factor)
    straight = strip.Strip(line.undistorted[0], line.undistorted[-1] - line.undistorted[0], factor)
    bends = []
    for kind, places in (
        (taken, strip._as_taken(line, taken)),
        (straight, strip._undistorted(evidence, line, straight)),
    ):
        x, y = np.moveaxis(places[:, 40:-40].astype(np.float32), -1, 0)
        grey = cv2.remap(picture, x, y, cv2.INTER_LINEAR)
        border = (grey > 120).sum(0) - strip.HEIGHT / 2
        bends.append(np.abs(border).max() / (kind.factor * kind.scale))
    assert line.bend > 0.3
    assert bends[0] == pytest.approx(line.bend, abs=0.05), "px of the picture"
    assert bends[1] < 0.05


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
    without_bend = "Dots: the detected corners, without the bend of the board itself."
    assert without_bend in alternative
    assert without_bend not in first_html
    one_left = float(re.findall("corners of this view are ([\\d.e-]+) px", first_html)[0])
    other_left = float(re.findall("corners of this view are ([\\d.e-]+) px", alternative)[0])
    assert other_left < 0.01, (
        "to first order, as the board's flatness is taken away in undistorted pixels"
    )
    assert one_left > 0.2
