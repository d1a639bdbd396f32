"""The content of report.html: one file, nothing from outside, every section, and no text of a file
that counts as HTML.
"""

import gzip
import json
import re
from base64 import b64decode, b64encode
from collections import Counter
from dataclasses import asdict, replace
from hashlib import sha256
from html import unescape
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main
from calib.commands.console import print_fit
from calib.corners.view import RejectedPicture
from calib.diagnosis.requested_effects import with_requested
from calib.fit_record.history import DiagnosisRecord, Family
from calib.fit_record.outcome import Redetection
from calib.fit_record.request import FitRequest, Provenance
from calib.fit_record.shapes import RECORD
from calib.fitting.provenance import record_diagnosis
from calib.progress import Silent
from calib.report.comparison import diagnosis_comparison
from calib.report.effects import EffectRow, effect_rows, effects_html
from calib.report.evidence import gather_evidence
from calib.report.page import commands_html, keep_numbers, sentence_html
from calib.report.scripts import WEB
from calib.report.setting_words import words_for
from calib.report.summary import summarise
from calib.verdict.judge import judge
from calib.verdict.next_commands import HOLDOUT_NOTE, TESTED_NOTE
from calib.verdict.verdict import Reason, Trust, Verdict
from fixtures.calibrated import with_outcome
from tests.report.conftest import Reported
from tests.report.made import report_in

FAMILY = Family("the board", {"board_shape": 0.87, "rolling_shutter": 0.13}, "Tilt it.")
DIAGNOSED = DiagnosisRecord(
    {
        "candidates": [],
        "before": {"rms_px": 0.5, "rmse_cm": 0.1, "held_out_px": 0.6},
        "after": {"rms_px": 0.1, "rmse_cm": 0.02, "held_out_px": 0.15},
        "families": [asdict(FAMILY)],
    }
)
HOSTILE = """<script>alert("1")</script>&lt;'$x_1$"""


def text(html: str) -> str:
    visible = re.sub(r"<style>.*?</style>|<script.*?</script>", "", html, flags=re.DOTALL)
    return unescape(re.sub(r"<[^>]+>", "", visible)).replace("\N{NO-BREAK SPACE}", " ")


def test_no_line_breaks_within_a_number_and_commands_keep_their_spaces() -> None:
    html = (
        "<b>5 mm.png</b>: 1 ± 2 px in 86 % of <code>7 m</code>,"
        ' <td data-label="3 px">0.3 m &lt; 0.1 × tolerance'
    )
    space = "\N{NO-BREAK SPACE}"
    assert keep_numbers(html) == (
        f"<b>5 mm.png</b>: 1{space}±{space}2{space}px in 86{space}% of <code>7 m</code>,"
        f' <td data-label="3 px">0.3{space}m &lt;{space}0.1{space}×{space}tolerance'
    )


def test_a_diagnosis_that_found_nothing_is_in_the_report(reported: Reported) -> None:
    calibration = reported.calibration
    assert effects_html([], calibration) == ""
    diagnosed = replace(calibration, history=replace(calibration.history, diagnosis=DIAGNOSED))
    html = effects_html(effect_rows(diagnosed), diagnosed)
    assert "found nothing" in html
    assert "The error on held-out views is 0.600 px." in html
    assert str(FAMILY) in unescape(html)
    assert "found nothing" not in summarise(gather_evidence(diagnosed)).sentences[0]
    assert "What else was scored" not in html
    lens = {"effect": "lens", "form": "", "accepted": False, "verdict": "absorbed"}
    port = {"effect": "flat_port", "form": "air", "accepted": False, "verdict": "absorbed"}
    added = {**lens, "effect": "board_scale", "held_out_px_before": 1.0, "held_out_px_after": 0.5}
    accepted = {**added, "accepted": True, "parameters": {}}
    scored = DiagnosisRecord({**DIAGNOSED.document, "candidates": [lens, port, accepted]})
    diagnosed = replace(calibration, history=replace(calibration.history, diagnosis=scored))
    html = effects_html([EffectRow("board_scale", 1.0, 0.5, ())], diagnosed)
    assert "<li>these views cannot tell it from fitted numbers: lens, flat_port (air)</li>" in html
    nothing = DiagnosisRecord({**DIAGNOSED.document, "families": []})
    diagnosed = replace(calibration, history=replace(calibration.history, diagnosis=nothing))
    assert summarise(gather_evidence(diagnosed)).sentences[0] == (
        "The diagnosis found nothing that the model lacks."
    )


def scripts_of(html: str) -> list[tuple[str, str]]:
    """Return the attributes and the text of each script."""
    return re.findall(r"<script([^>]*)>(.*?)</script>", html, re.DOTALL)


def data_of(html: str) -> dict[str, Any]:
    data: dict[str, Any] = json.loads(scripts_of(html)[0][1])
    return data


def unpacked(array: dict[str, Any]) -> np.ndarray:
    """Return an array of the page's data."""
    kind = next(kind for kind in ("f4", "u2") if kind in array)
    return np.frombuffer(b64decode(array[kind]), f"<{kind}").reshape(array["shape"])


def test_everything_is_in_one_small_file(reported: Reported) -> None:
    html = re.sub(r"<script.*?</script>", "", reported.html, flags=re.DOTALL)
    links = re.findall(r'(?:src|href)="([^"]*)', html) + re.findall(r"url\(([^)]*)", html)
    assert len(links) > 50
    assert {link[:5] if link.startswith("data:") else link[:1] for link in links} <= {"data:", "#"}
    assert len(reported.calibration.views) == 45
    assert html.count("<img") == 45 + 4, "a thumbnail of each, a picture and a strip of it twice"
    assert reported.path.stat().st_size < 1.5e6


def test_the_outcome_is_a_table_and_no_yaml(reported: Reported) -> None:
    details = reported.html.partition("Settings and outcome")[2].partition("</details>")[0]
    assert "<pre>" not in details
    assert "<code>relief_prior length_of_patch</code>" in details
    assert ">length of its waves, in sides of its patch<" in details
    assert "<code>None</code>" not in details


def test_every_setting_has_words() -> None:
    assert {key for key in RECORD if words_for(key) == key} == set()
    assert words_for("updates 2 finished") == "update 2: time"
    assert words_for("lens_held_out_px opencv 5") == "held-out error with this lens, px opencv 5"
    assert words_for("numpy") == "numpy"


def test_the_policy_knows_the_scripts_and_nothing_else(reported: Reported) -> None:
    """The page's data, the libraries as text, and the one script that runs and unpacks them."""
    data, libraries, program = scripts_of(reported.html)
    assert data[0] == ' type="application/json" id="data"'
    assert libraries[0] == ' type="text/plain" id="libraries"'
    assert program[0] == ""
    scripts = program[1].encode(), gzip.decompress(b64decode(libraries[1]))
    hashes = [f"'sha256-{b64encode(sha256(script).digest()).decode()}'" for script in scripts]
    match = re.search(r'Content-Security-Policy" content="([^"]+)"', reported.html)
    assert match
    assert match[1].split("; ") == [
        "default-src 'none'",
        "base-uri 'none'",
        "form-action 'none'",
        "img-src data:",
        "style-src 'unsafe-inline'",
        f"script-src {' '.join(hashes)}",
    ]


def test_the_data_are_the_calibrations(reported: Reported) -> None:
    """In single precision, seven digits; the panels over the corners show all of them."""
    data = data_of(reported.html)
    corners = np.concatenate([view.corners[view.seen] for view in reported.calibration.views])
    assert unpacked(data["corners"]["pixel"]) == pytest.approx(corners, rel=1e-6)
    assert data["corners"]["step"] == 1
    errors = unpacked(data["corners"]["error"]).astype(float)
    rms = np.sqrt((errors**2).sum(-1).mean())
    assert rms == pytest.approx(reported.calibration.stages[-1].rms_px, rel=1e-6)
    poses = reported.calibration.poses[:, :6]
    assert unpacked(data["views"]["pose"]) == pytest.approx(poses, rel=1e-6)


def test_the_lens_alone_is_not_the_stage_of_the_camera_alone(reported: Reported) -> None:
    """The two have different errors on the board: one uses the fitted lens."""
    words = text(reported.html)
    panels = data_of(reported.html)["figures"]["board-errors"]["panels"]
    assert panels[0]["title"].startswith("fitted lens alone, no cover: ")
    assert re.fullmatch(r"the same, enlarged \d+ times: [\d.]+ mm RMS", panels[2]["title"])
    assert 'The stage "camera alone" has the lens as it was before the fit' in words


def test_the_arrows_say_what_they_are(reported: Reported) -> None:
    figure = data_of(reported.html)["figures"]["residuals"]
    for place, name in (("image", "picture"), ("board", "board")):
        title = figure[place]["title"]
        assert re.fullmatch(rf"mean error over the {name}; longest arrow [\d.e-]+ px", title)


def test_a_caption_says_how_much_its_arrows_are_magnified(reported: Reported) -> None:
    """By the factors that the figure's script draws them with."""
    words = text(reported.html)
    scales = data_of(reported.html)["figures"]["residuals"]["scales"]
    image = re.search(r"Arrows over the picture are drawn ([\d.]+) times as long", words)
    board = re.search(r"Over the board, 10 mm of an arrow are an error of ([\d.]+) px", words)
    assert image
    assert board
    assert float(image[1]) == scales["image"]
    assert float(board[1]) == pytest.approx(10 / scales["board"], rel=0.05), "said with two digits"


def test_rays_go_from_the_lens_through_the_glass_to_their_corners(reported: Reported) -> None:
    """Behind the glass, a way goes along the calibration's own ray. Single precision keeps a tenth
    of a micron of a metre; the tolerance is ten times that.
    """
    calibration, space = reported.calibration, data_of(reported.html)["figures"]["scene"]
    paths = unpacked(space["rays"]).astype(float)
    view, corner = unpacked(space["rayView"]), unpacked(space["rayCorner"])
    assert len(paths) > 400
    assert set(view) == set(range(45))
    assert np.abs(paths[:, 0]).max() == 0, "the pinhole"
    pixels = np.array([calibration.views[v].corners[c] for v, c in zip(view, corner, strict=True)])
    origins, directions = calibration.rays(pixels)
    assert paths[:, -2] == pytest.approx(origins, abs=1e-6)
    leg = paths[:, -1] - paths[:, -2]
    distance = np.linalg.norm(np.cross(leg, directions), axis=-1)
    assert distance.max() < 1e-3, "m beside the corner: its error, in space"
    assert np.median(distance) < 1e-4


def test_the_cover_is_drawn_where_rays_meet_it(reported: Reported) -> None:
    """The profiles are straight views of the smooth surfaces, whose relief is 30 um or less."""
    figures = data_of(reported.html)["figures"]
    for plane, fixed in (("side", 0), ("above", 1)):
        profiles = figures["side-view"]["profiles"][plane]
        inner = unpacked(profiles[0]).astype(float)
        outer = unpacked(profiles[1])
        assert np.nanmax(np.abs(inner[:, fixed])) < 1e-9
        assert np.isfinite(outer).all(-1).sum() > 100
    height = (inner[:, 2] - figures["side-view"]["origin"][2]) ** 2 + inner[:, 0] ** 2
    radius = reported.calibration.cover.parameters["inner_radius"].value
    assert np.sqrt(height) == pytest.approx(radius, abs=1e-6), "a circle from above"


def test_every_id_is_there_once_and_every_reference_leads_to_one(reported: Reported) -> None:
    ids = Counter(re.findall(r'\bid="([^"]+)"', reported.html))
    assert max(ids.values()) == 1
    wanted = re.findall(r'(?:href="#|url\(#|aria-labelledby=")([^")]+)', reported.html)
    assert len(set(wanted)) > 10
    assert set(wanted) <= set(ids)


def test_sections(reported: Reported) -> None:
    names = re.findall(r'<section id="([^"]+)"', reported.html)
    results = ["scene", "coverage", "sigma", "residuals", "board-errors"]
    glass = ["side-view", "distortion", "by-depth", "glass"]
    assert names == ["straight", "stages", "numbers", *results, "views", *glass, "again"]


def test_stages_and_numbers_are_those_of_the_calibration(reported: Reported) -> None:
    words = text(reported.html)
    for stage in reported.calibration.stages:
        assert f"{stage.rms_px:.3f} px" in words
        assert f"{10 * stage.rmse_cm:.3f} mm" in words
    assert "2558.36" in words
    origin = reported.calibration.request.provenance
    assert origin
    assert origin.session_sha256
    assert origin.session_sha256 in words
    assert origin.packages["torch"] in words
    assert (
        f"calib fit {reported.session} --grid 6x6 --free none --folds 3 -o"
        f" {reported.session / 'calibration'}" in words
    )


def made_of(calibration: Calibration, session: str) -> Calibration:
    request = replace(calibration.request, provenance=Provenance(session=session))
    return replace(calibration, request=request)


@pytest.mark.usefixtures("without_figures")
def test_the_title_names_the_camera_or_none(small_calibration: Calibration, tmp_path: Path) -> None:
    for model, title in (
        ("Pi <2>", "Calibration of Pi &lt;2&gt;"),
        ("", "Calibration of a camera"),
    ):
        with_model = replace(
            small_calibration, camera=replace(small_calibration.camera, model=model)
        )
        assert f"<title>{title}</title>" in report_in(tmp_path, with_model).read_text()


def test_the_worst_view_comes_first(reported: Reported) -> None:
    errors = [
        float(error) for error in re.findall(r'<span class="number">([\d.]+)\xa0px', reported.html)
    ]
    assert len(errors) == 45
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > errors[-1]


def test_text_from_files_is_text(small_calibration: Calibration, tmp_path: Path) -> None:
    hostile = replace(
        small_calibration,
        camera=replace(small_calibration.camera, model=HOSTILE),
        views=(replace(small_calibration.views[0], name=HOSTILE), *small_calibration.views[1:]),
        rejected=(RejectedPicture(HOSTILE, HOSTILE),),
        request=FitRequest(provenance=Provenance(session=HOSTILE, packages={HOSTILE: HOSTILE})),
    )
    effects = [EffectRow(HOSTILE, 0.4, 0.1, (HOSTILE,), HOSTILE)]
    html = report_in(tmp_path, hostile, effects=effects).read_text()
    assert len(scripts_of(html)) == 3
    assert 'alert("1")' not in html
    assert data_of(html)["views"]["name"][0] == HOSTILE
    assert text(html).count(HOSTILE) >= 8


def test_a_calibration_opened_elsewhere_shows_its_errors_without_pictures(
    small_calibration: Calibration, tmp_path: Path
) -> None:
    gone = made_of(small_calibration, str(tmp_path / "gone" / "session"))
    html = report_in(tmp_path, gone).read_text()
    assert "<img" not in html
    assert "only lines and corners are drawn" in html
    assert html.count('<div class="shot"') == len(small_calibration.views)
    assert "pictures were not found" in html


def test_a_session_that_moved_with_its_calibration_is_found(
    small_calibration: Calibration, reported: Reported, tmp_path: Path
) -> None:
    """Pictures that can not be read any more, or are another camera's, are left out."""
    (tmp_path / "frames").mkdir()
    (tmp_path / "calibration").mkdir()
    picture = (reported.session / "frames" / reported.calibration.views[0].name).read_bytes()
    other_picture = cv2.imencode(".jpg", np.zeros((480, 640), np.uint8))[1].tobytes()
    for view, data in zip(
        small_calibration.views, (picture, b"", b"no picture", other_picture, picture), strict=False
    ):
        (tmp_path / "frames" / view.name).write_bytes(data)
    moved = made_of(small_calibration, "/nowhere/session")
    assert (
        report_in(tmp_path / "calibration", moved)
        .read_text()
        .count('<div class="shot" style="aspect-ratio: 3280/2464"><img')
        == 2
    )


@pytest.mark.usefixtures("without_figures")
def test_effects_have_a_row_each(
    reported: Reported, small_calibration: Calibration, tmp_path: Path
) -> None:
    rows = [
        EffectRow("board_shape", 0.59, 0.17, ("x -1.04 ± 0.02 mm",), "It bends."),
        EffectRow("focal", 0.17, 0.16, ()),
    ]
    html = report_in(tmp_path, small_calibration, effects=rows).read_text()
    words = text(html[html.index('<section id="effects"') :])
    assert "board_shapeIt bends. 0.590 px 0.170 px-71 %x -1.04 ± 0.02 mm" in words
    assert 'id="effects"' not in reported.html


@pytest.mark.usefixtures("without_figures")
def test_what_the_views_do_not_tell_apart_is_named(
    small_calibration: Calibration, tmp_path: Path
) -> None:
    """In the head, below the table of the effects, and in the last lines of every command."""
    shape = replace(small_calibration.history, diagnosis=DIAGNOSED)
    diagnosed = replace(small_calibration, history=shape)
    row = EffectRow("board_shape", 0.59, 0.17, ())
    words = text(report_in(tmp_path, diagnosed, effects=[row]).read_text())
    assert f"Note: {FAMILY.note}" in words
    assert str(FAMILY) in words
    assert "plain fit 0.500 px1.000 mm 0.600 px" in words
    assert "with effects 0.100 px0.200 mm 0.150 px (-75 %)" in words
    assert judge(diagnosed).notes == (
        "board_shape (87 %) is the most likely cause; it may be rolling_shutter (13 %) as well.",
    )


def test_depths_are_those_asked_for(small_calibration: Calibration, tmp_path: Path) -> None:
    html = report_in(tmp_path, small_calibration, (5.0, 0.3, 0.9, 2.0)).read_text()
    figures = data_of(html)["figures"]
    assert figures["distortion"]["depths"] == [0.3, 5.0]
    assert figures["sigma"]["depths"] == [0.3, 0.9, 2.0]


def test_a_report_without_covariance_has_no_sigmas(
    small_calibration: Calibration, tmp_path: Path
) -> None:
    html = report_in(
        tmp_path, replace(small_calibration, covariance=np.zeros((0, 0))), (0.7,)
    ).read_text()
    assert 'id="sigma"' not in html
    assert "sigma" not in data_of(html)["figures"]["glass"]
    assert "does not predict" in html
    assert data_of(html)["figures"]["distortion"]["depths"] == [0.7, 1.3], "and the farthest corner"


def test_a_file_name_that_is_no_utf_8_and_one_that_a_terminal_would_obey(
    small_calibration: Calibration, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    names = ("caf\udce9.png", "a\x1b[2Jb\ncalib: all is well.png", "[/b][link=x]y.png")
    looks = tuple(Redetection(name, new_corners=1, refused=0, dropped=0) for name in names)
    odd = replace(
        with_outcome(small_calibration, redetections=looks),
        views=(
            *(
                replace(view, name=name)
                for view, name in zip(small_calibration.views, names, strict=False)
            ),
            *small_calibration.views[len(names) :],
        ),
        rejected=tuple(RejectedPicture(name, "no board") for name in names),
    )
    report_in(tmp_path, odd)
    odd.save(tmp_path)
    back = Calibration.load(tmp_path)
    assert tuple(view.name for view in back.views[: len(names)]) == names
    assert tuple(item.name for item in back.rejected) == names
    assert back.outcome.redetections == looks
    print_fit(back, 1.0)
    assert main(["report", "--no-open", str(tmp_path)]) == 0
    printed = "".join(capfd.readouterr())
    shown = r"caf\xe9.png, a\x1b[2Jb\ncalib: all is well.png, [/b][link=x]y.png"
    assert f"Not used: {shown}: no board." in printed
    assert "\x1b[2J" not in printed


def test_a_diagnosed_calibration_shows_its_residuals_before_and_after(
    small_calibration: Calibration, tmp_path: Path
) -> None:
    """The earlier calibration is read from where the diagnosis found it. Where it is gone, or holds
    other views, the figure is left out.
    """
    before, after = tmp_path / "before", tmp_path / "after"
    small_calibration.save(before)
    better = with_requested(small_calibration, ("cover_offset",), Silent())
    record_diagnosis(better, before, None).save(after)
    assert main(["report", "--no-open", str(after)]) == 0
    html = (after / "report.html").read_text()
    data = data_of(html)["figures"]["comparison"]
    for side, calibration in (("before", small_calibration), ("after", better)):
        assert data[side]["rms"] == pytest.approx(calibration.stages[-1].rms_px, rel=1e-6)
    assert unpacked(data["before"]["views"]).shape == (12,)
    names = re.findall(r'<section id="([^"]+)"', html)
    assert names[0] == "comparison", "what the diagnosis changed comes first"
    (before / "calibration.npz").unlink()
    assert main(["report", "--no-open", str(after)]) == 0
    assert 'id="comparison"' not in (after / "report.html").read_text()
    evidence = gather_evidence(better)
    smaller_calibration = replace(small_calibration, views=small_calibration.views[1:])
    assert diagnosis_comparison(smaller_calibration, evidence) is None
    assert diagnosis_comparison(better, evidence) is None, "nothing was added"


def test_the_licences_are_of_the_versions_that_the_libraries_are_built_of() -> None:
    """npm's lock file and the licences name the same packages; the bundle says three.js's own."""
    locked = json.loads((WEB / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    versions = {
        name.removeprefix("node_modules/"): item["version"] for name, item in locked.items() if name
    }
    licences = (WEB / "licences.txt").read_text(encoding="utf-8")
    packages = re.findall(r"(?:^|, )([@\w/-]+) (\d+\.\d+\.\d+)(?=,|$)", licences, re.MULTILINE)
    assert len(packages) > 25
    for name, version in packages:
        assert versions[name] == version, name
    direct = locked[""]["dependencies"]
    assert set(direct) <= {name for name, _ in packages}
    bundle = gzip.decompress((WEB / "libraries.js.gz").read_bytes()).decode()
    assert f'"{versions["three"].split(".")[1]}"' in bundle


def test_a_report_of_the_farthest_depth(small_calibration: Calibration, tmp_path: Path) -> None:
    html = report_in(tmp_path, small_calibration, depths=(np.inf, 0.5)).read_text()
    assert "at 100 m" in text(html)


def test_the_test_comes_before_the_use_of_a_trusted_calibration() -> None:
    test, search, use = "calib evaluate out HOLDOUT", "calib diagnose out", "calib undistort out a"
    further = (test, search, use)
    words = [line.partition(":")[0].partition(">")[2] for line in _lines(Verdict((), use, further))]
    assert words[:3] == ["Test", "Next", "Then"]
    html = commands_html(Verdict((), use, further))
    assert html.count(HOLDOUT_NOTE) == 1
    assert html.index(test) < html.index(HOLDOUT_NOTE) < html.index(use)
    tested = commands_html(Verdict((), use, further, is_tested=True))
    assert TESTED_NOTE in tested
    assert HOLDOUT_NOTE not in tested
    doubt = Reason("look.", search)
    lines = _lines(Verdict((doubt,), use, further))
    assert [search in lines[0], test in lines[1], use in lines[2]] == [True] * 3
    useless = replace(doubt, word=Trust.DO_NOT_USE)
    assert len(_lines(Verdict((useless,), use, further))) == 1


def _lines(verdict: Verdict) -> list[str]:
    return re.findall(r'<p class="command.*', commands_html(verdict))


def test_a_command_in_a_sentence_is_code() -> None:
    assert sentence_html("try `calib fit <a>`.") == "try <code>calib fit &lt;a&gt;</code>."


def test_a_report_does_not_send_its_reader_to_itself() -> None:
    reason = Reason("the error is not all noise.", "calib report out")
    html = commands_html(Verdict((reason,), "", ("calib evaluate out HOLDOUT",)))
    assert "Next: look at the figures below." in html
    assert "calib report" not in html
    assert "calib evaluate out HOLDOUT" in text(html)
