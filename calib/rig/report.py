"""report.html of a rig: cameras, covers and boards in space, mountings, and errors by depth."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from html import escape
from importlib.resources import files
from itertools import pairwise
from pathlib import Path

import numpy as np

from calib.fitting.evaluate import FIRST_BAND_END
from calib.io.file_set import FileSet
from calib.report.chart import border_pixels
from calib.report.evidence import Evidence, gather_evidence
from calib.report.figure import Drawing
from calib.report.page import COLOURS, PageSection, document, next_class
from calib.report.scene import session_in_space, surface_meshes, ways
from calib.report.scripts import RIG, Scripts
from calib.report.write import NAME, page_data
from calib.rig.rig import Rig
from calib.rig.shared_medium import shared_media
from calib.rounding import with_sigma
from calib.table import html_table
from calib.threads import single_thread
from calib.verdict.verdict import Verdict


def write_rig_report(rig: Rig, verdict: Verdict, output: FileSet) -> Path:
    """Add report.html to the files of a rig, and return its future path."""
    with single_thread():
        evidence = {name: gather_evidence(c) for name, c in rig.calibrations.items()}
        reference = evidence[rig.reference]
        scene = rig_in_space(rig, evidence)
    tables = _cameras_html(rig) + _baselines_html(rig)
    cameras = tables + _media_html(rig) + _effects_html(rig)
    sections = [
        PageSection("rig", "The cameras", cameras),
        PageSection(scene.name, scene.title, scene.html()),
        PageSection("depths", "Errors by depth", _depths_html(rig, evidence)),
    ]
    contents = "".join(f'<a href="#{s.name}">{escape(s.title)}</a>' for s in sections)
    body = "".join(
        f'<section id="{s.name}"><h2>{escape(s.title)}</h2>{s.html}</section>' for s in sections
    )
    items = "".join(f"<li>{escape(reason.capitalised)}</li>" for reason in verdict.reasons)
    reasons = f'<ul class="reasons">{items}</ul>' if items else ""
    header = (
        '<p class="over">Refracal rig report</p>'
        f"<h1>{escape(verdict.word.sentence.removesuffix('.'))}</h1>"
        f'<p class="lead">{len(rig.names)} cameras and {len(rig.placements)} placements of the'
        f" board.</p>{reasons}"
        f'<p class="{next_class(verdict)}">{verdict.next_label}:'
        f" <code>{escape(verdict.next)}</code></p>"
        f"<nav>{contents}</nav>"
    )
    style = files("calib.report").joinpath("style.css").read_text(encoding="utf-8")
    text = document(
        f"Rig of {escape(', '.join(rig.names))}",
        style,
        header,
        body,
        colour=COLOURS[verdict.word],
        scripts=Scripts.of(page_data(reference, [scene]), RIG),
    )
    return output.write(NAME, text)


def rig_in_space(rig: Rig, evidence: dict[str, Evidence]) -> Drawing:
    """Return the figure of all cameras, and of the boards that the reference saw, in space."""
    scene = session_in_space(evidence[rig.reference])
    others = [
        _camera_in_space(rig, name, evidence[name]) for name in rig.names if name != rig.reference
    ]
    return replace(
        scene,
        title="The rig in space",
        caption="The cameras, their covers as fitted, and every board that the reference saw, where"
        " it stood. Drag to turn it. Click into it, then scroll to zoom. A board's"
        " colour is its error in the reference: blue is the corners' noise, red three times as"
        " much.",
        data={**scene.data, "name": rig.reference, "others": others},
    )


def _camera_in_space(rig: Rig, name: str, evidence: Evidence) -> dict[str, object]:
    border = ways(evidence, border_pixels(evidence, 1))
    pose = np.linalg.inv(rig.mounting(name).T_camera_reference)
    return {
        "name": name,
        "pose": pose.ravel().tolist(),
        "surfaces": surface_meshes(evidence),
        "border": border.points,
        "borderDirection": border.direction,
        "reach": list(evidence.reach),
    }


def _cameras_html(rig: Rig) -> str:
    """Return the table of the cameras: errors, and where they are."""
    rows = []
    for name, calibration in rig.calibrations.items():
        mounting = rig.mounting(name)
        matrix = mounting.T_camera_reference
        centre = -1000 * matrix[:3, :3].T @ matrix[:3, 3] + 0.0
        angles = np.degrees(mounting.sigma[:3])
        rays = np.degrees(mounting.ray_sigma[:3])
        error = calibration.stages[-1].rms_px
        is_reference = name == rig.reference
        rows.append(
            (
                f'<a href="{escape(name)}/calibration.yaml">{escape(name)}</a>',
                str(len(calibration.views)),
                f"{rig.record.alone_px.get(name, error):.3f} px",
                f"{error:.3f} px",
                ", ".join(f"{value:.2f}" for value in centre) + " mm",
                "the reference" if is_reference else _degrees(angles),
                "" if is_reference else _degrees(rays),
            )
        )
    columns = (
        "camera",
        "views",
        "error alone",
        "error in the rig",
        "pinhole: x, y, z",
        "sigma of its direction",
        "sigma of its rays' direction",
    )
    return html_table(columns, rows)


def _degrees(angles: np.ndarray) -> str:
    return ", ".join(f"{angle:.2g}" for angle in angles) + " deg"


def _baselines_html(rig: Rig) -> str:
    rows = [
        (
            f"{escape(baseline.first)} to {escape(baseline.second)}",
            f"{with_sigma(1000 * baseline.metres, 1000 * baseline.sigma)} mm",
        )
        for baseline in rig.baselines
    ]
    return html_table(("pinhole to pinhole", ""), rows) if rows else ""


def _media_html(rig: Rig) -> str:
    """Return a sentence on each medium that cameras share."""
    return "".join(f"<p>{escape(str(medium))}.</p>" for medium in shared_media(rig))


def _effects_html(rig: Rig) -> str:
    """Return the list of what a diagnosis found; empty without a finding."""
    found = "".join(f"<li>{escape(effect.sentence)}</li>" for effect in rig.record.effects)
    return f"<p>The diagnosis found:</p><ul>{found}</ul>" if found else ""


def _depths_html(rig: Rig, evidence: dict[str, Evidence]) -> str:
    """Return the table of each camera's error by the depth of the corners."""
    farthest = max(item.distance.max() for item in evidence.values())
    bands = list(pairwise(_edges(float(farthest))))
    rows = []
    for low, high in bands:
        errors = [_band_error(evidence[name], low, high) for name in rig.names]
        if any(errors):
            rows.append((f"{low:g} to {high:g} m", *errors))
    return html_table(("depth", *map(escape, rig.names)), rows)


def _edges(farthest: float) -> Iterator[float]:
    yield 0.0
    edge = FIRST_BAND_END
    while True:
        yield edge
        if edge > farthest:
            return
        edge *= 2


def _band_error(evidence: Evidence, low: float, high: float) -> str:
    """Return the error in a band of depths; empty without corners."""
    members = (evidence.distance >= low) & (evidence.distance < high)
    squares = (evidence.errors[members] ** 2).sum(-1)
    return f"{np.sqrt(np.nanmean(squares)):.3f} px" if members.any() else ""
