"""The command `calib immerse`."""

import argparse
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from calib.apply.water import GREEN, SALINITY, TEMPERATURE, WAVELENGTH, index_of_water
from calib.commands.arguments import (
    add_calibration,
    add_depths,
    add_output,
    add_overwrite,
    calibration_files,
    folder_of,
    quoted,
)
from calib.commands.loading import quickly
from calib.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from calib.apply.change_medium import Immersion

SUMMARY = "Convert a calibration to another medium: made in air, used in water."
DESCRIPTION = """
The camera and its cover stay as calibrated; only the index of the medium outside changes, to
--outside-index, or to that of water of a given --salinity and --temperature (Quan and Fry 1995).
Numbers that the fit held at their declared values, because they hardly mattered, are estimated
within their tolerances unless they are declared exact. Some numbers, such as the place of a flat
window, hardly matter in air but do in water. If the views leave one of them open, the command says
so, and how well it must be measured. To convert back to air: --outside-index 1.
"""

UNKNOWN_FACE = 0.05
"""px: less is not worth a word."""
TOLD = 3
"""Depths of which a sentence tells."""
AIRY = 1.01
"""An index below it is a gas's, which is known to more digits than matter."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_calibration(parser)
    parser.add_argument(
        "--outside-index",
        type=_between(1, 2),
        metavar="N",
        help="of what is outside: 1.34, say; 1 of air",
    )
    parser.add_argument(
        "--salinity",
        type=_between(*SALINITY),
        metavar="S",
        help="of the water, per mille; 35 of oceans, by default 0",
    )
    parser.add_argument(
        "--temperature",
        type=_between(*TEMPERATURE),
        metavar="T",
        help="of the water, degrees C, by default 15",
    )
    parser.add_argument(
        "--wavelength",
        type=_between(*WAVELENGTH),
        metavar="L",
        help="of the light, nm, by default 550",
    )
    sigma = (
        "standard deviation of the index; by default 0.001 of water, for its temperature and the"
        " camera's colours, and 0 of air"
    )
    parser.add_argument("--index-sigma", type=_between(0, 0.1), metavar="N", help=sigma)
    add_depths(parser, required=False)
    add_output(
        parser, "where the calibration goes, by default immersed in its folder", required=False
    )
    add_overwrite(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    index = _index(args)

    with quickly():
        from calib.apply.change_medium import DEPTHS, immerse
        from calib.calibration import DERIVED, FILES, Calibration
        from calib.commands.console import Bars
        from calib.commands.printing import print_json
        from calib.diagnosis.all_free import all_free
        from calib.export.npz import file_names, write_npz
        from calib.io.file_set import FileSet
        from calib.io.output_folder import check_no_link
        from calib.session.schema import Number
        from calib.session.tolerances import WATER_INDEX

    sigma = args.index_sigma if args.index_sigma is not None else WATER_INDEX.sigma * (index > AIRY)
    calibration = Calibration.load(args.calibration)
    depths = tuple(dict.fromkeys(args.depth))
    output = args.output or check_no_link(folder_of(args.calibration) / "immersed")
    inputs = calibration_files(args.calibration)
    with Bars() as bars, FileSet(output, overwrite=args.overwrite, inputs=inputs) as files:
        files.reserve([*FILES, *file_names(depths)])
        immersion = immerse(all_free(calibration), Number(index, sigma), depths or DEPTHS)
        written = [
            immersion.calibration.write(files),
            *write_npz(immersion.calibration, depths, files, bars),
        ]
        files.commit(instead_of=DERIVED)
    remarks = list(_remarks(immersion))
    if args.json:
        print_json(_as_mapping(immersion, remarks, [str(path) for path in written]))
    else:
        _print(immersion, remarks, written)


def _between(low: float, high: float) -> Callable[[str], float]:
    """A parser of a number."""

    def parsed(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = float("nan")
        if not low <= number <= high:
            raise argparse.ArgumentTypeError(
                f"{quoted(text)} will not do: write a number from {low:g} to {high:g}"
            )
        return number

    return parsed


def _index(args: argparse.Namespace) -> float:
    """Of what is outside: as given, or of water as described."""
    water = (args.salinity, args.temperature, args.wavelength)
    if args.outside_index is not None:
        if any(number is not None for number in water):
            raise InputError(
                "--outside-index says it all: drop it, or --salinity, --temperature and"
                " --wavelength."
            )
        return float(args.outside_index)
    if all(number is None for number in water):
        raise InputError(
            "what is outside is not said: write --outside-index 1.34, or --salinity 35"
            " --temperature 15 for sea water."
        )
    salinity, temperature, wavelength = (
        default if number is None else number
        for number, default in zip(water, (0.0, 15.0, GREEN), strict=True)
    )
    return index_of_water(salinity, temperature, wavelength)


def _remarks(immersion: "Immersion") -> Iterator[str]:
    """What a person should know before relying on it, a sentence each."""
    at = _listed(immersion.depths)
    if not immersion.after_px:
        yield (
            "the fit estimated no covariance, so that it is not known how sure these maps are: fit"
            " with --method joint."
        )
    if immersion.unknown:
        before, sure = (_listed(sigmas) for sigmas in (immersion.before_px, immersion.after_px))
        yield (
            f"the views do not tell all that matters there: at {at} m the maps are known to {sure}"
            f" px, in their own medium to {before}. Take three pictures of the board there, which"
            " say the rest (calib check IMMERSED PICTURES --update), or mend the following."
        )
        for one in immersion.dominant[:2]:
            yield f"they leave open {one.words}: {one.advice}."
    if immersion.other_face_px and max(immersion.other_face_px) > UNKNOWN_FACE:
        yield (
            "which face of the glass is uneven no view in one medium tells; it is taken to be the"
            " outer. Were it the inner one, the maps would be off by"
            f" {_listed(immersion.other_face_px)} px at {at} m: calib check with a few pictures"
            " taken there says."
        )
    if immersion.unexplained:
        yield (
            f"{', '.join(immersion.unexplained)} mends an error whose cause is not known, and it"
            " may be another there."
        )


def _listed(numbers: tuple[float, ...]) -> str:
    """Of many the first, the middle and the last."""
    some = (
        numbers if len(numbers) <= TOLD else (numbers[0], numbers[len(numbers) // 2], numbers[-1])
    )
    return ", ".join(f"{one:.2g}" for one in some)


def _as_mapping(
    immersion: "Immersion", remarks: list[str], written: list[str]
) -> dict[str, object]:
    outside = immersion.calibration.cover.parameters["outside_index"]
    before = immersion.before_px or (None,) * len(immersion.depths)
    after = immersion.after_px or (None,) * len(immersion.depths)
    face = immersion.other_face_px or (None,) * len(immersion.depths)
    rows = zip(immersion.depths, before, after, face, strict=True)
    return {
        "outside_index": {"value": outside.value, "sigma": outside.sigma},
        "maps": [
            {"depth_m": depth, "sigma_before_px": was, "sigma_px": now, "other_face_px": other}
            for depth, was, now, other in rows
        ],
        "known": not immersion.unknown,
        "loose": [
            {
                "name": one.name,
                "sigma_px_if_known": list(one.sigma_px),
                "measured_to": one.measured_to,
                "unit": one.unit,
            }
            for one in immersion.dominant
        ],
        "remarks": remarks,
        "written": written,
    }


def _print(immersion: "Immersion", remarks: list[str], written: "list[Path]") -> None:
    from rich.console import Console
    from rich.table import Table

    from calib.commands.printing import print_paths

    console = Console()
    outside = immersion.calibration.cover.parameters["outside_index"]
    spread = f" ± {outside.sigma:.2g}" if outside.sigma else ""
    if immersion.after_px:
        console.print(
            f"How sure the maps are (one sigma), outside index {outside.value:.5g}{spread}:",
            highlight=False,
        )
        table = Table("depth", "before", "there")
        for depth, was, now in zip(
            immersion.depths, immersion.before_px, immersion.after_px, strict=True
        ):
            table.add_row(f"{depth:g} m", f"{was:.3f} px", f"{now:.3f} px")
        console.print(table)
    for one in immersion.dominant:
        left = ", ".join(f"{sigma:.3f}" for sigma in one.sigma_px)
        console.print(
            f"If {one.words} were known exactly: {left} px.",
            soft_wrap=True,
            markup=False,
            highlight=False,
        )
    print_paths(written)
    narrator = Console(stderr=True, soft_wrap=True, markup=False, highlight=False)
    for remark in remarks:
        narrator.print(f"Take care: {remark}")
