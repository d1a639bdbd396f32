"""The command `calib immerse`."""

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calib.apply.water import (
    GREEN,
    SALINITY,
    TEMPERATURE,
    WATER_ABBE,
    WAVELENGTH,
    dispersion_of_water,
    index_of_water,
)
from calib.commands.arguments import (
    add_calibration,
    add_depths,
    add_output,
    add_overwrite,
    calibration_files,
    folder_of,
    quoted,
    refuse_material,
)
from calib.commands.loading import fast_imports
from calib.errors import InputError
from calib.io.numerals import depth_text
from calib.io.shell import shell_line
from calib.rounding import with_sigma
from calib.session.dispersion import Dispersion
from calib.session.typed_number import join_sigmas

if TYPE_CHECKING:
    from calib.apply.change_medium import Immersion
    from calib.session.schema import Number

SUMMARY = "Convert a calibration to another medium: made in air, used in water."
DESCRIPTION = """
The camera and its cover stay as calibrated; only the index of the medium outside changes, to
--outside-index, or to that of water of a given --salinity and --temperature (Quan and Fry 1995).
Numbers that were not fitted, because they hardly mattered, are estimated within their tolerances
unless they are declared exact. Some numbers, such as the place of a flat window, hardly matter in
air but do in water. If the views do not determine one of them, the command says so, and how well it
must be measured. To convert back to air: --outside-index 1.
"""
EXAMPLES = (
    "calib immerse cam0/calibration --outside-index 1.333",
    "calib immerse cam0/calibration --salinity 35 --temperature 10 -o sea",
)

UNKNOWN_FACE = 0.05
"""px: a smaller difference between the two faces needs no remark."""
ASSUMED_FACE = "the maps assume the outer face"
LABEL_WIDTH = 44
"""The width of the first column of the table; longer labels take several lines."""
DEPTH_WIDTH = 12
"""The width of a column with errors in px, with its border."""
MAX_GAS_INDEX = 1.01
"""A lower index is that of a gas, whose uncertainty is negligible."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "--outside-index",
        type=_outside_index,
        metavar="N",
        help="refractive index of the medium outside, such as 1.34 for sea water, or 1 for air;"
        " 1.34+-0.001 with its standard deviation",
    )
    parser.add_argument(
        "--salinity",
        type=_parser_between(*SALINITY),
        metavar="S",
        help="salinity of the water, per mille, such as 35 for an ocean (default: 0)",
    )
    parser.add_argument(
        "--temperature",
        type=_parser_between(*TEMPERATURE),
        metavar="T",
        help="temperature of the water, degrees C (default: 15)",
    )
    parser.add_argument(
        "--wavelength",
        type=_parser_between(*WAVELENGTH),
        metavar="L",
        help="wavelength of the light, nm (default: 550)",
    )
    sigma = (
        "standard deviation of the index (default: 0.004 for a plain index of water, from fresh"
        " water to the sea's; 0.001 for described water, because the camera's colours vary; 0 for"
        " air)"
    )
    parser.add_argument("--index-sigma", type=_parser_between(0, 0.1), metavar="N", help=sigma)
    add_depths(parser, required=False)
    add_output(
        parser, "folder for the calibration (default: immersed/ beside CALIBRATION)", required=False
    )
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    index, stated_sigma = _index(args)

    with fast_imports():
        from calib.apply.change_medium import DEPTHS, immerse
        from calib.calibration import Calibration
        from calib.calibration_file import DERIVED, FILES
        from calib.commands.console import Bars
        from calib.commands.printing import print_json
        from calib.commands.program import runnable_command
        from calib.diagnosis.all_free import all_free
        from calib.export.npz import npz_file_names, write_npz
        from calib.io.file_set import FileSet
        from calib.io.output_folder import check_no_link
        from calib.session.schema import Number
        from calib.session.tolerances import ANY_WATER, WATER_INDEX

    if args.index_sigma is not None and stated_sigma is not None:
        raise InputError("--outside-index already has a sigma: drop it, or --index-sigma.")
    usual = ANY_WATER if args.outside_index is not None else WATER_INDEX
    stated_sigmas = [s for s in (args.index_sigma, stated_sigma) if s is not None]
    sigma = (*stated_sigmas, usual.sigma * (index > MAX_GAS_INDEX))[0]
    calibration = Calibration.load(args.calibration)
    depths = tuple(dict.fromkeys(args.depth))
    output = args.output or check_no_link(folder_of(args.calibration) / "immersed")
    inputs = calibration_files(args.calibration)
    with Bars() as bars, FileSet(output, overwrite=args.overwrite, inputs=inputs) as files:
        files.reserve([*FILES, *npz_file_names(depths)])
        immersion = immerse(
            all_free(calibration),
            Number(index, sigma),
            depths or DEPTHS,
            _dispersion(args, index) if calibration.cover.has_dispersion else None,
        )
        written = [
            immersion.calibration.write(files),
            *write_npz(immersion.calibration, depths, files, bars),
        ]
        files.commit(instead_of=DERIVED)
    remarks = list(_remarks(immersion))
    medium = calibration.cover.medium
    if medium and medium.value > MAX_GAS_INDEX and index > MAX_GAS_INDEX:
        remarks.append(
            f"this calibration was made with {medium.value:.5g} outside, not in air: its outside"
            f" index is now {index:.5g}."
        )
    if args.json:
        print_json(_as_mapping(immersion, remarks, [str(path) for path in written]))
        return
    _print(immersion, remarks, written, medium)
    print(f"Next: {runnable_command(_next_command(immersion, output, depths))}")
    if immersion.unknown:
        print("PICTURES are three of the board, taken in the new medium.")


def _next_command(immersion: "Immersion", output: Path, depths: Sequence[float]) -> str:
    """Return the command to type next: the check that determines what the views do not, or maps."""
    if immersion.unknown:
        return shell_line("calib", "check", output, "PICTURES", "--update")
    depth = depths[0] if depths else immersion.depths[len(immersion.depths) // 2]
    maps = ["--format", "npz", "--depth", depth_text(depth), "-o"]
    return shell_line("calib", "export", output, *maps, output / "export")


def _parser_between(low: float, high: float) -> Callable[[str], float]:
    """Return a parser of a number in this range."""

    def parse(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = float("nan")
        if not low <= number <= high:
            raise argparse.ArgumentTypeError(
                f"{quoted(text)} is out of range: write a number from {low:g} to {high:g}"
            )
        return number

    return parse


def _outside_index(text: str) -> tuple[float, float | None]:
    """Return an index, and its sigma if the text has one."""
    refuse_material(text)
    index, mark, sigma = join_sigmas(text).partition("±")
    return _parser_between(1, 2)(index), _parser_between(0, 0.1)(sigma) if mark else None


def _index(args: argparse.Namespace) -> tuple[float, float | None]:
    """Return the refractive index of the medium outside, the given one or that of the described
    water, and the sigma that is given with it.
    """
    water = (args.salinity, args.temperature, args.wavelength)
    if args.outside_index is not None:
        if any(number is not None for number in water):
            raise InputError(
                "--outside-index already fixes the index: drop it, or --salinity, --temperature and"
                " --wavelength."
            )
        index, sigma = args.outside_index
        return float(index), sigma
    if all(number is None for number in water):
        raise InputError(
            "the medium outside is not stated: write --outside-index 1.34, or --salinity 35"
            " --temperature 15 for sea water."
        )
    wavelength = GREEN if args.wavelength is None else args.wavelength
    return index_of_water(*_salinity_temperature(args), wavelength), None


def _salinity_temperature(args: argparse.Namespace) -> tuple[float, float]:
    """Return the water's salinity (per mille) and temperature (degrees C)."""
    return (
        0.0 if args.salinity is None else args.salinity,
        15.0 if args.temperature is None else args.temperature,
    )


def _dispersion(args: argparse.Namespace, index: float) -> Dispersion | None:
    """Return the dispersion of the medium outside: that of the described water, or of any water if
    only its index is given. A gas has none.
    """
    if index <= MAX_GAS_INDEX:
        return None
    if args.outside_index is not None:
        return Dispersion(abbe=WATER_ABBE)
    return dispersion_of_water(*_salinity_temperature(args))


def _remarks(immersion: "Immersion") -> Iterator[str]:
    """Yield a sentence for each limit of the result that a person must know."""
    from calib.apply.asked_depths import UNUSABLE

    if not immersion.after_px:
        yield (
            "the fit estimated no covariance, so the uncertainty of these maps is unknown: fit with"
            " --method joint."
        )
    if immersion.unknown:
        largest = max(immersion.after_px, default=0.0)
        unusable = "do not use these maps yet: " if largest > UNUSABLE else ""
        dominant = immersion.dominant[:2]
        numbers = " and ".join(parameter.words for parameter in dominant) or "a number"
        verb, pronoun = ("matter", "them") if len(dominant) > 1 else ("matters", "it")
        advice = [
            f" Or, for {parameter.words}: {parameter.advice}."
            for parameter in dominant
            if parameter.advice
        ]
        face = ""
        if _depends_on_face(immersion):
            face = f", and show which face of the glass is uneven ({ASSUMED_FACE})"
        yield (
            f"{unusable}the views do not determine {numbers}, which {verb} in the new medium."
            f" Three pictures of the board there determine {pronoun} (calib check IMMERSED PICTURES"
            f" --update){face}.{''.join(advice)}"
        )
    elif _depends_on_face(immersion):
        yield (
            "views in one medium do not show which face of the glass is uneven"
            f" ({ASSUMED_FACE}): run calib check with a few pictures that are taken in the new"
            " medium."
        )
    if immersion.unexplained:
        yield (
            f"{', '.join(immersion.unexplained)} corrects an error of unknown cause, which may be"
            " different in the new medium."
        )


def _depends_on_face(immersion: "Immersion") -> bool:
    """True if the maps depend on which face of the glass is uneven."""
    return max(immersion.other_face_px, default=0.0) > UNKNOWN_FACE


def _as_mapping(
    immersion: "Immersion", remarks: list[str], written: list[str]
) -> dict[str, object]:
    index = immersion.medium
    unknown = (None,) * len(immersion.depths)
    rows = zip(
        immersion.depths,
        immersion.before_px or unknown,
        immersion.after_px or unknown,
        immersion.other_face_px or unknown,
        strict=True,
    )
    return {
        "outside_index": {"value": index.value, "sigma": index.sigma},
        "maps": [
            {
                "depth_m": depth,
                "sigma_before_px": original_sigma,
                "sigma_px": new_sigma,
                "other_face_px": face_error,
            }
            for depth, original_sigma, new_sigma, face_error in rows
        ],
        "known": not immersion.unknown,
        "loose": [
            {
                "name": parameter.name,
                "sigma_px_if_known": list(parameter.sigma_px),
                "measured_to": parameter.measured_to,
                "unit": parameter.unit,
            }
            for parameter in immersion.dominant
        ],
        "remarks": remarks,
        "written": written,
    }


def _print(
    immersion: "Immersion", remarks: list[str], written: "list[Path]", medium: "Number | None"
) -> None:
    from rich.console import Console
    from rich.table import Table

    from calib.commands.printing import print_paths

    index = immersion.medium
    rows: list[tuple[str, Sequence[float]]] = []
    if immersion.after_px:
        original = f"{medium.value:.5g}" if medium else "before"
        rows = [
            (f"outside {original}", immersion.before_px),
            (f"outside {index.value:.5g}", immersion.after_px),
        ]
    rows += [
        (f"... with {parameter.words} exact", parameter.sigma_px)
        for parameter in immersion.dominant
    ]
    if _depends_on_face(immersion):
        rows.append(("error if the inner face is the uneven one", immersion.other_face_px))
    if rows:
        depths = [f"{depth:g} m" for depth in immersion.depths]
        table = Table("", *depths)
        table.columns[0].max_width = LABEL_WIDTH
        for column in table.columns[1:]:
            column.justify = "right"
        for label, errors in rows:
            table.add_row(label, *(f"{error:.3f} px" for error in errors))
        needed = LABEL_WIDTH + DEPTH_WIDTH * (len(depths) + 1)
        console = Console(markup=False, highlight=False)
        console.width = max(console.width, needed)
        outside = with_sigma(index.value, index.sigma)
        console.print(f"Expected error of the maps (sigma), outside index {outside}:")
        console.print(table)
    print_paths(written)
    narrator = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)
    for remark in remarks:
        narrator.print(f"Take care: {remark}")
