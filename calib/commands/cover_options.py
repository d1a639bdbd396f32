"""The options that describe a cover on a command line, and the section of session.yaml that they
make.
"""

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from calib.commands.arguments import Options, quoted, refuse_material
from calib.errors import InputError
from calib.session.lens import COEFFICIENTS
from calib.session.number_spelling import length_in_mm
from calib.session.schema import UNKNOWN, is_unknown
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.layer import LAYER, MEDIA, OUTSIDE, WATER, medium_word
from calib.session.shapes.none import NONE
from calib.session.shapes.registry import dimensions, find_shape, shape_names, stated_shape_names
from calib.session.tolerances import ANY_WATER
from calib.session.typed_number import join_sigmas, typed_number

NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?", re.IGNORECASE)
UNKNOWN_KEY = "?"
"""The key for an unknown number in the form of `capture`."""
OPENCV_SUFFIXES = (".yml", ".yaml", ".xml", ".json")
"""The suffixes of files of cv2.FileStorage."""
RADIUS_KEY = "inner_radius_mm"
SMALLEST_RADIUS_MM = 0.5
"""A smaller radius is one in metres: that of a cover of half a metre would be 0.5."""
PREFIX = "cover_"
"""The beginning of these options' names among the arguments."""

UNIT_NOUNS = {"millimetres": "MM", "degrees": "DEG"}
"""The words that stand in the help for a value in a unit."""


def add_cover(parser: Options) -> None:
    """Add --cover and an option for each number of a cover."""
    parser.add_argument(
        "--cover",
        choices=stated_shape_names(),
        metavar="SHAPE",
        help=f"shape of the cover: {', '.join(stated_shape_names())} (default: none, a bare"
        " camera)",
    )
    for option, kinds in _kinds_by_option().items():
        parser.add_argument(
            f"--{option}",
            dest=f"{PREFIX}{option.replace('-', '_')}",
            type=typed_list,
            metavar=_value_noun(kinds),
            help=f"{'; '.join(map(_explain, kinds))} (default: {_default(kinds[0])})",
        )


def _value_noun(kinds: Sequence[Dimension]) -> str:
    """Return the word for an option's value: its components if all shapes have the same ones, else
    their unit. A number without a unit has the last word of its key.
    """
    quantity = kinds[0].quantity
    noun = UNIT_NOUNS.get(quantity.unit[0], quantity.key.rpartition("_")[2].upper())
    if len({kind.quantity.components for kind in kinds}) > 1:
        return ",".join(noun for _ in quantity.components)
    return ",".join(quantity.components).upper() or noun


def _default(kind: Dimension) -> str:
    """Return what holds for a number that is not given: its usual value with its tolerance, or
    UNKNOWN.
    """
    quantity = kind.quantity
    value = float(kind.usual) if kind.usual else quantity.default
    if value is None:
        return UNKNOWN
    sigma = kind.tolerance.sigma * quantity.unit[1] if kind.tolerance else 0.0
    return f"{value:g}+-{sigma:.2g}" if sigma else f"{value:g}"


def _explain(kind: Dimension) -> str:
    """Return the explanation of a dimension, after the shapes that have it unless all have it."""
    shapes = [name for name in shape_names() if kind in find_shape(name).keys]
    words = kind.typed.removesuffix(".")
    if all(name in shapes or not find_shape(name).has_glass for name in shape_names()):
        return f"{words[0].lower()}{words[1:]}"
    return f"{', '.join(shapes)}: {words[0].lower()}{words[1:]}"


def add_intrinsics(parser: Options) -> None:
    parser.add_argument(
        "--intrinsics",
        type=typed_intrinsics,
        metavar="FX,FY,CX,CY,...",
        help=(
            "the lens in px, then OpenCV's coefficients, or the file that OpenCV or ROS wrote for"
            " the camera without its cover (default: from pictures without the cover in bare/, else"
            " from these views)"
        ),
    )


def typed_list(text: str) -> list[object]:
    """Return the numbers that commas join, such as `40`, `40+-5` or `0,-30+-2`, as session.yaml has
    them.
    """
    words = [word.strip() for word in join_sigmas(text).split(",")]
    words = [UNKNOWN if word == UNKNOWN_KEY else word for word in words]
    for word in words:
        if (not is_unknown(word) and not all(map(NUMBER.fullmatch, word.split("±")))) or word.count(
            "±"
        ) > 1:
            refuse_material(text)
            if length := length_in_mm(word):
                raise argparse.ArgumentTypeError(
                    f"{quoted(word)} is not a number: write {length:g}, in millimetres without a"
                    " unit"
                )
            raise argparse.ArgumentTypeError(
                f"{quoted(text)} is not a number: write one such as 40, or 40+-5 with its"
                " uncertainty, or unknown, and a list as 0,-30. Lengths are in millimetres, and"
                " water has the index 1.333."
            )
    return [UNKNOWN if is_unknown(word) else typed_number(word) for word in words]


def typed_intrinsics(text: str) -> list[object]:
    """Return the numbers of a list, or of a file that OpenCV wrote."""
    if not text.lower().endswith(OPENCV_SUFFIXES):
        return typed_list(text)
    from calib.importing.opencv_file import read_opencv_intrinsics

    try:
        return [*read_opencv_intrinsics(Path(text))]
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error).replace("%", "%%")) from error


def given_cover_options(args: argparse.Namespace) -> list[str]:
    """Return the names, without dashes in front, of the given options that describe a cover."""
    numbers = [
        option
        for option in _kinds_by_option()
        if getattr(args, f"{PREFIX}{option.replace('-', '_')}") is not None
    ]
    return ["cover"] * (args.cover is not None) + numbers


def cover_from_options(
    args: argparse.Namespace, earlier: Mapping[str, object] | None = None
) -> dict[str, object] | None:
    """Return the section `cover`, in which a number that is not given is unknown; None if no option
    describes a cover.

    Args:
        earlier: the section that the new one replaces: its numbers stay where none is given, of
            another shape those of the glass and of what is outside.

    Raises:
        InputError: a number belongs to another shape.
    """
    earlier = earlier or {}
    options = _kinds_by_option()
    typed = {
        option: values
        for option in options
        if (values := getattr(args, f"{PREFIX}{option.replace('-', '_')}")) is not None
    }
    if args.cover is None and not typed:
        return None
    name = args.cover or earlier.get("shape")
    if name not in stated_shape_names():
        raise InputError(
            f"--{next(iter(typed))} describes a cover without a shape: add --cover, one of"
            f" {', '.join(stated_shape_names())}."
        )
    shape = find_shape(str(name))
    for option in typed:
        if not any(kind in shape.keys for kind in options[option]):
            allowed = [f"--{_option(kind)}" for kind in shape.keys]
            raise InputError(
                f"--{option} does not belong to --cover {shape.name}: leave it out"
                + (f", or write some of {', '.join(allowed)}." if allowed else ".")
            )
    same = earlier.get("shape") == shape.name
    section: dict[str, object] = dict(earlier) if same else {"shape": shape.name}
    for kind in shape.keys:
        quantity = kind.quantity
        if values := typed.get(_option(kind)):
            value = values if quantity.components else _single(kind, values)
            if quantity.key == RADIUS_KEY:
                _refuse_metres(_option(kind), value)
            if kind is LAYER[1] and not (
                _option(OUTSIDE) in typed or OUTSIDE.quantity.key in earlier
            ):
                _refuse_water(_option(kind), value)
            section[quantity.key] = _any_water(value) if kind is OUTSIDE else value
        elif quantity.key in earlier and (same or kind in (*LAYER, OUTSIDE)):
            section[quantity.key] = earlier[quantity.key]
        elif same and "layers" in earlier and kind in LAYER:
            continue
        elif kind.usual:
            section[quantity.key] = float(kind.usual)
        elif quantity.default is None:
            section[quantity.key] = UNKNOWN
    return section


def describe_usual(args: argparse.Namespace, earlier: Mapping[str, object] | None = None) -> str:
    """Return a sentence on the numbers of the cover that nobody gave and that have a usual value,
    which `cover_from_options` takes; empty if there are none. `earlier` is that of
    `cover_from_options`.
    """
    shape = find_shape(args.cover or NONE.name)
    assumed = [
        kind
        for kind in shape.keys
        if kind.usual
        and kind.quantity.key not in (earlier or {})
        and getattr(args, f"{PREFIX}{_option(kind).replace('-', '_')}") is None
    ]
    if not assumed:
        return ""
    numbers = [
        f"{kind.words} is taken as {kind.usual}"
        + (f" ± {kind.tolerance.sigma:g}" if kind.tolerance else "")
        for kind in assumed
    ]
    options = [f"--{_option(kind)}" for kind in assumed]
    return (
        f"no {', '.join(options)}: {'; '.join(numbers)}. If you know better, add"
        f" {options[0]} 1.49, with its uncertainty as {options[0]} 1.49+-0.01, or"
        f" {options[0]} unknown."
    )


def describe_medium(args: argparse.Namespace, earlier: Mapping[str, object] | None = None) -> str:
    """Return a sentence that air is taken to be outside of a cover whose medium nobody gave, or how
    well water is taken to be known; empty if there is no glass, or the option says it. `earlier` is
    that of `cover_from_options`.
    """
    option = _option(OUTSIDE)
    values = getattr(args, f"{PREFIX}{option.replace('-', '_')}")
    if values and _any_water(values[0]) != values[0]:
        return (
            f"--{option} {values[0]} is taken as {values[0]} ± {ANY_WATER.sigma:g}, from fresh"
            f" water to the sea's. If you know it better, write --{option} {values[0]}+-0.001."
        )
    if (
        values
        or OUTSIDE.quantity.key in (earlier or {})
        or not find_shape(args.cover or NONE.name).has_glass
    ):
        return ""
    return (
        f"no --{option}: air is taken to be outside of the cover. For pictures that were taken"
        f" under water, add --{option} {MEDIA[WATER]:g}."
    )


def intrinsics_from_options(args: argparse.Namespace) -> dict[str, object] | None:
    """Return the section `camera.intrinsics`; None if no option states it."""
    from calib.session.camera import PINHOLE  # it imports numpy

    values: list[object] | None = args.intrinsics
    if values is None:
        return None
    count = len(values) - len(PINHOLE)
    if count not in COEFFICIENTS:
        raise InputError(
            f"--intrinsics has {len(values)} numbers: write fx,fy,cx,cy and"
            f" {', '.join(map(str, COEFFICIENTS))} coefficients, such as 1200,1200,640,360"
        )
    pinhole = zip((quantity.key for quantity in PINHOLE), values[: len(PINHOLE)], strict=True)
    return {**dict(pinhole), "distortion": values[len(PINHOLE) :]}


def _refuse_metres(option: str, value: object) -> None:
    """Raise InputError for a size of a cover that is stated in metres."""
    size = value["value"] if isinstance(value, dict) else value
    if isinstance(size, int | float) and 0 < size < SMALLEST_RADIUS_MM:
        raise InputError(
            f"--{option} {size:g} is in millimetres, and no camera fits into such a cover: write"
            f" one such as 40 ({size:g} m, if metres were meant, is {size * 1000:g})."
        )


def _refuse_water(option: str, value: object) -> None:
    """Raise InputError for a glass that has the index of water, where air is outside."""
    index = value["value"] if isinstance(value, dict) else value
    if isinstance(index, int | float) and abs(index - MEDIA[WATER]) < ANY_WATER.sigma * 3:
        outside = _option(OUTSIDE)
        raise InputError(
            f"--{option} is that of the glass, and {index:g} is that of water: write --{outside}"
            f" {index:g} for pictures taken in water. For a surface of water write both."
        )


def _any_water(value: object) -> object:
    """Return a plain index of water with its tolerance; anything else as it is."""
    if isinstance(value, int | float) and medium_word(value) == WATER:
        return {"value": value, "sigma": ANY_WATER.sigma}
    return value


def _single(kind: Dimension, values: list[object]) -> object:
    if len(values) > 1:
        raise InputError(
            f"--{_option(kind)} takes one number, and {len(values)} stand there: write decimals"
            " with a point, such as 40.5."
        )
    return values[0]


def _option(kind: Dimension) -> str:
    """Return the name of a number's option, that of --free where there is one."""
    return kind.option or kind.quantity.key.replace("_", "-")


def _kinds_by_option() -> dict[str, list[Dimension]]:
    """Return the dimensions of all shapes by the names of their options."""
    kinds: dict[str, list[Dimension]] = {}
    for kind in dimensions():
        entries = kinds.setdefault(_option(kind), [])
        if kind not in entries:
            entries.append(kind)
    return kinds
