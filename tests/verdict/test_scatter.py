"""Views and corners of the board that scatter more than noise are a reason for care, and the fit
says which view decides.
"""

from dataclasses import replace

import pytest

from calib.calibration import Calibration
from calib.commands import console
from calib.commands.console import print_fit
from calib.corners.view import MISFIT, RejectedPicture
from calib.fit_record.outcome import Uncertainty
from calib.verdict.mixed_settings import misfits
from calib.verdict.scatter import scatter
from calib.verdict.thresholds import SCATTER
from tests.verdict.cases import asked


def with_scatter(calibration: Calibration, views: float, corners: float) -> Calibration:
    uncertainty = Uncertainty(24, max(views, corners, 1.0), views, corners, {"0003.png": 0.31})
    return replace(calibration, outcome=replace(calibration.outcome, uncertainty=uncertainty))


def test_noise_is_no_reason(good: Calibration) -> None:
    assert not asked(scatter, with_scatter(good, 0.99 * SCATTER, 0.99 * SCATTER))
    without = replace(good, outcome=replace(good.outcome, uncertainty=None))
    assert not asked(scatter, without)


def test_each_scatter_is_said_for_what_it_is(good: Calibration) -> None:
    (views,) = asked(scatter, with_scatter(good, 3.2, 1.0))
    assert "views scatter 3.2 times" in views.sentence
    assert views.next.startswith("calib diagnose")
    (corners,) = asked(scatter, with_scatter(good, 1.0, 2.5))
    assert "corners of the board scatter 2.5 times" in corners.sentence


def test_many_views_that_do_not_fit_are_a_reason(good: Calibration) -> None:
    """Unless the pictures' files say what differs."""
    unlike = [RejectedPicture(f"{i}.png", f"its 9 {MISFIT} 0.1 px of the others") for i in range(9)]
    (reason,) = asked(misfits, replace(good, rejected=tuple(unlike)))
    assert reason.sentence.startswith(f"9 of {len(good.views) + 9} views do not fit the others")
    assert not asked(misfits, replace(good, rejected=tuple(unlike[:2])))
    bare = tuple(replace(view, name=f"bare/{view.name}") for view in unlike)
    assert not asked(misfits, replace(good, rejected=bare))
    boards = tuple(RejectedPicture(view.name, "no board was found") for view in unlike)
    assert not asked(misfits, replace(good, rejected=boards))
    mixed = replace(good, outcome=replace(good.outcome, mixed_settings=("two zooms",)))
    assert not asked(misfits, replace(mixed, rejected=tuple(unlike)))


def test_the_fit_explains_maps_that_are_surer_than_the_numbers(
    good: Calibration, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    camera, k = good.camera, good.camera.intrinsics
    assert k
    unsure = replace(k, fx=replace(k.fx, sigma=10.0))
    moved = console.focal_error(replace(good, camera=replace(camera, intrinsics=unsure)))
    assert moved == pytest.approx(10 / k.fx.value * camera.width / 2)
    for error_px in (0.0, moved):
        monkeypatch.setattr(console, "focal_error", lambda _, px=error_px: px)
        print_fit(good, 1.0)
        assert ("less certain than the maps" in capsys.readouterr().out) == (error_px > 0)


def test_the_fit_says_which_view_decides(
    good: Calibration, capsys: pytest.CaptureFixture[str]
) -> None:
    print_fit(with_scatter(good, 1.0, 1.0), 1.0)
    printed = " ".join(capsys.readouterr().out.split())
    assert "in the part of the picture where the board was: " in printed
    assert "Much of the result comes from 0003.png (31 %): more pictures" in printed


def test_the_views_that_decide_are_listed() -> None:
    views = {"0003.png": 0.31, "0011.png": 0.17, "0012.png": 0.11}
    sentence = Uncertainty(24, 1.0, 1.0, 1.0, views).heavy_sentence
    assert "from 0003.png (31 %), 0011.png (17 %) and 0012.png (11 %): more" in sentence
