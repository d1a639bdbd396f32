"""Sessions that are well formed and still give no calibration, or not all of it."""

from collections import Counter
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.commands.console import TITLE_WIDTH
from calib.corners.view import View
from calib.diagnosis.diagnose import diagnose
from calib.errors import InputError, NotEnoughDataError
from calib.estimation import joint_fit
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views, session_of_pictures
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.progress import Advance, Silent
from calib.session.session import read_session
from calib.verdict.judge import judge
from calib.verdict.verdict import Trust
from fixtures.calibrated import with_outcome
from fixtures.known import known
from fixtures.synthetic import INTRINSICS, Scene, scene
from tests.session.malformed import write_good_session
from tests.test_calibration import write_session

SHORT = Settings(grid=(4, 4))


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(21, views=6, noise=0.05)


def spoiled(folder: Path, made: Scene, **changes: object) -> Path:
    """The session with some keys of session.yaml changed, `camera__intrinsics=None` dropping
    one.
    """
    write_session(folder, made)
    document = yaml.safe_load((folder / "session.yaml").read_text())
    for name, value in changes.items():
        top, _, key = name.partition("__")
        document[top].pop(key, None) if value is None else document[top].update({key: value})
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    return folder


def fitted(folder: Path) -> Calibration:
    return fit(read_session(folder), SHORT, Silent())


def test_a_view_whose_corners_lie_on_one_line_is_listed(made: Scene, tmp_path: Path) -> None:
    line = np.arange(81) < 9
    view = made.views[2]
    thin = View(view.name, np.where(line[:, None], view.corners, np.nan), np.where(line, 1.0, 0.0))
    result = fitted(write_session(tmp_path, made, (*made.views[:2], thin, *made.views[3:])))
    assert [(r.name, "lie on one line" in r.reason) for r in result.rejected] == [(view.name, True)]


def test_a_fit_knows_when_each_view_was_taken_and_of_which_pose(
    made: Scene, tmp_path: Path
) -> None:
    """From frames.csv, whose rows come in any order; and it still knows after it was saved and its
    session is gone.
    """
    folder = write_session(tmp_path / "session", made)
    rows = [
        f"frames/{view.name},{100 + index / 2},{index // 2}"
        for index, view in enumerate(made.views[:-1])
    ]
    (folder / "frames.csv").write_text("\n".join(["file,time_s,view", *reversed(rows)]))
    result = fitted(folder)
    path = result.save(tmp_path / "out")
    folder.rename(tmp_path / "elsewhere")
    for calibration in (result, Calibration.load(path)):
        assert [view.time_s for view in calibration.views] == [
            100.0,
            100.5,
            101.0,
            101.5,
            102.0,
            None,
        ]
        assert [view.pose_id for view in calibration.views] == ["0", "0", "1", "1", "2", None]
        assert calibration.request.session == str(folder)


def test_every_picture_is_decoded_once_and_never_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_good_session(tmp_path)
    decoded = Counter[str]()

    def counting(data: NDArray[np.uint8], flags: int) -> object:
        decoded[sha256(data.tobytes()).hexdigest()] += 1
        return decode(data, flags)

    decode = cv2.imdecode
    monkeypatch.setattr(cv2, "imdecode", counting)
    assert len(read_views(read_session(folder), Silent())[0]) == 3
    assert sorted(decoded.values()) == [1, 1, 1]
    assert len(read_views(read_session(folder), Silent())[0]) == 3
    assert sorted(decoded.values()) == [1, 1, 1]


def test_a_table_of_other_pictures_is_listed(made: Scene, tmp_path: Path) -> None:
    folder = write_session(tmp_path, made)
    table = folder / "frames.csv"
    table.write_text("file,time_s\nelsewhere.png,1.5\n")
    views, rejected = read_views(read_session(folder), Silent())
    assert len(views) == len(made.views)
    assert [picture.name for picture in rejected] == ["frames.csv"]
    assert "names none of the pictures" in rejected[0].reason
    table.write_text(f"file,time_s\nelsewhere.png,1.5\n{views[0].name},2.5\n")
    assert read_views(read_session(folder), Silent())[1] == ()


def test_an_invalid_time_is_refused(made: Scene, tmp_path: Path) -> None:
    folder = write_session(tmp_path, made)
    (folder / "frames.csv").write_text("file,time_s,view\n0000.png,,\n0001.png,noon,0\n")
    says = (
        r"frames.csv: time_s of 0001.png is 'noon': write seconds, such as 12.5, less than 1e\+10,"
        r" or leave it empty\."
    )
    with pytest.raises(InputError, match=says):
        fitted(folder)


@pytest.mark.slow
def test_folds_keep_a_burst_together(made: Scene, tmp_path: Path) -> None:
    """Six views of three poses, each pose twice: with three folds every view is held out beside its
    double, so the error is that of a fit to the other two poses, made here by hand.
    """
    folder = write_session(tmp_path, made)
    rows = [f"{view.name},{index},{index % 3}" for index, view in enumerate(made.views)]
    (folder / "frames.csv").write_text("\n".join(["file,time_s,view", *rows]))
    result = fit(read_session(folder), replace(SHORT, folds=3, free=("none",)), Silent())
    setup = Setup(made.board, result.camera, INTRINSICS, made.cover)
    squares = []
    for pose in range(3):
        training_views = [
            view for index, view in enumerate(made.views) if (index % 3 == pose) is False
        ]
        held_out_views = [
            view for index, view in enumerate(made.views) if (index % 3 == pose) is True
        ]
        outcome = fit_stages(setup, Observations.of(training_views, made.board), SHORT, Silent())
        test = Observations.of(held_out_views, made.board)
        poses = pinhole_poses(outcome.path, outcome.values, test)
        squares.append(refit_poses(outcome.path, outcome.values, test, poses)[1].rms_px ** 2)
    validation = result.outcome.cross_validation
    assert validation
    assert validation.held_out_px == pytest.approx(
        np.mean(squares) ** 0.5, rel=1e-6
    )  # 81 corners each
    sigma = (
        np.std(squares, ddof=1) / 3**0.5 / (2 * np.mean(squares) ** 0.5)
    )  # three poses, so three independent squares
    assert validation.held_out_sigma_px == pytest.approx(sigma, rel=1e-6)
    with pytest.raises(
        NotEnoughDataError, match=r"4 folds need as many poses .* 6 views of 3 poses"
    ):
        fit(read_session(folder), replace(SHORT, folds=4), Silent())


def test_corners_outside_the_picture_are_refused(made: Scene, tmp_path: Path) -> None:
    view = made.views[0]
    far = View(view.name, view.corners * 3, view.weight)
    with pytest.raises(
        InputError, match=r"0000.png has a corner at .* outside the camera's 3280x2464 px"
    ):
        fitted(write_session(tmp_path, made, (far, *made.views[1:])))


def test_a_bare_camera_seen_from_one_angle_is_refused(made: Scene, tmp_path: Path) -> None:
    folder = spoiled(tmp_path, made, camera__intrinsics=None, camera__lens_coefficients=0)
    document = yaml.safe_load((folder / "session.yaml").read_text())
    (folder / "session.yaml").write_text(yaml.safe_dump({**document, "cover": {"shape": "none"}}))
    rng = np.random.default_rng(0)
    same = tuple(
        View(
            f"{i}.png",
            made.views[0].corners + 2 * i + rng.normal(0, 0.05, (81, 2)),
            made.views[0].weight,
        )
        for i in range(6)
    )
    from calib.corners.corners_file import write_corners

    write_corners(folder / "corners.vnl", same)
    with pytest.raises(NotEnoughDataError, match="at the same angle"):
        fitted(folder)


def test_a_cover_through_which_no_board_is_visible_is_refused(made: Scene, tmp_path: Path) -> None:
    """A square that is given in centimetres puts the boards inside the glass."""
    with pytest.raises(NotEnoughDataError, match=r"check the cover's numbers, outside_index"):
        fitted(spoiled(tmp_path, made, board__square_mm=0.1))


def test_a_cover_that_makes_things_worse_is_remarked_on(made: Scene, tmp_path: Path) -> None:
    good = judge(fitted(write_session(tmp_path / "good", made)))
    assert "larger than no cover" not in str(good)
    held = replace(SHORT, free=("none",))
    worse = judge(
        fit(
            read_session(spoiled(tmp_path / "worse", made, cover__outside_index=1.333)),
            held,
            Silent(),
        )
    )
    assert "makes the error larger than no cover" in str(worse)


def test_a_number_with_a_sigma_is_estimated(made: Scene, tmp_path: Path) -> None:
    folder = spoiled(
        tmp_path,
        made,
        camera__intrinsics={
            "fx": {"value": 2570.0, "sigma": 30.0},
            "fy": 2558.36,
            "cx": 1666.03,
            "cy": 1273.65,
        },
    )
    result = fit(read_session(folder), replace(SHORT, free=("none",)), Silent())
    assert result.camera.intrinsics
    assert result.camera.intrinsics.fx.value != 2570.0
    assert 0 < result.camera.intrinsics.fx.sigma < 30
    assert result.camera.intrinsics.fy == INTRINSICS.fy
    assert result.covariance.shape == (17, 17)


def test_a_fit_that_is_not_finite_is_reported_and_keeps_no_covariance(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The residuals' squares over a noise of 1e-300 px overflow; a reader refuses such a noise, so
    another is written.
    """
    monkeypatch.setattr(joint_fit, "FIRST_SIGMA", 1e-300)
    free = {"fx": {"value": 2570.0, "sigma": 30.0}, "fy": 2558.36, "cx": 1666.03, "cy": 1273.65}
    result = fitted(spoiled(tmp_path, scene(21, views=10, noise=0.05), camera__intrinsics=free))
    assert judge(result).word is Trust.DO_NOT_USE
    joint = result.outcome.joint
    assert joint
    finite = with_outcome(result, joint=replace(joint, sigma_px=0.1))
    read = Calibration.load(finite.save(tmp_path))
    assert read.covariance.size == 0
    assert Outcome.NOT_FINITE.value in str(judge(read))
    assert read.camera.intrinsics
    assert read.camera.intrinsics.fx.sigma == 30.0, "no better known than was stated"
    with pytest.raises(NotEnoughDataError, match="not finite"):
        diagnose(read, Silent())


class Tasks(Silent):
    """The titles of the bars."""

    def __init__(self) -> None:
        self.titles: list[str] = []

    def task(self, title: str, total: int) -> Advance:
        self.titles.append(title)
        return super().task(title, total)


@pytest.mark.slow
def test_the_fits_of_a_session_are_distinguished(tmp_path: Path) -> None:
    """A radius so wrong that it is first believed, then held, then doubted, or the axis's distance
    in its place: the views show the glass's distance, which is the sum of the two. And a view that
    is left out.
    """
    tasks, ten = Tasks(), scene(21, views=10, noise=0.05)
    wrong = spoiled(tmp_path / "radius", ten, cover__inner_radius_mm=60.0)
    verdict = fit(read_session(wrong), SHORT, tasks).verdict
    assert tasks.titles[:2] == ["Joint fit", "Uneven glass, roughly"]
    assert "Fit, as declared" in tasks.titles
    assert tasks.titles[-1] in ("Uneven, free radius", "Uneven, free offset.z")
    assert max(map(len, tasks.titles)) <= TITLE_WIDTH
    assert set(verdict.reasons[0].suspects) == {"cover.inner_radius", "cover.axis_offset.z"}
    last = ten.views[-1]
    swapped = last.corners.reshape(9, 9, 2)[[1, 0, *range(2, 9)]].reshape(
        81, 2
    )  # two rows taken for each other
    second_progress, held = Tasks(), replace(SHORT, free=("none",))
    fit(
        read_session(
            write_session(tmp_path / "view", ten, (*ten.views[:-1], replace(last, corners=swapped)))
        ),
        held,
        second_progress,
    )
    assert list(dict.fromkeys(second_progress.titles)) == [
        "Joint fit",
        "Uneven glass, roughly",
        "Uneven glass",
        "Fit, 1 view fewer",
        "Uneven, 1 view fewer",
    ]


def test_copies_strays_and_foreign_files_of_a_session_are_listed(tmp_path: Path) -> None:
    folder = write_good_session(tmp_path)
    frames = sorted((folder / "frames").glob("0*"))
    (folder / "frames" / "copy.png").write_bytes(frames[0].read_bytes())
    (folder / "frames" / "IMG_1.HEIC").write_bytes(b"\0" * 20)
    height, width = cv2.imread(str(frames[0])).shape[:2]  # type: ignore[union-attr]
    stray = np.zeros((height + 1, width + 1), np.uint8)
    cv2.imwrite(str(folder / "frames" / "stray.png"), stray)
    for _ in range(2):  # found, then stored
        views, rejected = read_views(read_session(folder), Silent())
        assert [view.name for view in views] == [path.name for path in frames]
        reasons = {picture.name: picture.reason for picture in rejected}
        assert reasons.keys() == {"copy.png", "stray.png", "IMG_1.HEIC"}
        assert reasons["copy.png"].startswith(f"a copy of {frames[0].name}")
        assert f"{width + 1}x{height + 1} px where" in reasons["stray.png"]
        assert "type is not read" in reasons["IMG_1.HEIC"]
    for number in range(4):
        cv2.imwrite(str(folder / "frames" / f"stray{number}.png"), stray)
    with pytest.raises(
        InputError, match=r"stray0?\.png is .*, and too few pictures have that size: correct"
    ):
        read_views(read_session(folder), Silent())


def test_files_beside_a_picture_that_was_named_are_not_listed(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((240, 320), np.uint8))
    (tmp_path / "b.heic").touch()
    calibration = known(scene(1, views=1), 320, 240)
    *_, beside = session_of_pictures([tmp_path / "a.png"], calibration)
    *_, inside = session_of_pictures([tmp_path], calibration)
    assert not beside
    assert [picture.name for picture in inside] == ["b.heic"]


def test_pictures_of_two_states_are_told(made: Scene, tmp_path: Path) -> None:
    """By their names and by frames.csv; a picture that was not used says nothing."""
    names = [f"{side}-{i}.png" for side in ("left", "right") for i in range(3)]
    views = tuple(replace(v, name=n) for v, n in zip(made.views, names, strict=True))
    folder = write_session(tmp_path, made, views)
    rows = [f"{name},,,,{position}" for name, position in zip(names, "111123", strict=True)]
    (folder / "frames.csv").write_text(
        "\n".join(["file,time_s,sequence,view,lens_position", *rows, "gone.png,,,,7"]) + "\n"
    )
    calibration = fitted(folder)
    by_name, by_position = calibration.outcome.mixed_settings
    assert "fall into left* and right*, as those of 2 cameras do" in by_name
    assert "lens position that their files state: 1 in 4 of them, 2 in right-1.png, 3 in" in (
        by_position
    )
    path = calibration.save(tmp_path / "out")
    assert Calibration.load(path).outcome.mixed_settings == (by_name, by_position)
    reasons = judge(calibration).reasons
    assert [reason.sentence for reason in reasons][:2] == [by_name, by_position]
    assert reasons[0].word is Trust.CARE
