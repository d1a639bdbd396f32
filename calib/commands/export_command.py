"""The command `calib export`."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.commands.arguments import (
    add_calibration,
    add_depths,
    add_output,
    add_overwrite,
    calibration_files,
)
from calib.commands.loading import fast_imports
from calib.errors import InputError, harmless
from calib.export.formats import AXES, FORMATS, ExportLens, Format

if TYPE_CHECKING:
    from calib.export.central import CentralModel
    from calib.export.export import ExportedFiles

SUMMARY = "Write a calibration for other programs, as maps or as a central camera."
DESCRIPTION = """
A map is exact at its depth. A central camera, whose rays meet in one point, only approximates a
camera behind a cover. calib export fits one at each --depth. It prints the misfit at this depth, at
half of it and at twice of it, and writes it into the file.
"""
EXAMPLES = (
    "calib export cam0/calibration --format opencv --depth 1 -o maps",
    "calib export cam0/calibration --format npz --depth 0.5 1 2 -o maps",
)
COMMON = {
    "CALIBRATION": "calibration.yaml, or its folder",
    "--format": "one of the formats below",
    "--depth": "distances of the scene that maps are for",
    "-o": "folder for the files",
    "--lens": "distortion model of a central camera",
    "--axes": "axes of a ray image",
}

MAX_NAMES = 3
"""The number of old files that a message names: people do not read a longer list."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "--format",
        choices=[form.name for form in FORMATS],
        required=True,
        metavar="FORMAT",
        help="the file format, as listed below",
    )
    add_depths(parser, required=False)
    lenses = "; ".join(
        f"{form.name}: {', '.join(lens.name for lens in form.lenses)}"
        for form in FORMATS
        if form.lenses
    )
    parser.add_argument(
        "--lens",
        metavar="NAME",
        help=f"distortion model of a central camera (default: the best one); {lenses}",
    )
    axes = (
        "axes of a ray image: opencv (x right, y down, z forward) or opengl (x right, y up, z"
        " backward) (default: opencv)"
    )
    parser.add_argument("--axes", choices=AXES, help=axes)
    parser.add_argument(
        "--channels",
        action="store_true",
        help=(
            "write the files of each colour into red/, green/ and blue/: session.yaml needs the"
            " glass's Abbe number"
        ),
    )
    add_output(parser, "folder for the files", required=True)
    add_overwrite(parser)
    parser.usage = "%(prog)s CALIBRATION --format FORMAT -o DIR [options]"
    parser.epilog = _formats_help({form.name: form.summary for form in FORMATS})


def common_epilog() -> str:
    """Return a line for each format."""
    return _formats_help({form.name: form.brief or form.summary for form in FORMATS})


def _formats_help(summaries: Mapping[str, str]) -> str:
    kinds = (("maps", lambda form: not form.lenses), ("central cameras", lambda form: form.lenses))
    return "\n".join(
        f"{title}:\n"
        + "\n".join(f"  {f.name:<14}{summaries[f.name]}" for f in FORMATS if belongs(f))
        for title, belongs in kinds
    )


def run(args: argparse.Namespace) -> None:
    form = next(form for form in FORMATS if form.name == args.format)
    lenses = _lenses(form, args.lens)
    if form.needs_depth and not args.depth:
        raise InputError(
            f"--format {form.name} holds for one depth: write the distance of the scene in metres,"
            " such as --depth 1.0."
        )

    if args.axes and form.name != "ray-image":
        raise InputError(
            f"--axes holds for a ray image only, not for --format {form.name}: drop --axes, or"
            " write --format ray-image."
        )
    if not form.writable:
        raise InputError(form.lacking)

    with fast_imports():
        from contextlib import ExitStack

        from calib.apply.asked_depths import describe_all
        from calib.apply.colour import channel_calibration, check_dispersion
        from calib.calibration import Calibration
        from calib.commands.console import Bars
        from calib.commands.printing import print_paths, print_remark
        from calib.export.export import ExportRequest, export
        from calib.export.file_names import file_names
        from calib.export.outdated_files import find_outdated_files
        from calib.io.file_set import FileSet
        from calib.session.dispersion import CHANNELS

    calibration = Calibration.load(args.calibration)
    inputs = calibration_files(args.calibration)
    folders = {args.output: calibration}
    if args.channels:
        check_dispersion(calibration)
        folders = {args.output / c: channel_calibration(calibration, c) for c in CHANNELS}
    camera = calibration.camera
    depths = tuple(dict.fromkeys(args.depth))
    axes = args.axes or AXES[0]
    for remark in describe_all(calibration, depths):
        print_remark(remark)
    names = file_names(form, depths, (camera.width, camera.height), axes)
    exports = []
    with Bars() as bars, ExitStack() as stack:
        file_sets = []
        for folder in folders:
            files = FileSet(folder, overwrite=args.overwrite, inputs=inputs)
            file_sets.append(stack.enter_context(files))
            files.reserve(names)
        for files, channel in zip(file_sets, folders.values(), strict=True):
            request = ExportRequest(channel, form, lenses, depths, files, bars, axes)
            exports.append(export(request))
        for files in file_sets:
            files.commit()
    print_paths([path for exported in exports for path in exported.paths])
    for exported in exports:
        _print_remarks(form, exported, find_outdated_files(exported.paths, inputs[0]))


def _lenses(form: Format, name: str | None) -> tuple[ExportLens, ...]:
    if name is None:
        return form.lenses
    chosen = tuple(lens for lens in form.lenses if lens.name == name)
    if not chosen:
        names = ", ".join(lens.name for lens in form.lenses)
        advice = f"write one of {names}" if names else "drop --lens, as this format holds maps"
        raise InputError(f"the format {form.name} has no lens model {name}: {advice}.")
    return chosen


NEGLIGIBLE = 5e-5
"""px: a misfit that is printed as zero."""


def _misfit_words(model: "CentralModel") -> str:
    """Return a sentence on the model's misfit at its depth, and at half and double of it."""
    errors = ", ".join(
        f"{_brief_px(misfit.rms_px, 3)} px RMS (at most {_brief_px(misfit.worst_px, 2)} px) at"
        f" {misfit.depth:g} m"
        for misfit in model.misfits
    )
    lens = model.lens.name
    words = f"{lens} coefficients" if lens.isdigit() else f"the lens {lens}"
    return f"with {words}, it is off by {errors}."


def _brief_px(value: float, digits: int) -> str:
    """Return a length in px with this number of decimals; a small one with its first digit."""
    small = NEGLIGIBLE < value < 10.0 ** (1 - digits)
    return f"{value:.1g}" if small else f"{value:.{digits}f}"


def _print_remarks(form: Format, exported: "ExportedFiles", old: Sequence[Path]) -> None:
    """Print the misfits and remarks on stderr, because stdout lists the files."""
    from rich.console import Console

    console = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)
    for model in exported.models:
        console.print(f"{form.name}: {_misfit_words(model)}")
        for remark in model.remarks():
            console.print(f"Take care: {remark}")
    for remark in exported.remarks:
        console.print(remark)
    if old:
        names = harmless(" ".join(path.name for path in old[:MAX_NAMES]))
        surplus = f" and {len(old) - MAX_NAMES} more" if len(old) > MAX_NAMES else ""
        verb = "come" if old[1:] else "comes"
        console.print(
            f"{names}{surplus} in the same folder {verb} from an earlier fit: remove what you do"
            " not need any more."
        )
