"""Sentences that are true of the calibration, and a warning where one is due."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calib.diagnosis.requested_effects import with_requested
from calib.fit_record.outcome import CrossValidation
from calib.fit_record.request import Settings
from calib.fitting.corner_range import picture_region
from calib.fitting.declared import Comparison
from calib.fitting.fit import fit
from calib.progress import Silent
from calib.report.evidence import gather_evidence
from calib.report.patterns import (
    CHANCE,
    PATTERN_PROBABILITY,
    GroupMeans,
    over_board,
    over_image,
)
from calib.report.residual_maps import noise_by_distance
from calib.report.scene import side_view, surface_meshes
from calib.report.summary import summarise
from calib.report.tiles import origin
from calib.session.board import Board
from calib.session.session import read_session
from calib.table import change
from calib.verdict.residual import NOT_ALL_NOISE
from calib.verdict.thresholds import FEW_CELLS
from calib.verdict.verdict import Reason, Trust, Verdict
from fixtures.calibrated import with_outcome
from fixtures.synthetic import scene
from tests.optics.shapes import Example, each_shape
from tests.report.conftest import Reported
from tests.report.made import calibrated, report_in
from tests.test_calibration import write_session

FAST = Settings(grid=(5, 5), free=("none",))


class Misprinted(Board):
    """A board whose corners are up to 0.1 mm beside their places, smoothly over the board."""

    def points(self) -> NDArray[np.float64]:
        flat = super().points()
        return flat + 1e-4 * np.sin(2 * np.pi * flat[:, ::-1] / (self.rows * self.square))


def test_a_good_calibration_is_trusted(reported: Reported) -> None:
    summary = summarise(gather_evidence(reported.calibration))
    assert summary.verdict.word is Trust.TRUSTED
    what, remaining, held_out, maps = summary.sentences
    assert "3280x2464 px behind a cone (1.15 mm thick, index 1.5): 45 views of a 9x9 board" in what
    assert ": no more than the corners' noise is left (about 0." in remaining
    assert "the fit does not overfit" in held_out
    assert maps.startswith("You can use maps from 0.")
    assert "The expected error of the maps is 0.1" in maps
    assert re.search(r"\(median over the corners\); the largest is [\d.]+ px at the ", maps)
    assert all(sentence.endswith(".") for sentence in summary.sentences)


def test_the_paragraph_says_what_the_verdict_says(
    reported: Reported, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence = gather_evidence(reported.calibration)
    assert ": no more than the corners' noise" in summarise(evidence).sentences[1]
    doubted = Verdict(
        (Reason(f"{NOT_ALL_NOISE}: it may be board_shape.", "calib diagnose it"),), ""
    )
    monkeypatch.setattr("calib.report.summary.judge", lambda *_, **__: doubted)
    assert ": most of the error is noise" in summarise(evidence).sentences[1]


def test_the_tiles_are_the_numbers_of_the_paragraph(reported: Reported) -> None:
    evidence = gather_evidence(reported.calibration)
    error, maps, coverage, focal = summarise(evidence).tiles  # no number of the cover was fitted
    validation = reported.calibration.outcome.cross_validation
    assert validation
    assert (error.label, error.value) == (
        "error on held-out views",
        f"{validation.held_out_px:.3f} px",
    )
    assert maps.label == f"expected error of the map at {evidence.depths[1]:g} m"
    assert f"{maps.value} at {evidence.depths[1]:g} m" in summarise(evidence).sentences[-1]
    assert coverage.value == f"{100 * evidence.covered:.0f} %"
    intrinsics = reported.calibration.camera.intrinsics
    assert intrinsics
    assert focal.label == "focal length fx"
    assert focal.value == f"{intrinsics.fx.value:.1f} px"
    assert focal.note == "not fitted"


def test_the_noise_by_depth_is_that_of_the_corners(reported: Reported) -> None:
    """The scene adds the same noise of 0.05 px per axis to every corner. A group has 4 or 5 views
    with some 1100 second differences, so its noise is known to 5 %; three times that is allowed.
    """
    distance, noise = noise_by_distance(gather_evidence(reported.calibration))
    assert len(noise) == 10
    assert np.all(np.diff(distance) > 0)
    assert noise == pytest.approx(0.05 * np.sqrt(2), rel=0.15)


@pytest.mark.parametrize(
    ("across", "down", "words"),
    [(0.1, 0.0, "at the top left"), (0.5, 1.0, "at the bottom"), (1.0, 0.5, "at the right edge")],
)
def test_a_place_in_the_picture_has_words(across: float, down: float, words: str) -> None:
    assert picture_region(across, down) == words


def test_the_worst_place_of_the_maps_is_named(reported: Reported) -> None:
    evidence = gather_evidence(reported.calibration)
    _, maps, *_ = summarise(evidence).tiles
    assert maps.note == f"largest {evidence.worst_sigma(evidence.depths[1:2])}"
    assert re.search(r"largest [\d.]+ px at the ", maps.note)


def test_a_change_has_a_sign_unless_it_is_none() -> None:
    assert change(0.5, 1.0) == "-50 %"
    assert change(1.25, 1.0) == "+25 %"
    assert change(0.999, 1.0) == "0 %"


def test_overfitting_is_said(reported: Reported) -> None:
    worse = CrossValidation(folds=3, held_out_px=0.2, fitted_px=0.1)
    summary = summarise(gather_evidence(with_outcome(reported.calibration, cross_validation=worse)))
    assert "On held-out views the error is 0.200 px: the fit overfits." in summary.sentences
    assert "the fit overfits" in [reason.sentence[:16] for reason in summary.verdict.reasons]


@pytest.mark.slow
def test_a_misprinted_board_leaves_a_pattern_over_it(tmp_path: Path) -> None:
    evidence = gather_evidence(
        calibrated(scene(5, views=16, noise=0.05, board=Misprinted(9, 9, 0.020)), tmp_path, FAST)
    )
    assert over_board(evidence).is_pattern
    assert "% of it changes with the place on the board" in str(summarise(evidence).verdict)


@pytest.mark.parametrize(
    ("sigma", "words"), [(0.5, "estimated from the views"), (9.0, "these views do not tell it")]
)
def test_a_tile_says_if_the_views_do_not_tell_its_number(sigma: float, words: str) -> None:
    radius = Comparison("cover.inner_radius", "mm", 50.0, 10.0, 55.0, sigma, unknown=True)
    assert origin(radius) == words


def test_noise_leaves_no_pattern(reported: Reported) -> None:
    evidence = gather_evidence(reported.calibration)
    for means in (over_board(evidence), over_image(evidence)):
        assert not means.is_pattern
        assert means.significant.mean() < 0.05


@pytest.mark.parametrize(
    ("count", "groups", "words"),
    [
        (0, 166, "no pattern (0 of 166 places deviate; noise alone makes 1.7)"),
        (
            3,
            81,
            "no pattern (3 of 81 places deviate; noise alone makes as many in 4",
        ),
        (30, 166, "a pattern (30 of 166 places deviate; noise alone makes 1.7)"),
    ],
)
def test_more_than_chance_is_judged_by_its_probability(count: int, groups: int, words: str) -> None:
    """Oracle: the binomial sum by hand."""
    significant = np.arange(groups) < count
    means = GroupMeans(np.zeros((groups, 2)), np.zeros(groups), significant)
    assert words in means.summary
    less = sum(
        math.comb(groups, fewer) * CHANCE**fewer * (1 - CHANCE) ** (groups - fewer)
        for fewer in range(count)
    )
    assert means.probability == pytest.approx(1 - less, abs=1e-12)
    assert means.is_pattern == (1 - less < PATTERN_PROBABILITY)


def test_what_is_missing_is_asked_for(tmp_path: Path) -> None:
    """Few views, all at one distance."""
    evidence = gather_evidence(
        calibrated(scene(5, views=4, noise=0.05, depths=(1.0, 1.05)), tmp_path, FAST)
    )
    care = str(summarise(evidence).verdict).lower()
    assert "of the picture has corners" in care
    assert "nearer and farther views" in care
    assert evidence.covered < FEW_CELLS


def test_coverage_counts_every_corner(reported: Reported) -> None:
    evidence = gather_evidence(reported.calibration)
    assert evidence.counts.sum() == len(evidence.pixels)
    column, row = (evidence.pixels[0] // [3280 / 16, 2464 / 12]).astype(int)
    assert evidence.counts[row, column] > 0
    assert np.sqrt((evidence.rms_by_view**2).mean()) == pytest.approx(
        reported.calibration.stages[-1].rms_px
    )  # 81 corners in each


@each_shape
def test_every_shape_has_its_report(example: Example, tmp_path: Path) -> None:
    made = scene(3, views=6, noise=0.05, cover=example.cover, patch=example.patch)
    assert 'id="glass"' in report_in(tmp_path, calibrated(made, tmp_path, FAST)).read_text()


@pytest.mark.slow
def test_a_window_that_only_the_diagnosis_knows_is_drawn(tmp_path: Path) -> None:
    session = write_session(tmp_path, scene(7, views=6, noise=0.05))
    document = yaml.safe_load((session / "session.yaml").read_text())
    (session / "session.yaml").write_text(yaml.safe_dump(document | {"cover": {"shape": "none"}}))
    bare = fit(read_session(session), Settings(), Silent())
    evidence = gather_evidence(with_requested(bare, ("flat_port",), Silent()))
    assert len(surface_meshes(evidence)) == 2
    assert side_view(evidence)
