"""A fleet's own prior, from calibrations to a session that names it."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.cli import main
from calib.corners.corners_file import read_corners, write_corners
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.surface_prior import expected_amplitudes
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.fleet.identity import FleetOptions, Identity
from calib.fleet.manifest import Entry
from calib.fleet.prior import estimate_fleet_prior
from calib.fleet.result import JobState, Result, read_result
from calib.inference.calibration_model import base_model
from calib.session.fleet_prior import read_fleet_prior
from calib.session.numbers import numbers_of
from calib.session.session import read_session
from calib.threads import single_thread
from calib.verdict.judge import judge
from fixtures.fleet import Line, true_scene, write_session
from fixtures.map_errors import motions, rays_of, seen_at
from fixtures.synthetic import HEIGHT, WIDTH

pytestmark = pytest.mark.slow

SETTINGS = Settings(grid=(6, 6))
LINE = Line(cameras=7, views=12, broken=("focus",))
BROKEN = next(number for number in range(LINE.cameras) if LINE.fault(number))
NEW = Line(cameras=1, views=6, broken=(), seed=7)
ANOTHER = Line(cameras=1, views=6, broken=("focus",) * 2, seed=7)


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven cameras, one of which is refocused."""
    folder = tmp_path_factory.mktemp("fleet")
    for number in range(LINE.cameras):
        name = LINE.name(number)
        write_session(folder / "sessions" / name, LINE, number)
        fit(read_session(folder / "sessions" / name), SETTINGS).save(folder / "cameras" / name)
        written = (f"cameras/{name}/calibration.yaml",)
        Result(name, JobState.CALIBRATED, verdict={"word": "care"}, written=written).write(folder)
    return folder


@pytest.fixture(scope="module")
def prior(fleet: Path) -> Path:
    assert main(["fleet-prior", str(fleet), "-o", str(fleet / "prior.yaml")]) == 0
    return fleet / "prior.yaml"


def copied(fleet: Path, folder: Path) -> Path:
    shutil.copytree(fleet / "cameras", folder / "cameras")
    return folder


def named(folder: Path, line: Line, views: int, prior: Path | None) -> Path:
    """A session of the line's only camera, with so many views."""
    write_session(folder, line, 0)
    file = folder / "session.yaml"
    document = yaml.safe_load(file.read_text())
    write_corners(folder / "corners.vnl", read_corners(folder / "corners.vnl", line.board)[:views])
    file.write_text(yaml.safe_dump(document | ({"prior": str(prior)} if prior else {})))
    return folder


def map_error(line: Line, calibration: Calibration) -> float:
    """px RMS of the undistorted position at 0.5 m, across the picture, after the rigid motion that
    fits best.
    """
    made = true_scene(line, 0)
    x, y = np.meshgrid(np.linspace(200, WIDTH - 200, 9), np.linspace(200, HEIGHT - 200, 7))
    pixels = np.stack([x, y], -1).reshape(-1, 2)
    ours, true = calibration.rays(pixels), rays_of(made.path, made.values, pixels)
    depth = np.full(len(pixels), 0.5)
    error, moved = (seen_at(*true, depth) - seen_at(*ours, depth)).ravel(), motions(*ours, depth)
    remainder = error - moved @ np.linalg.lstsq(moved, error, rcond=None)[0]
    return float(np.sqrt((remainder**2).mean() * 2))


def test_a_camera_of_another_line_is_left_out_by_name(prior: Path) -> None:
    read = read_fleet_prior(prior)
    left_out = dict(read.left_out)
    assert [*left_out] == [LINE.name(BROKEN)]
    assert "camera.f" in left_out[LINE.name(BROKEN)]
    assert read.cameras == LINE.cameras - 1


def test_the_fleet_s_focal_length_is_more_exact_than_the_drawing(prior: Path) -> None:
    read = read_fleet_prior(prior)
    fleet_focal = numbers_of(*(read.intrinsics, read.cover))["camera.fx"]
    declared = numbers_of(*read.declared)["camera.fx"]
    assert fleet_focal.sigma < 0.4 * declared.sigma
    assert (
        abs(fleet_focal.value - 1.0015 * 2558.36) < 3 * fleet_focal.sigma
    )  # half of them focus 0.3 % longer


@pytest.mark.parametrize(("views", "limit_px"), [(3, 0.55), (6, 0.25)])
def test_few_views_of_new_cameras_give_better_maps(
    views: int, limit_px: float, prior: Path, tmp_path: Path
) -> None:
    """Three cameras had 0.61 and 0.28 px without the prior, and 0.46 and 0.20 px with it."""
    alone, with_prior = [], []
    for seed in (7, 8, 9):
        new, folder = replace(NEW, seed=seed), tmp_path / str(seed)
        with single_thread():
            alone.append(
                map_error(new, fit(read_session(named(folder / "no", new, views, None)), SETTINGS))
            )
            calibration = fit(read_session(named(folder / "yes", new, views, prior)), SETTINGS)
        assert calibration.outcome.fleet_prior
        assert calibration.outcome.fleet_prior.used
        with_prior.append(map_error(new, calibration))
    assert np.linalg.norm(with_prior) < np.linalg.norm(alone)
    assert np.linalg.norm(with_prior) < 3**0.5 * limit_px


@pytest.fixture(scope="module")
def stranger(prior: Path, tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    """A camera focused 5 % longer than its fleet's, whose session names their prior."""
    with single_thread():
        return fit(
            read_session(named(tmp_path_factory.mktemp("new") / "stranger", ANOTHER, 6, prior)),
            SETTINGS,
        )


def test_a_contradicted_prior_is_reported_and_not_used(
    stranger: Calibration, tmp_path: Path
) -> None:
    tested = stranger.outcome.fleet_prior
    assert tested
    assert not tested.used
    assert tested.p_value < 0.01
    with single_thread():
        alone = fit(read_session(named(tmp_path / "alone", ANOTHER, 6, None)), SETTINGS)
    assert (stranger.amplitudes == alone.amplitudes).all()  # as if it had not been named
    assert stranger.camera == alone.camera
    sentences = [
        item for item in judge(stranger).sentences if "so their prior was not used" in item
    ]
    assert len(sentences) == 1
    assert "differs from the 6 cameras of" in sentences[0]


def test_the_prior_of_a_fit_is_saved_with_it(prior: Path, tmp_path: Path) -> None:
    """A diagnosis starts from the same prior; and a session without intrinsics of its own has the
    fleet's.
    """
    folder = named(tmp_path / "new", NEW, 4, prior)
    document = yaml.safe_load((folder / "session.yaml").read_text())
    del document["camera"]["intrinsics"]
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    assert main(["fit", str(folder), "--grid", "6x6", "-o", str(tmp_path / "out")]) == 0
    read = Calibration.load(tmp_path / "out")
    assert read.outcome.intrinsics_from == "prior"
    assert read.outcome.fleet_prior
    assert read.outcome.fleet_prior.cameras == 6
    fleet = read_fleet_prior(prior)
    assert read.declared.intrinsics.fx.sigma == pytest.approx(fleet.intrinsics.fx.sigma)
    assert read.declared.intrinsics.correlations[0] == pytest.approx(
        fleet.intrinsics.correlations[0]
    )
    glass = read.declared.cover.glass
    assert glass is not None
    assert fleet.cover.glass is not None
    assert glass.covariance == pytest.approx(fleet.cover.glass.covariance, rel=1e-12)
    assert read.cover.glass is None
    model = base_model(read)
    assert model.parameters.glass_prior is not None
    assert read.relief is not None
    assert model.means["relief.amplitudes"].numpy() == pytest.approx(
        expected_amplitudes(read.relief, glass)
    )


def test_the_console_says_that_a_prior_was_used(
    prior: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["fit", str(named(tmp_path / "new", NEW, 4, prior)), "--grid", "6x6"])
    assert (
        f"Prior: the numbers and the glass of 6 cameras ({prior}), which stand below for what is"
        " declared." in capsys.readouterr().out
    )


def test_the_json_has_the_fleet_s_numbers(
    prior: Path, fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fleet-prior", str(fleet), "-o", str(fleet / "again.yaml"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["cameras"] == 6
    assert answer["numbers"]["cover.thickness"]["unit"] == "mm"
    assert answer["numbers"]["cover.thickness"]["declared"] == pytest.approx(3.0)
    assert answer["written"] == [str(fleet / "again.yaml")]
    assert (fleet / "again.yaml").read_text() == prior.read_text()


def changed(folder: Path, camera: str, **to: object) -> None:
    result = read_result(folder, camera)
    assert result
    replace(result, **to).write(folder)  # type: ignore[arg-type]


def test_broken_cameras_are_left_out_and_named(fleet: Path, tmp_path: Path) -> None:
    folder = copied(fleet, tmp_path)
    sound = [LINE.name(number) for number in range(LINE.cameras) if number != BROKEN]
    first, second, *_ = sound
    changed(folder, first, verdict={"word": "do_not_use"})
    changed(
        folder, second, state=JobState.FAILED, sentence="corners.vnl ends in the middle of a line."
    )
    left_out = dict(estimate_fleet_prior(folder).left_out)
    assert left_out[first] == "its verdict is not to use it"
    assert left_out[second] == "it has no calibration: corners.vnl ends in the middle of a line"


def test_cameras_of_two_kinds_are_kept_apart(fleet: Path, tmp_path: Path) -> None:
    folder = copied(fleet, tmp_path)
    for number in (0, 1):
        source = folder / "cameras" / LINE.name(number) / "calibration.yaml"
        source.write_text(source.read_text().replace("width: 3280", "width: 3282"))
    left_out = dict(estimate_fleet_prior(folder).left_out)
    assert (
        left_out[LINE.name(0)]
        == left_out[LINE.name(1)]
        == "it is of another kind: 3282x2464 px, opencv with 0 coefficients, behind a cone"
    )


def test_kinds_without_a_majority_are_refused(fleet: Path, tmp_path: Path) -> None:
    folder = copied(fleet, tmp_path)
    for number in range(LINE.cameras):
        source = folder / "cameras" / LINE.name(number) / "calibration.yaml"
        source.write_text(source.read_text().replace("width: 3280", f"width: {3280 + number % 3}"))
    with pytest.raises(
        InputError,
        match=r"cameras of 3 kinds, and no kind has more than half of them .* for each kind",
    ):
        estimate_fleet_prior(folder)


def test_too_few_cameras_are_refused(fleet: Path, tmp_path: Path) -> None:
    folder = copied(fleet, tmp_path)
    for number in range(4):
        changed(folder, LINE.name(number), verdict={"word": "do_not_use"})
    with pytest.raises(
        NotEnoughDataError, match=r"A prior takes 4 cameras and .* has 3 that can be used"
    ):
        estimate_fleet_prior(folder)


@pytest.mark.parametrize("empty", [True, False])
def test_a_folder_that_is_no_fleet_is_refused(empty: bool, tmp_path: Path) -> None:
    if empty:
        (tmp_path / "cameras").mkdir()
    with pytest.raises(InputError, match="give the FLEET that calib batch wrote"):
        estimate_fleet_prior(tmp_path)


def test_a_camera_is_done_again_when_its_prior_has_changed(prior: Path, tmp_path: Path) -> None:
    own_prior = tmp_path / "prior.yaml"
    own_prior.write_text(prior.read_text())
    entry = Entry("new", str(named(tmp_path / "new", NEW, 4, own_prior)))
    first_identity = Identity.of(entry, FleetOptions(SETTINGS))
    second_identity = Identity.of(entry, FleetOptions(SETTINGS))
    own_prior.write_text(prior.read_text().replace("cameras: 6", "cameras: 7"))
    assert first_identity.same(second_identity)
    assert not first_identity.same(Identity.of(entry, FleetOptions(SETTINGS)))


def test_a_link_to_nothing_among_the_pictures_stops_no_camera(tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    entry = Entry("A", str(tmp_path))
    picture = tmp_path / "frames" / "0.png"
    picture.write_bytes(b"a picture")
    (tmp_path / "frames" / "1.png").symlink_to("1.png")
    identity = Identity.of(entry, FleetOptions(SETTINGS))
    picture.write_bytes(b"another one")
    assert not identity.same(Identity.of(entry, FleetOptions(SETTINGS)))
