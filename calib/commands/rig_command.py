"""The command `calib rig`."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands import rig_diagnosis
from calib.commands.arguments import add_output, add_overwrite, finite_depth
from calib.commands.effect_names import effect_names_help
from calib.commands.fit_options import add_effects, add_fit_options
from calib.commands.parser import Help

if TYPE_CHECKING:
    from calib.rig.rig import Rig

SUMMARY = "Calibrate several cameras behind covers together, and measure with them."
DESCRIPTION = """
RIG is a rig.yaml, or a folder that holds one. It names the cameras, each with a session of its own,
and says which of their pictures belong together: docs/rigs.md.
"""
EXAMPLES = (
    "calib rig fit pair -o pair/calibration",
    "calib rig diagnose pair/calibration",
)
ACTION_EXAMPLES = {
    "fit": "calib rig fit pair -o pair/calibration",
    "evaluate": "calib rig evaluate pair/calibration holdout",
    "check": "calib rig check pair/calibration today",
    "diagnose": "calib rig diagnose pair/calibration",
    "rectify": "calib rig rectify pair/calibration --depth 0.8 -o pair/maps",
    "depth": "calib rig depth pair/calibration left.png right.png --depths 0.4 3 -o depth",
    "export": "calib rig export pair/calibration --format ros --depth 0.8 -o ros",
}
QUIET = "print no progress and no remarks"
QUIET_WITH_VERDICT = "print the files and the verdict: no progress and no remarks"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    fit = _add_action(actions, "fit", "Calibrate all cameras of a rig, and where they are mounted.")
    _add_rig(fit, "the rig.yaml, or its folder")
    add_output(fit, "folder for the results (default: RIG/calibration)", required=False)
    add_overwrite(fit)
    add_effects(
        fit,
        "causes of error to add to the model: auto finds those that held-out placements confirm, as"
        " calib rig diagnose does; NAME,... adds those listed under Effects, to each camera that"
        " can have them; none adds nothing, not even a bend of the board (default: the"
        " board's bend, if the views show one)",
    )
    add_fit_options(fit)
    fit.epilog = effect_names_help()
    evaluate = _add_action(
        actions,
        "evaluate",
        "Measure the error of a calibrated rig on pictures that were not fitted: with one pose of"
        " the board for all cameras, and of lengths on the board.",
    )
    evaluate.add_argument(
        "calibration", type=Path, metavar="CALIBRATION", help="the folder that calib rig fit wrote"
    )
    _add_rig(evaluate, "a rig.yaml with held-out pictures, or its folder")
    check = _add_action(
        actions,
        "check",
        "Check with a few pictures whether the cameras are still where they were, and find what"
        " changed. Exit code 0: valid; 3: the pictures contradict each other; 5: degraded or"
        " broken.",
    )
    check.add_argument(
        "calibration", type=Path, metavar="CALIBRATION", help="the folder that calib rig fit wrote"
    )
    _add_rig(check, "a rig.yaml with new pictures, or its folder")
    diagnose = _add_action(actions, "diagnose", rig_diagnosis.SUMMARY)
    rig_diagnosis.add_arguments(diagnose)
    rectify = _add_action(
        actions,
        "rectify",
        "Make the maps that show a point in the same row of both pictures of a pair, at one depth;"
        " and say by how many pixels the rows differ at other depths.",
    )
    depth_action = _add_action(
        actions,
        "depth",
        "Make a depth picture in metres, with its sigma, from a picture of each camera of a pair.",
    )
    export = _add_action(
        actions, "export", "Write a calibrated rig in the formats of other programs."
    )
    for action in (rectify, depth_action, export):
        action.add_argument(
            "calibration",
            type=Path,
            metavar="CALIBRATION",
            help="the folder that calib rig fit wrote",
        )
        add_output(action, "folder for the results", required=True)
        add_overwrite(action)
        action.add_argument(
            "--pair",
            nargs=2,
            metavar=("LEFT", "RIGHT"),
            help="the cameras of the pair, by name (default: the first two of the rig)",
        )
    for action in (rectify, export):
        action.add_argument(
            "--depth", type=finite_depth, required=True, metavar="METRES", help="depth, in metres"
        )
    rectify.add_argument(
        "--depths",
        type=finite_depth,
        nargs=2,
        metavar=("NEAR", "FAR"),
        help="depths between which the rows should agree best (default: half and twice --depth)",
    )
    depth_action.add_argument("left", type=Path, metavar="PICTURE", help="of the left camera")
    depth_action.add_argument("right", type=Path, metavar="PICTURE", help="of the right camera")
    depth_action.add_argument(
        "--depths",
        type=finite_depth,
        nargs=2,
        required=True,
        metavar=("NEAR", "FAR"),
        help="the nearest and the farthest depth to search, in metres",
    )
    export.add_argument(
        "--format",
        choices=["opencv", "ros", "kalibr", "colmap", "mrcal", "depthai", "caliscope"],
        required=True,
        help="opencv: stereo.yml; ros: a camera_info a camera; kalibr: a camchain; colmap: a sparse"
        " model with rigs.txt; mrcal: a .cameramodel a camera; depthai: the calibration of a"
        " Luxonis board; caliscope: a camera array",
    )
    for action in (fit, evaluate, check, diagnose, rectify, depth_action, export):
        action.add_argument("--json", action="store_true", help="print one JSON object")
        words = QUIET_WITH_VERDICT if action in (fit, diagnose) else QUIET
        # The command's own --quiet stands before ACTION.
        action.add_argument(
            "-q", "--quiet", action="store_true", default=argparse.SUPPRESS, help=words
        )


def _add_action(
    actions: "argparse._SubParsersAction[argparse.ArgumentParser]", name: str, summary: str
) -> argparse.ArgumentParser:
    example = ACTION_EXAMPLES[name]
    return actions.add_parser(
        name,
        help=summary,
        description=f"{summary}\n\nExample:\n  {example}",
        formatter_class=Help,
        example=example,
    )


def _add_rig(parser: argparse.ArgumentParser, help_text: str) -> None:
    parser.add_argument("rig", type=Path, metavar="RIG", help=help_text)


def run(args: argparse.Namespace) -> int | None:
    actions: dict[str, Callable[[argparse.Namespace], int | None]] = {
        "fit": _fit,
        "evaluate": _evaluate,
        "check": _check,
        "diagnose": rig_diagnosis.run,
        "rectify": _rectify,
        "depth": _depth,
        "export": _export,
    }
    return actions[args.action](args)


def _fit(args: argparse.Namespace) -> None:
    import time

    from calib.commands.fit_options import AUTO, effects_of, settings_of
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.commands.console import Bars
        from calib.commands.printing import print_json, verdict_mapping
        from calib.commands.rig_diagnosis_lines import print_rig_diagnosis
        from calib.commands.rig_lines import print_rig, rig_json
        from calib.commands.verdict_lines import print_verdict
        from calib.errors import InputError
        from calib.io.output_folder import check_no_link
        from calib.report.write import NAME
        from calib.rig.diagnose_rig import diagnose_rig
        from calib.rig.fit_rig import fit_rig
        from calib.rig.judge import judge_rig
        from calib.rig.report import write_rig_report
        from calib.rig.rig_file import read_rig
        from calib.rig.rig_storage import RigFiles

    start = time.monotonic()
    description = read_rig(args.rig)
    output = args.output or check_no_link(description.file.parent / "calibration")
    if output.resolve() in {session.path.resolve() for session in description.sessions.values()}:
        raise InputError(
            f"{output} is the session of a camera of this rig: name another folder by -o."
        )
    files = RigFiles(
        output,
        tuple(description.sessions),
        overwrite=args.overwrite,
        inputs=description.files,
    )
    with files:
        files.reserve([NAME])
        with Bars() as bars:
            settings, effects = settings_of(args), effects_of(args)
            diagnosis = None
            if effects == AUTO:
                rig, diagnosis = diagnose_rig(fit_rig(description, settings, bars), bars)
            else:
                rig = fit_rig(description, settings, bars, effects=effects)
        written = files.write(rig)
        verdict = judge_rig(rig, folder=output)
        try:
            written.append(write_rig_report(rig, verdict, files.rig))
        finally:  # if the report fails, the calibration is still written
            files.commit()
    seconds = time.monotonic() - start
    if args.json:
        print_json(rig_json(rig, seconds) | verdict_mapping(verdict, written))
        return
    if not args.quiet:
        print_rig(rig, seconds)
        if diagnosis:
            print_rig_diagnosis(diagnosis)
    print_verdict(verdict, written)


def _evaluate(args: argparse.Namespace) -> None:
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.commands.console import Bars
        from calib.commands.printing import print_json, verdict_mapping
        from calib.commands.rig_lines import evaluation_json, print_rig_evaluation
        from calib.commands.verdict_lines import print_verdict
        from calib.rig.evaluate_rig import evaluate_rig
        from calib.rig.judge import judge_rig
        from calib.rig.rig import Rig

    rig = Rig.load(args.calibration)
    with Bars() as bars:
        evaluation = evaluate_rig(rig, args.rig, bars)
    folder = args.calibration if args.calibration.is_dir() else args.calibration.parent
    verdict = judge_rig(rig, folder=folder, evaluation=evaluation)
    if args.json:
        print_json(evaluation_json(evaluation) | verdict_mapping(verdict, []))
        return
    print_rig_evaluation(evaluation)
    print_verdict(verdict, [])


def _check(args: argparse.Namespace) -> int:
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.checking.result import CheckStatus
        from calib.commands.check_command import NOT_VALID
        from calib.commands.console import Bars
        from calib.commands.printing import print_json
        from calib.commands.rig_check_lines import next_rig_command, print_rig_check
        from calib.errors import NotEnoughDataError
        from calib.rig.check_rig import check_rig

    with Bars() as bars:
        result = check_rig(args.calibration, args.rig, bars)
    folder = args.calibration if args.calibration.is_dir() else args.calibration.parent
    following = next_rig_command(result, folder, args.rig)
    if args.json:
        print_json(result.as_json() | {"next": following, "written": []})
    else:
        print_rig_check(result, following)
    exit_codes = {CheckStatus.VALID: 0, CheckStatus.UNDECIDED: NotEnoughDataError.exit_code}
    return exit_codes.get(result.status, NOT_VALID)


def _rectify(args: argparse.Namespace) -> None:
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.commands.printing import print_json, print_paths
        from calib.commands.rig_lines import print_rows, rectification_json
        from calib.io.file_set import FileSet
        from calib.rig.rectify import rectify
        from calib.rig.rectify_files import rectification_files
        from calib.rig.rig import Rig

    rig = Rig.load(args.calibration)
    depths = tuple(args.depths) if args.depths else None
    with FileSet(args.output, overwrite=args.overwrite) as files:
        pair = rectify(rig, _pair(args, rig), args.depth, depths)
        written = [files.write(name, data) for name, data in rectification_files(pair).items()]
        files.commit()
    if args.json:
        print_json(rectification_json(pair) | {"written": [str(path) for path in written]})
        return
    print_rows(pair)
    print_paths(written)


def _depth(args: argparse.Namespace) -> None:
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.commands.printing import print_json, print_paths
        from calib.commands.rig_lines import depth_json, print_depth
        from calib.io.file_set import FileSet
        from calib.io.images import read_grey
        from calib.rig.depth import depth_picture
        from calib.rig.rectify import rectify
        from calib.rig.rectify_files import depth_files
        from calib.rig.rig import Rig

    rig = Rig.load(args.calibration)
    near, far = sorted(args.depths)
    pictures = read_grey(args.left), read_grey(args.right)
    with FileSet(args.output, overwrite=args.overwrite, inputs=(args.left, args.right)) as files:
        # Exact in the middle of the range of disparities.
        pair = rectify(rig, _pair(args, rig), 2 / (1 / near + 1 / far), (near, far))
        picture = depth_picture(rig, pair, pictures, (near, far))
        written = [files.write(name, data) for name, data in depth_files(picture).items()]
        files.commit()
    if args.json:
        print_json(depth_json(picture) | {"written": [str(path) for path in written]})
        return
    print_depth(picture)
    print_paths(written)


def _export(args: argparse.Namespace) -> None:
    from calib.commands.loading import fast_imports

    with fast_imports():
        from calib.commands.printing import print_json, print_paths
        from calib.commands.rig_lines import misfits_json, print_misfits
        from calib.io.file_set import FileSet
        from calib.io.numerals import depth_text
        from calib.rig.central_rig import CentralRig
        from calib.rig.exports import RIG_FORMATS
        from calib.rig.rig import Rig

    rig = Rig.load(args.calibration)
    names = _pair(args, rig) if args.pair else rig.names
    form = next(form for form in RIG_FORMATS if form.name == args.format)
    with FileSet(args.output, overwrite=args.overwrite) as files:
        central = CentralRig.of(rig, names, args.depth, form.lenses)
        texts = form.files(central, depth_text(args.depth))
        written = [files.write(name, text) for name, text in texts.items()]
        files.commit()
    if args.json:
        print_json(misfits_json(central) | {"written": [str(path) for path in written]})
        return
    print_misfits(central)
    print_paths(written)


def _pair(args: argparse.Namespace, rig: "Rig") -> tuple[str, str]:
    """Return the names of the left and the right camera."""
    from calib.errors import InputError

    names = tuple(args.pair or rig.names[:2])
    for name in names:
        rig.index(name)
    if len(names) != 2:
        raise InputError("The rig has one camera, and a pair needs two: fit a rig of two cameras.")
    return names[0], names[1]
