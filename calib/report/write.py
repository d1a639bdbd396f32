"""Writing of report.html: one file that shows a calibration, without network."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from calib.calibration import Calibration
from calib.io.file_set import FileSet
from calib.io.images import frames_folder
from calib.progress import Progress
from calib.report.again import again_html
from calib.report.board_errors import board_errors
from calib.report.by_depth import distortion_by_depth
from calib.report.colour import fringes_html
from calib.report.comparison import diagnosis_comparison
from calib.report.corners import corners_data, views_data
from calib.report.coverage import corner_coverage
from calib.report.distortion import distortion_fields
from calib.report.effects import EffectRow, effect_rows, effects_html
from calib.report.evidence import Evidence, gather_evidence
from calib.report.figure import Drawing
from calib.report.glass import glass_in_detail, glass_surface
from calib.report.page import PageSection, page
from calib.report.payload import Data
from calib.report.residual_maps import residual_maps
from calib.report.scene import session_in_space, side_view
from calib.report.scripts import Scripts
from calib.report.sigma import predicted_errors
from calib.report.straight import straight_html
from calib.report.summary import summarise
from calib.report.tables import parameters_html, stages_html
from calib.report.views import start_thumbnails, views_html
from calib.session.points_file import FOLDER as POINTS
from calib.threads import single_thread

NAME = "report.html"
DRAWINGS = (
    session_in_space,
    corner_coverage,
    predicted_errors,
    residual_maps,
    board_errors,
    side_view,
    distortion_fields,
    distortion_by_depth,
    glass_surface,
)
RESULTS = ("scene", "coverage", "sigma", "residuals", "board-errors")
"""The names of the drawings of what the pictures show; the others are of the camera's cover."""


def write_report(
    calibration: Calibration,
    files: FileSet,
    progress: Progress,
    depths: Sequence[float] = (),
    effects: Sequence[EffectRow] | None = None,
    *,
    pictures: Path | None = None,
    before: Calibration | None = None,
    calibration_folder: Path | None = None,
) -> Path:
    """Write report.html beside a saved calibration, or into another folder.

    Args:
        depths: m, at which fields are drawn; by default those of the nearest, the median and the
            farthest corner.
        effects: rows of the table of effects; None: those of the calibration's own diagnosis.
        pictures: the session's folder, if it is not where the calibration says.
        before: the calibration that a diagnosis started from.
        calibration_folder: the calibration's folder, if the report goes to another one.
    """
    folder = calibration_folder or files.folder
    advance = progress.task("Report", len(DRAWINGS) + 2)
    with single_thread(), ThreadPoolExecutor() as pool:
        evidence = gather_evidence(calibration, tuple(depths))
        session = _session(calibration, folder, pictures)
        thumbnails = start_thumbnails(evidence, session, pool)
        advance(1, "")
        drawn = []
        for done, drawing in enumerate(DRAWINGS, start=2):
            drawn.append(drawing(evidence))
            advance(done, "")
        comparison = diagnosis_comparison(before, evidence) if DRAWINGS else None
        drawn.append(glass_in_detail(evidence, session))
        drawings = [drawing for drawing in (comparison, *drawn) if drawing]
        sections = _sections(
            evidence,
            straight_html(evidence, session),
            drawings,
            effect_rows(calibration) if effects is None else effects,
            views_html(evidence, thumbnails),
            again_html(evidence, folder),
            fringes_html(evidence),
        )
    path = files.write(
        NAME,
        page(
            calibration.camera.model or "a camera",
            summarise(evidence, depths, folder),
            sections,
            Scripts.of(page_data(evidence, drawings)),
        ),
    )
    advance(len(DRAWINGS) + 2, "")
    return path


def _sections(
    evidence: Evidence,
    straight: str,
    drawings: Sequence[Drawing],
    effects: Sequence[EffectRow],
    views: str,
    reproduction: str,
    colour: str,
) -> list[PageSection]:
    figures = [PageSection(drawing.name, drawing.title, drawing.html()) for drawing in drawings]
    compared = [figure for figure in figures if figure.name == "comparison"]
    diagnosis_html = effects_html(effects, evidence.calibration)
    diagnosed = (
        [PageSection("effects", "What the diagnosis found", diagnosis_html)]
        if diagnosis_html
        else []
    )
    results = [figure for figure in figures if figure.name in RESULTS]
    of_glass = [figure for figure in figures if figure not in (*compared, *results)]
    return [
        *diagnosed,
        *compared,
        *([PageSection("straight", "As taken and undistorted", straight)] if straight else []),
        PageSection("stages", "The error after each stage", stages_html(evidence)),
        PageSection("numbers", "Camera and cover", parameters_html(evidence)),
        *results,
        PageSection("views", "The views", views),
        *of_glass,
        *([PageSection("colour", "Colour fringes", colour)] if colour else []),
        PageSection("again", "How to reproduce it", reproduction),
    ]


def page_data(evidence: Evidence, drawings: Sequence[Drawing]) -> Data:
    """Return what the page's scripts draw from."""
    camera, board = evidence.calibration.camera, evidence.calibration.board
    return {
        "camera": {"width": camera.width, "height": camera.height},
        "board": {
            "columns": board.columns,
            "rows": board.rows,
            "half": board.half,
            "points": board.points(),
        },
        "distanceName": evidence.distance_name,
        "corners": corners_data(evidence),
        "views": views_data(evidence),
        "figures": {drawing.name: drawing.data for drawing in drawings},
    }


def _session(calibration: Calibration, folder: Path, pictures: Path | None) -> Path | None:
    """Return the folder of the session with the pictures or points: the fitted one, or else the
    parent of the calibration's folder; None if neither has any.
    """
    provenance = calibration.request.provenance
    fitted = provenance and provenance.session
    places = [place for place in (pictures, fitted and Path(fitted)) if place]
    places.append(folder.resolve().parent)
    return next(
        (p for p in places if frames_folder(p).is_dir() or (p / POINTS).is_dir()),
        None,
    )
