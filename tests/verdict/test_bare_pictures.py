"""Pictures in bare/ that were taken with the cover on, or without it, of sessions whose truth is
known.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.calibration_content import Stage
from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.session import read_session, session_to_yaml
from calib.verdict.bare_pictures import bare_pictures
from calib.verdict.cover_stage import cover_stage, worse_than_none
from calib.verdict.judge import judge
from calib.verdict.thresholds import EXPLAINED, WORSE_THAN_BARE
from calib.verdict.verdict import Trust
from fixtures.calibrated import with_outcome
from fixtures.synthetic import (
    HEIGHT,
    INTRINSICS,
    WIDTH,
    Scene,
    bare_views,
    misdeclared,
    paper_cone,
    scene,
)
from tests.verdict.cases import asked

NOISE = 0.05
HELD = Settings(grid=(4, 4), free=("none",))


def covered(thickness: float) -> Scene:
    return scene(11, views=16, noise=NOISE, depths=(0.35, 1.2), cover=paper_cone(thickness))


def with_bare(
    folder: Path, made: Scene, bare: tuple[View, ...], cover: Cover, settings: Settings = HELD
) -> Calibration:
    for place, described, views in (
        (folder, cover, made.views),
        (folder / "bare", Cover("none", {}), bare),
    ):
        place.mkdir()
        document = session_to_yaml(made.board, Camera(WIDTH, HEIGHT), described)
        (place / "session.yaml").write_text(
            yaml.safe_dump({"format": 1, **document, "corners": "corners.vnl"})
        )
        write_corners(place / "corners.vnl", views)
    return fit(read_session(folder), settings)


@pytest.mark.parametrize(
    ("thickness", "settings"),
    [(0.003, HELD), (0.00115, Settings(grid=(4, 4)))],
    ids=["held", "as by default"],
)
@pytest.mark.slow
def test_a_bare_that_was_taken_through_the_cover_is_told(
    tmp_path: Path, thickness: float, settings: Settings
) -> None:
    through = scene(12, views=8, noise=NOISE, depths=(0.3, 0.9), cover=paper_cone(thickness)).views
    calibration = with_bare(
        tmp_path / "s", covered(thickness), through, paper_cone(thickness), settings
    )
    first = judge(calibration).reasons[0]
    assert first.word is Trust.CARE
    assert first.sentence.startswith("the camera alone explains the pictures through the cover (0.")
    assert "taken with the cover on?" in first.sentence
    assert first.next.startswith("capture ")
    assert not asked(worse_than_none, calibration), "of which this is the cause"
    assert not asked(cover_stage, calibration)


@pytest.mark.slow
@pytest.mark.parametrize("thickness", [0.00115, 0.003])
def test_a_true_bare_is_not_doubted_whatever_the_cover_is_off_by(
    tmp_path: Path, thickness: float
) -> None:
    """The numbers of the cover are drawn from their tolerances."""
    made, bare = covered(thickness), bare_views(3, 8, NOISE)
    assert not asked(bare_pictures, with_bare(tmp_path / "as it is", made, bare, made.cover))
    for seed in range(4):
        _, cover = misdeclared(np.random.default_rng(seed), INTRINSICS, made.cover)
        stated = replace(
            cover,
            parameters={
                name: replace(number, sigma=0.0) for name, number in cover.parameters.items()
            },
        )
        assert not asked(bare_pictures, with_bare(tmp_path / str(seed), made, bare, stated)), (
            f"seed {seed}"
        )


@pytest.mark.parametrize(
    ("alone", "cover", "doubted"),
    [(0.99, 1.01, True), (1.01, 1.01, False), (0.99, 0.99, False)],
    ids=["both", "more than noise", "no worse by much"],
)
def test_from_where_on(good: Calibration, alone: float, cover: float, doubted: bool) -> None:
    noise = good.noise_px
    assert noise
    bare = alone * EXPLAINED * noise
    errors = {"pinhole": bare, "cover": cover * WORSE_THAN_BARE * bare, "cover+rbf": noise}
    staged = replace(good, stages=tuple(Stage(name, rms, 0.0) for name, rms in errors.items()))
    from_bare = with_outcome(staged, intrinsics_from="bare")
    assert bool(asked(bare_pictures, from_bare)) is doubted
    assert not asked(bare_pictures, staged), "the lens is the session's"
