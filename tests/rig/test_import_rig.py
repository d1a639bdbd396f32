"""A rig that another program calibrated becomes a rig.yaml with sessions, where a fit starts."""

import base64
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from calib.cli import main
from calib.errors import InputError
from calib.export.formats import MRCAL, ExportLens
from calib.rig.central_rig import CentralRig
from calib.rig.exports import KALIBR_LENSES, STEREO_LENSES, kalibr_files, mrcal_files, opencv_files
from calib.rig.fit_rig import fit_rig
from calib.rig.import_rig import import_rig
from calib.rig.rig import Rig
from calib.rig.rig_file import RigDescription, read_rig
from tests.rig.conftest import BOARD, DEPTH, EVEN, HEIGHT, WIDTH

FAR = [[1, 0, 0, 60], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
WORDS = ("--board", "6x5", "--square-mm", "30")


def pictures(folder: Path, names: Sequence[str], size: tuple[int, int] = (WIDTH, HEIGHT)) -> Path:
    """A folder of black pictures."""
    folder.mkdir(parents=True)
    for name in names:
        cv2.imwrite(str(folder / name), np.zeros(size[::-1], np.uint8))
    return folder


def exported(rig: Rig, form: str, lens: ExportLens, folder: Path) -> list[str]:
    """The paths of the rig's files in another program's format."""
    functions = {"opencv": opencv_files, "kalibr": kalibr_files, "mrcal": mrcal_files}
    paths = []
    for name, text in functions[form](CentralRig.of(rig, rig.names, DEPTH, (lens,)), "0.7").items():
        (folder / name).write_text(text)
        paths.append(str(folder / name))
    return paths


def check(description: RigDescription, rig: Rig, lens: ExportLens) -> None:
    """The description has the central cameras of the rig, with tolerances."""
    central = CentralRig.of(rig, rig.names, DEPTH, (lens,))
    for session, model in zip(description.sessions.values(), central.models.values(), strict=True):
        k = session.camera.intrinsics
        assert k
        assert (k.fx.value, k.fy.value) == pytest.approx(model.focal, rel=1e-12)
        assert (k.cx.value, k.cy.value) == pytest.approx(model.principal, rel=1e-12)
        assert [n.value for n in k.distortion] == pytest.approx(model.distortion, rel=1e-12)
        assert k.fx.sigma == pytest.approx(0.02 * k.fx.value)
        assert all(number.sigma for number in (k.cx, k.cy, *k.distortion))
    assert description.baseline
    distance = np.linalg.norm(central.poses["right"][:3, 3])
    assert description.baseline.value == pytest.approx(distance, abs=1e-9)
    assert description.baseline.sigma == pytest.approx(0.02 * distance, rel=1e-2)


@pytest.mark.parametrize(
    ("form", "lens"),
    [("opencv", STEREO_LENSES[1]), ("kalibr", KALIBR_LENSES[0]), ("mrcal", MRCAL[2])],
    ids=["opencv", "kalibr", "mrcal"],
)
def test_our_own_export_is_imported(
    small: Rig, tmp_path: Path, form: str, lens: ExportLens
) -> None:
    paths = exported(small, form, lens, tmp_path)
    places = [
        str(pictures(tmp_path / side, [f"{side}{index:02d}.png" for index in range(3)]))
        for side in ("left", "right")
    ]
    out = tmp_path / "rig"
    assert main(["import", "rig", *paths, "--pictures", *places, *WORDS, "-o", str(out)]) == 0
    description = read_rig(out)
    check(description, small, lens)
    assert description.tolerance_s is None
    names = {session.frames[1].name for session in description.sessions.values()}
    assert names == {"01.png"}  # of the same moment
    assert "knew no cover" in (out / "rig.yaml").read_text()


def test_kalibr_s_own_pictures_by_their_stamps(small: Rig, tmp_path: Path) -> None:
    (path,) = exported(small, "kalibr", KALIBR_LENSES[0], tmp_path)
    stamps = [1385030208726607500 + 50_000_000 * index for index in range(3)]
    for camera, delay in (("cam0", 0), ("cam1", 1_000_000)):
        pictures(tmp_path / camera, [f"{stamp + delay}.png" for stamp in stamps])
    (tmp_path / "target.yaml").write_text(
        "target_type: checkerboard\ntargetCols: 6\ntargetRows: 5\nrowSpacingMeters: 0.03\n"
        "colSpacingMeters: 0.03\n"
    )
    out = tmp_path / "rig"
    assert main(["import", "rig", path, "-o", str(out)]) == 0
    description = read_rig(out)
    assert description.tolerance_s == 0.005
    check(description, small, KALIBR_LENSES[0])
    assert all(session.board == BOARD for session in description.sessions.values())


def test_opencv_s_two_files(small: Rig, tmp_path: Path) -> None:
    """intrinsics.yml and extrinsics.yml of OpenCV's sample."""
    (path,) = exported(small, "opencv", STEREO_LENSES[0], tmp_path)
    storage = cv2.FileStorage(path, cv2.FILE_STORAGE_READ)
    for name, keys in (("intrinsics", ("M1", "D1", "M2", "D2")), ("extrinsics", ("R", "T"))):
        file = cv2.FileStorage(str(tmp_path / f"{name}.yml"), cv2.FILE_STORAGE_WRITE)
        for key in keys:
            file.write(key, storage.getNode(key).mat())
        file.release()
    files = [tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"]
    places = [pictures(tmp_path / side, ["00.png", "01.png"]) for side in ("left", "right")]
    rig = import_rig(files, BOARD, places)
    assert [camera.name for camera in rig.cameras] == ["left", "right"]
    with pytest.raises(InputError, match="lacks R, T"):
        import_rig(files[:1], BOARD, places)
    with pytest.raises(InputError, match="names no pictures"):
        import_rig(files, BOARD)
    with pytest.raises(InputError, match="give --pictures 2 folders"):
        import_rig(files, BOARD, places[:1])
    other = [pictures(tmp_path / "a", ["x.png", "y.png"]), places[1]]
    with pytest.raises(InputError, match="call those of one moment the same"):
        import_rig(files, BOARD, other)


def test_what_is_no_rig_is_refused(
    small: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (path,) = exported(small, "kalibr", KALIBR_LENSES[0], tmp_path)
    chain = yaml.safe_load(Path(path).read_text())
    places = [pictures(tmp_path / name, ["0.png"], (100, 80)) for name in ("a", "b")]
    words = ["--pictures", *map(str, places), *WORDS, "-o", str(tmp_path / "out")]
    assert main(["import", "rig", path, *words]) == 2
    assert "cam0 was calibrated with pictures of 410x308 px" in capsys.readouterr().err
    for change, says in (
        ({"T_cn_cnm1": [[1, 0, 0, 0]] * 4}, "cam1.T_cn_cnm1 has no rotation matrix"),
        ({"T_cn_cnm1": "none"}, "cam1.T_cn_cnm1 has no rotation matrix"),
        ({"intrinsics": [1, 2, "x", 4]}, "intrinsics must be 4 numbers"),
        ({"T_cn_cnm1": FAR}, "cam1 is 60 from the first camera, and the unit is the metre"),
    ):
        Path(path).write_text(yaml.safe_dump(chain | {"cam1": chain["cam1"] | change}))
        assert main(["import", "rig", path, *words]) == 2
        assert says in capsys.readouterr().err
    Path(path).write_text(yaml.safe_dump({"cam0": chain["cam0"]}))
    assert main(["import", "rig", path, *words]) == 2
    assert "has one camera" in capsys.readouterr().err
    (tmp_path / "no.yaml").write_text("a: 1\n")
    assert main(["import", "rig", str(tmp_path / "no.yaml"), *words]) == 2
    assert "has no cam0" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def solved(rig: Rig, folder: Path) -> list[Path]:
    """The .cameramodels that mrcal would write, with the corners of the rig's views."""
    central = CentralRig.of(rig, rig.names, DEPTH, (MRCAL[2],))
    observed, indices = [], []
    for camera, name in enumerate(rig.names):
        calibration = rig.calibrations[name]
        for view, place in zip(calibration.views, rig.of_views[name].tolist(), strict=True):
            weight = np.where(np.isfinite(view.corners[:, :1]), 1.0, -1.0)
            rows = np.concatenate([np.nan_to_num(view.corners), weight], -1)
            observed.append(rows.reshape(BOARD.rows, BOARD.columns, 3))
            indices.append([place, camera, camera - 1])
    data = io.BytesIO()
    np.savez_compressed(
        data,
        observations_board=np.array(observed),
        indices_frame_camintrinsics_camextrinsics=np.array(indices, np.int32),
        calibration_object_spacing=np.array(BOARD.square),
    )
    inputs = base64.b85encode(data.getvalue())
    files = []
    for camera, (name, text) in enumerate(mrcal_files(central, "0.7").items()):
        files.append(folder / name)
        entries = f"'icam_intrinsics': {camera}, 'optimization_inputs': {inputs!r},\n}}"
        files[-1].write_text(text.rstrip().removesuffix("}") + entries)
    return files


@pytest.mark.slow
def test_a_fit_starts_from_mrcal_s_corners(fitted: Rig, tmp_path: Path) -> None:
    """With the covers described, the imported rig gives the baseline of the rig itself."""
    files = solved(fitted, tmp_path)
    out = tmp_path / "rig"
    assert main(["import", "rig", *map(str, files), "-o", str(out)]) == 0
    description = read_rig(out)
    sessions = {
        name: replace(
            session,
            cover=calibration.cover,
        )
        for (name, session), calibration in zip(
            description.sessions.items(), fitted.calibrations.values(), strict=True
        )
    }
    rig = fit_rig(replace(description, sessions=sessions), EVEN)
    baseline = fitted.baselines[0]
    assert len(rig.placements) == len(fitted.placements)
    assert rig.baselines[0].metres == pytest.approx(baseline.metres, abs=4 * baseline.sigma)
