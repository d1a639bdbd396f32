"""The command `calib fit`."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import add_camera, add_depths, add_output, add_overwrite
from calib.commands.described_session import COMMON as DESCRIPTIONS
from calib.commands.described_session import add_description, has_description, session_of
from calib.commands.effect_names import effect_names_help
from calib.commands.fit_options import (
    AUTO,
    add_effects,
    add_fit_options,
    effects_of,
    settings_of,
)
from calib.commands.loading import fast_imports
from calib.commands.printing import print_remark

if TYPE_CHECKING:
    from calib.calibration import Calibration
    from calib.diagnosis.finding import Diagnosis
    from calib.progress import Progress
    from calib.verdict.verdict import Verdict

SUMMARY = "Calibrate a session: a folder of pictures in, a calibration and undistortion maps out."
DESCRIPTION = """
SESSION is a folder with session.yaml and pictures, in frames/ or beside it. Or give pictures alone:
a folder, files, a pattern such as 'photos/*.jpg', or a video. The options on board, cover and
camera then describe them, and the command writes session.yaml. Without --board it looks for a board
and says what it found. The options update a session.yaml that Refracal wrote. If you have edited
it, change the values there.

The folder of the results gets calibration.yaml with calibration.npz, the ray field, a map for every
--depth, and report.html, which says whether to trust the result.
"""
EXAMPLES = (
    "calib fit photos --board 9x6 --square-mm 25 --cover dome --radius 40+-5",
    "calib fit pool --board 9x6 --square-mm 25 --cover flat --outside-index 1.333",
    "calib fit cam0 --depth 0.5 1",
)
COMMON = DESCRIPTIONS | {
    "-o": "results (default: SESSION/calibration)",
    "--depth": "distances of the scene that maps are for",
    "--effects": "auto: find causes of error, as diagnose does",
}
QUIET = "print the files and the verdict: no progress, no remarks and no tables"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session", type=Path, nargs="+", metavar="SESSION", help="the session, pictures or a video"
    )
    output = parser.add_argument_group("output")
    add_depths(output, required=False)
    add_output(output, "folder for the results (default: SESSION/calibration)", required=False)
    add_overwrite(output)
    output.add_argument("--json", action="store_true", help="print one JSON object")
    camera = add_description(
        parser, "for pictures without a session.yaml", " (default: the board in the pictures)"
    )
    add_camera(camera)
    method = parser.add_argument_group("fit")
    add_effects(
        method,
        "causes of error to add to the model: auto finds those that held-out views confirm, as"
        " calib diagnose does; NAME,... adds those listed under Effects; none adds nothing, not"
        " even a bend of the board (default: the board's bend, if the views show one)",
    )
    add_fit_options(method)
    parser.usage = "%(prog)s SESSION ... [options]"
    parser.epilog = effect_names_help()


def run(args: argparse.Namespace) -> None:
    import time

    with fast_imports():
        from calib.apply.asked_depths import ReachedDepths, describe_depths
        from calib.calibration_file import DERIVED, FILES
        from calib.commands.console import Bars
        from calib.commands.verdict_lines import print_verdict
        from calib.diagnosis.possible_effects import check_possible
        from calib.errors import InputError
        from calib.export.npz import npz_file_names, write_npz
        from calib.fitting.fit import fit
        from calib.fitting.provenance import record_request
        from calib.io.file_set import FileSet
        from calib.io.output_folder import check_no_link
        from calib.report.write import NAME, write_report
        from calib.verdict.judge import judge

    start = time.monotonic()
    with Bars() as bars:
        described = session_of(args, bars)
    session = described.session
    output = args.output or check_no_link(session.path / "calibration")
    effects = effects_of(args)
    settings = settings_of(args)
    if effects != AUTO:
        check_possible(session, settings, effects)
    with (
        _naming_description(session.path, described.earlier, written=has_description(args)),
        FileSet(output, overwrite=args.overwrite, inputs=session.files) as files,
    ):
        files.reserve([*FILES, *npz_file_names(args.depth), NAME])
        with Bars() as bars:
            before = fit(session, settings, bars)
            calibration, finding = _with_effects(before, effects, bars)
            reached = ReachedDepths.of(calibration.ray_field(), args.depth)
            depths = reached.depths
            calibration = record_request(calibration, effects, depths)
            written = [calibration.write(files), *write_npz(calibration, depths, files, bars)]
        seconds = time.monotonic() - start
        try:
            with Bars() as bars:
                written.append(write_report(calibration, files, bars, depths, before=before))
        finally:  # if the report fails, the calibration is still written and printed
            removed = files.commit(instead_of=DERIVED)
            written += [described.file] if described.file else []
            verdict = judge(calibration, depths=depths, folder=output, session=session.path)
            if args.json:
                _print_json(calibration, depths, seconds, verdict, written)
            else:
                if not args.quiet:
                    _print_tables(calibration, depths, seconds, verdict, finding)
                print_verdict(verdict, written, verdict.further)
    if removed:
        names = ", ".join(removed)
        print_remark(f"Removed {names}, of the earlier fit: --depth writes maps.")
    for remark in describe_depths(calibration, depths):
        print_remark(remark)
    if reached.refusals:
        raise InputError(f"The calibration is written, a map is not: {reached.refusals[0]}")


def _with_effects(
    calibration: "Calibration", effects: Sequence[str], progress: "Progress"
) -> "tuple[Calibration, Diagnosis | None]":
    """Return the calibration with the effects that were asked for, and the diagnosis that found
    them, if they were asked for by AUTO.
    """
    if effects == AUTO:
        from calib.diagnosis.diagnose import diagnose

        return diagnose(calibration, progress)
    if effects:
        from calib.diagnosis.requested_effects import with_requested

        calibration = with_requested(calibration, effects, progress)
    return calibration, None


def _print_json(
    calibration: "Calibration",
    depths: Sequence[float],
    seconds: float,
    verdict: "Verdict",
    written: Sequence[Path],
) -> None:
    """Print the JSON object of the command contract. The first written path is the calibration."""
    from calib.apply.colour import predict_fringes
    from calib.commands.colour_lines import fringes_mapping
    from calib.commands.printing import print_json, verdict_mapping
    from calib.fitting.description import calibrated_numbers

    print_json(
        summary(calibration, seconds)
        | fringes_mapping(predict_fringes(calibration, depths))
        | calibrated_numbers(calibration)
        | {"calibration": str(written[0])}
        | verdict_mapping(verdict, written)
    )


def _print_tables(
    calibration: "Calibration",
    depths: Sequence[float],
    seconds: float,
    verdict: "Verdict",
    finding: "Diagnosis | None",
) -> None:
    """Print the tables of the fit and of the diagnosis, if there was one."""
    from calib.apply.colour import predict_fringes
    from calib.commands.colour_lines import fringes_lines
    from calib.commands.console import print_fit

    print_fit(calibration, seconds, verdict)
    for line in fringes_lines(predict_fringes(calibration, depths)):
        print(line)
    if finding:
        from calib.commands.diagnosis_table import print_diagnosis

        print_diagnosis(finding, calibration)


@contextmanager
def _naming_description(session: Path, earlier: bytes | None, *, written: bool) -> Iterator[None]:
    """If the fit fails, say that the session.yaml that the options gave remains; or write the
    earlier one again, if a fit with it has worked or is at work.
    """
    from calib.errors import RefracalError
    from calib.io.folder_lock import BusyError
    from calib.io.output_folder import OutputFolder

    try:
        yield
    except RefracalError as error:
        if not written:
            raise
        file = session / "session.yaml"
        if not ((session / "calibration").exists() or isinstance(error, BusyError)):
            remark = (
                f"{file} has what your options say. If that is wrong,"
                " type the command again with other values."
            )
            print_remark(remark)
        elif earlier:
            OutputFolder(session, flag="").write(file.name, earlier)
            remark = f"{file} is as it was before this command."
            print_remark(remark)
        raise


def summary(calibration: "Calibration", seconds: float) -> dict[str, object]:
    """Return the JSON object of the command contract."""
    from calib.corners.copies import describe_still

    intrinsics = calibration.camera.intrinsics
    record = calibration.record()
    assert intrinsics
    return {
        "frames_used": len(calibration.views),
        "frames_rejected": [{"file": r.name, "reason": r.reason} for r in calibration.rejected],
        "corners": sum(view.count for view in calibration.views),
        "still_boards": describe_still(calibration.views),
        "second_look": record.get("second_look", []),
        "outlier_corners": record.get("outlier_corners", {}),
        "view_noise": record.get("view_noise", {}),
        "noise_px": calibration.noise_px,
        "seconds": seconds,
        "stages": [
            {"name": s.name, "rms_px": s.rms_px, "rmse_cm": s.rmse_cm} for s in calibration.stages
        ],
        "effects": [estimate.effect.name for estimate in calibration.effects],
        "lens": {
            "model": intrinsics.model,
            "coefficients": len(intrinsics.distortion),
            "held_out_px": record.get("lens_held_out_px", {}),
        },
    } | {
        key: record[key]
        for key in ("cross_validation", "fleet_prior", "shape_log_odds", "medium_log_odds")
        if key in record
    }
