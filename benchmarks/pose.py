"""The errors of placed tags, over depth: `python -m benchmarks.pose [--sessions 8]`.

The pictures in fixtures/bumps/tags, which Mitsuba rendered through the 3 mm cone of that session:
tags of 50 and 100 mm at 0.2 to 1.5 m, two families, six tags to a picture. `calib pose` with the
calibration that `fixtures/bumps` gives, against OpenCV on the same pictures: of the central cameras
with 5, 8 and 12 coefficients that cv2.calibrateCamera fits to the same session, the best on its
held-out views; solvePnP with SOLVEPNP_IPPE_SQUARE, refined; with the same corners, and with those
that cv2.aruco refines itself. Beside them, the central camera that `calib export` makes of our
calibration for 0.5 m. Errors are root mean squares of the distance, each after the one rigid motion
of all tags that fits best, as a calibration by boards leaves that open.

The same of these pictures stored with the tones of sRGB, which make black look narrower. Then many
synthetic sessions, whose corners and tags come from our own forward projection, each calibrated
anew from noisy corners: the error over what is predicted. Last, the time for a tag of both.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.apply.located_tags import MIN_PROBABILITY, Tag
from calib.apply.tags import TagLocator
from calib.calibration import Calibration
from calib.corners.markers import read_markers
from calib.export.central import best_central
from calib.export.formats import OPENCV
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views
from calib.io.images import read_grey
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.progress import Silent
from calib.session.session import read_session
from fixtures.calibrated import calibrate
from fixtures.rays import FIXTURES
from fixtures.synthetic import HEIGHT, WIDTH, Scene, scene
from fixtures.tag_errors import SQUARE, Central, TagTruth, aligned, error_over_sigma

Array = NDArray[np.float64]

DICTIONARIES = {"april": "DICT_APRILTAG_36h11", "aruco": "DICT_4X4_50"}
EXPORTED_AT = 0.5
"""m"""
NOISE = 0.02
"""px per axis, of synthetic corners of 3280 px wide pictures."""
DEPTHS = (0.2, 0.3, 0.5, 0.75, 1.0, 1.5)
"""m, of synthetic tags."""
TAGS = 40
"""To a depth."""
SIDE = 0.05
"""m"""
REPEATS = 5


@dataclass(frozen=True)
class Placed:
    """A tag of a picture, placed in every way."""

    picture: int
    tag: Tag
    true: Array
    """(3,) m"""
    opencv: Array
    own_corners: Array
    """The place by OpenCV with its own corners."""
    exported: Array


def srgb(grey: NDArray) -> NDArray[np.uint8]:
    """Levels as most cameras store light."""
    light = grey / 255
    curved: Array = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * curved).astype(np.uint8)


def pictures(
    calibration: Calibration, central: Central, truth: TagTruth, *, curved: bool = False
) -> list[Placed]:
    model = best_central(calibration, EXPORTED_AT, OPENCV)
    exported = Central(model.matrix, np.array(model.distortion), model.lens.coefficients, 0.0, 0.0)
    placed_tags = []
    for picture, (name, side) in enumerate(zip(truth.names, truth.sides.tolist(), strict=True)):
        family, grey = name.split("-")[0], read_grey(truth.folder / name)
        grey = srgb(grey) if curved else grey
        theirs = refined(grey.astype(np.uint8), family)
        for tag in (
            TagLocator(calibration, DICTIONARIES[family], side, side_sigma=0.0).locate(grey).tags
        ):
            ours, central_place = (
                central.position(tag.corners, side),
                central.position(theirs[tag.number], side),
            )
            by_export = exported.position(tag.corners, side) + model.centre
            placed_tags.append(
                Placed(
                    picture,
                    tag,
                    truth.translations[picture, tag.number],
                    ours,
                    central_place,
                    by_export,
                )
            )
    return placed_tags


def refined(grey: NDArray[np.uint8], family: str) -> dict[int, Array]:
    """(4, 2) px by number, as cv2.aruco refines them by cornerSubPix, in the order of the upright
    tag.
    """
    options = cv2.aruco.DetectorParameters()
    options.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARIES[family]))
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary, options).detectMarkers(grey)
    turned = np.roll(
        np.asarray(corners, np.float64).reshape(-1, 4, 2), 2 if family == "april" else 0, 1
    )
    return {int(number): points for number, points in zip(np.ravel(numbers), turned, strict=True)}


def by_depth(placed: list[Placed], truth: TagTruth, title: str) -> Table:
    true = np.array([item.true for item in placed])
    estimates = (
        np.array([item.tag.poses[0].position for item in placed]),
        np.array([item.opencv for item in placed]),
        np.array([item.own_corners for item in placed]),
        np.array([item.exported for item in placed]),
    )
    errors = [np.linalg.norm(aligned(places, true), axis=-1) for places in estimates]
    spread = np.array([np.linalg.norm(item.tag.poses[0].sigma[3:]) for item in placed])
    at = np.array([(truth.sides[item.picture], truth.depths[item.picture]) for item in placed])
    wide = [
        np.linalg.norm(item.tag.corners - np.roll(item.tag.corners, 1, 0), axis=-1).mean()
        for item in placed
    ]
    titles = (
        "side",
        "depth",
        "in the picture",
        "calib pose",
        "its sigma",
        "OpenCV",
        "ratio",
        "OpenCV, its corners",
        "exported for 0.5 m",
    )
    table = Table(*titles, title=f"{title}: error of a tag's place, mm RMS; 12 tags a row")
    for side, depth in np.unique(at, axis=0).tolist():
        selected = (at == (side, depth)).all(-1)
        millimetres = [1e3 * float(np.sqrt((error[selected] ** 2).mean())) for error in errors]
        ours, opencv, own_error, exported = millimetres
        sigma = 1e3 * float(np.sqrt((spread[selected] ** 2).mean()))
        cells = (
            f"{1e3 * side:.0f} mm",
            f"{depth:g} m",
            f"{np.mean(np.array(wide)[selected]):.0f} px",
        )
        table.add_row(
            *cells,
            f"{ours:.3f}",
            f"{sigma:.3f}",
            f"{opencv:.2f}",
            f"{opencv / ours:.1f}",
            f"{own_error:.2f}",
            f"{exported:.2f}",
        )
    return table


def distances(placed: list[Placed], depths: Array) -> dict[float, float]:
    """Return for each depth the error of the distances between tags of one picture over their
    sigma, root mean square.
    """
    ratios: dict[float, list[float]] = {}
    for first_tag, second_tag in combinations(placed, 2):
        if first_tag.picture == second_tag.picture:
            metres, sigma = first_tag.tag.poses[0].distance(second_tag.tag.poses[0])
            error = metres - float(np.linalg.norm(first_tag.true - second_tag.true))
            ratios.setdefault(float(depths[first_tag.picture]), []).append(error / sigma)
    return {depth: float(np.sqrt(np.mean(np.square(ratios[depth])))) for depth in sorted(ratios)}


def tags_of(made: Scene, depth: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """(TAGS, 3) m and (TAGS, 4, 2) px of tags within the picture."""
    places: list[Array] = []
    corners: list[Array] = []
    while len(places) < TAGS:
        turn, place = (
            cv2.Rodrigues(rng.uniform(-0.6, 0.6, 3))[0],
            np.array([*rng.uniform(-0.6, 0.6, 2), 1.0]) * depth,
        )
        square = SIDE * SQUARE * [1, -1, 1] @ turn.T + place
        pixels = project(made.path, made.values, torch.from_numpy(square), MIDDLE).numpy()
        if (pixels > 20).all() and (pixels < [WIDTH - 20, HEIGHT - 20]).all():
            places.append(place)
            corners.append(pixels)
    return np.array(places), np.array(corners)


def synthetic(seed: int) -> tuple[Array, list[list[float]]]:
    """(depths,) m RMS, and by depth the squared error over the predicted variance, of each tag and
    of all together.
    """
    made = scene(seed, 24, (4, 4), 3e-5, NOISE, depths=(0.3, 1.1))
    locator = TagLocator(calibrate(made, Settings()), "DICT_4X4_50", SIDE, side_sigma=0.0)
    rng = np.random.default_rng(seed)
    errors, ratios = [], []
    for depth in DEPTHS:
        true, corners = tags_of(made, depth, rng)
        noisy = corners + rng.normal(0, NOISE, corners.shape)
        places = locator.place(noisy, np.broadcast_to(NOISE**2 * np.eye(8), (TAGS, 8, 8)))
        best = [
            (item[0], place)
            for item, place in zip(places, true, strict=True)
            if isinstance(item, tuple) and item[0].probability > MIN_PROBABILITY
        ]
        poses, kept_places = [item for item, _ in best], np.array([place for _, place in best])
        errors.append(
            float(
                np.sqrt(
                    (aligned(np.array([item.position for item in poses]), kept_places) ** 2)
                    .sum(-1)
                    .mean()
                )
            )
        )
        ratios.append(
            [error_over_sigma(poses, kept_places, together=together) for together in (False, True)]
        )
    return np.array(errors), ratios


def milliseconds(
    placed: list[Placed], calibration: Calibration, central: Central, truth: TagTruth
) -> tuple[float, float, float]:
    """For a tag, the least of some repeats: from the picture with its tags read to poses, from
    corners to poses, and by solvePnP.
    """
    at = truth.names.index("aruco-050-0500.jpg")
    grey, locator = (
        read_grey(truth.folder / truth.names[at]).astype(np.uint8),
        TagLocator(calibration, "DICT_4X4_50", SIDE),
    )
    corners = np.array([item.tag.corners for item in placed if item.picture == at])
    noise = np.broadcast_to(NOISE**2 * np.eye(8), (len(corners), 8, 8))

    def least(task: Callable[[], object]) -> float:
        spent = []
        for _ in range(REPEATS):
            began = time.perf_counter()
            task()
            spent.append(time.perf_counter() - began)
        return 1e3 * min(spent) / len(corners)

    reading = least(lambda: read_markers(grey, "DICT_4X4_50", 1))
    solved, opencv = (
        least(lambda: locator.place(corners, noise)),
        least(lambda: [central.position(item, SIDE) for item in corners]),
    )
    return least(lambda: locator.locate(grey)) - reading, solved, opencv


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pose", description=__doc__)
    parser.add_argument(
        "--sessions", type=int, default=8, metavar="N", help="synthetic ones, 10 s each"
    )
    sessions = parser.parse_args().sessions
    console = Console(width=120)
    calibration, truth = (
        fit(read_session(FIXTURES / "bumps")),
        TagTruth.of(FIXTURES / "bumps" / "tags"),
    )
    held, _ = read_views(read_session(FIXTURES / "bumps" / "holdout"), Silent())
    camera = calibration.camera
    assert camera.intrinsics
    central = Central.best(
        calibration.views, held, calibration.board, (camera.width, camera.height), camera.intrinsics
    )
    errors_px = f"{central.rms_px:.3f} px, held out {central.held_out_px:.3f}"
    console.print(f"OpenCV's central camera: {central.coefficients} coefficients, {errors_px}.")
    placed = pictures(calibration, central, truth)
    console.print(by_depth(placed, truth, "As rendered"))
    console.print(
        by_depth(
            pictures(calibration, central, truth, curved=True),
            truth,
            "Stored with the tones of sRGB",
        )
    )
    poses, true = [item.tag.poses[0] for item in placed], np.array([item.true for item in placed])
    apart_ratio = error_over_sigma(poses, true, together=False)
    together = error_over_sigma(poses, true, together=True)
    console.print(
        f"{len(placed)} rendered tags: squared error over predicted variance"
        f" {apart_ratio:.2f} each, {together:.2f} together."
    )
    expected = ", ".join(
        f"{over:.2f} at {depth:g} m" for depth, over in distances(placed, truth.depths).items()
    )
    console.print(f"Distances between tags of a picture, error over sigma: {expected}.")
    if sessions:
        results = [synthetic(number) for number in range(sessions)]
        errors = np.array([error for error, _ in results])
        ratios = np.array([ratio for _, ratio in results])
        title = (
            f"{sessions} synthetic sessions, {TAGS} tags of {1e3 * SIDE:.0f} mm to a depth in each"
        )
        table = Table(
            "depth",
            "error, mm RMS",
            "squared error over predicted variance: each",
            "together",
            title=title,
        )
        for at, depth in enumerate(DEPTHS):
            table.add_row(
                f"{depth:g} m",
                f"{1e3 * np.sqrt((errors[:, at] ** 2).mean()):.3f}",
                *(f"{ratio:.2f}" for ratio in ratios[:, at].mean(0)),
            )
        console.print(table)
    full, solved, opencv = milliseconds(placed, calibration, central, truth)
    times = f"poses alone {solved:.1f} ms, {solved / opencv:.0f} times solvePnP's {opencv:.2f} ms"
    console.print(f"A tag that was read: corners and poses {full:.1f} ms; {times}.")


if __name__ == "__main__":
    main()
