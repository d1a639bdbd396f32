"""The section `cover` of session.yaml: one cover, or a list of covers from the camera outwards."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from calib.errors import InputError
from calib.session.cover import AUTO, SURFACES, Cover
from calib.session.dispersion import Dispersion, dispersion_to_yaml, read_dispersion
from calib.session.glass import glass_to_yaml, read_glass
from calib.session.parameter_names import INDEX, THICKNESS, layer_number
from calib.session.schema import UNKNOWN, Number, Quantity, Section, is_unknown
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.layer import LAYER, OUTSIDE
from calib.session.shapes.none import NONE
from calib.session.shapes.registry import find_shape, stated_shape_names
from calib.session.shapes.shape import Shape

KEY = "cover"
CORRELATIONS = "correlations"
GLASS_KEY = "glass"
LAYERS_KEY = "layers"
SURFACE_KEY = "surface"
SURFACE_EXPLANATION = "Whether the glass is even: auto, even or uneven."
MAX_LAYERS = 8
"""Layers of glass that a cover may have. A window has one to five."""
RADIUS = "inner_radius"
"""The name of the number that is a round cover's size."""
MAX_DOUBLINGS = 24
"""Doublings of an unknown radius, up to the largest that a session may state."""
MAX_COVERS = 4
"""Covers that a camera may look through."""
ALONE = (NONE.name, UNKNOWN)
"""The shapes that no other cover may stand beside."""
INDICES = (*(kind.quantity for kind in LAYER if kind.quantity.stem == INDEX), OUTSIDE.quantity)
"""The keys whose number may have a dispersion."""
CORRELATION = Quantity(CORRELATIONS, low=-1, high=1)
PAIRS = (
    "two names and a number from -1 to 1 for each pair of numbers, such as [[cover.thickness,"
    " camera.fx, 0.5]]"
)
LAYERS = (
    f"a list of up to {MAX_LAYERS} layers from the inside out, each as {{thickness_mm: 3.0,"
    " refractive_index: 1.52}"
)
COVERS = f"a mapping, or a list of 2 to {MAX_COVERS} mappings from the camera outwards"


def cover_sections(document: Section, example: str) -> list[Section]:
    """Return the section of each cover, from the camera outwards; `example` is quoted where the key
    is missing.
    """
    written = document.values.get(KEY)
    if is_unknown(written):
        return [Section({"shape": UNKNOWN}, document.file, document.key_path(KEY))]
    if not isinstance(written, list):
        return [document.section(KEY, example)]
    entries = [entry for entry in written if isinstance(entry, Mapping)]
    if not 2 <= len(written) <= MAX_COVERS or len(entries) < len(written):
        raise document.error(KEY, written, COVERS)
    path = document.key_path(KEY)
    return [Section(entry, document.file, f"{path}[{i}]") for i, entry in enumerate(entries)]


def read_cover(section: Section, *outer: Section) -> Cover:
    """Read the cover of the first section, and those outside of it in the other ones, from the
    camera outwards. Raise InputError if one is not valid.

    The first section holds what is known of all covers together: correlations, and the prior of
    the glass.
    """
    names = [name for name in stated_shape_names() if name not in ALONE or not outer]
    cover = _read_single(section, names, (CORRELATIONS, GLASS_KEY))
    covers = [_read_single(entry, names, ()) for entry in outer]
    chain: Cover | None = None
    for other in reversed(covers):
        chain = replace(other, outer=chain)
    glass = (
        read_glass(section.section(GLASS_KEY, "what calib fleet-prior wrote"))
        if GLASS_KEY in section.values
        else None
    )
    return replace(cover, correlations=_read_correlations(section), glass=glass, outer=chain)


def cover_to_yaml(cover: Cover) -> object:
    """Return the value of the key `cover` that is read as this cover."""
    mappings = cover_mappings(cover)
    return mappings if cover.outer else mappings[0]


def cover_mappings(cover: Cover) -> list[dict[str, object]]:
    """Return the mapping of each cover, from the camera outwards."""
    mappings = [_single_to_yaml(single) for single in cover.covers]
    if cover.correlations:
        mappings[0][CORRELATIONS] = [list(pair) for pair in cover.correlations]
    if cover.glass:
        mappings[0][GLASS_KEY] = glass_to_yaml(cover.glass)
    return mappings


def _read_single(section: Section, shapes: Sequence[str], common_keys: Sequence[str]) -> Cover:
    shape = find_shape(section.choice("shape", shapes, f"one of {', '.join(shapes)}"))
    quantities = [kind.quantity for kind in shape.keys]
    layered = LAYERS_KEY in section.values and shape.has_glass
    if layered:
        quantities = [*(kind.quantity for kind in shape.dimensions), OUTSIDE.quantity]
    keys = [quantity.key for quantity in quantities]
    section.allow_only(
        ("shape", *keys, *([LAYERS_KEY, SURFACE_KEY] if shape.has_glass else []), *common_keys),
        f"key of the shape {shape.name}{' with layers' if layered else ''}",
    )
    parameters, dispersion = _read_numbers(section, quantities)
    if layered:
        layers, colours = _read_layers(section)
        parameters |= layers
        dispersion |= colours
    parameters = _with_room(shape, parameters)
    _refuse_camera_outside(section, shape, parameters)
    surface = AUTO
    if SURFACE_KEY in section.values:
        surface = section.choice(SURFACE_KEY, SURFACES, f"one of {', '.join(SURFACES)}")
    return Cover(shape.name, parameters, surface=surface, dispersion=dispersion)


def _read_numbers(
    section: Section, quantities: Sequence[Quantity]
) -> tuple[dict[str, Number], dict[str, Dispersion]]:
    """Return the numbers of these keys, and the dispersion of those that are indices with one."""
    numbers: dict[str, Number] = {}
    dispersions: dict[str, Dispersion] = {}
    for quantity in quantities:
        plain, dispersion = section, None
        if quantity in INDICES:
            plain, dispersion = read_dispersion(section, quantity)
        numbers |= plain.read(quantity)
        if dispersion:
            dispersions[quantity.stem] = dispersion
    return numbers, dispersions


def _read_layers(section: Section) -> tuple[dict[str, Number], dict[str, Dispersion]]:
    """Return the numbers of the layers of glass, and their dispersion."""
    written = section.get(LAYERS_KEY, LAYERS)
    entries = written if isinstance(written, list) else []
    mappings = [entry for entry in entries if isinstance(entry, Mapping)]
    if not 1 <= len(mappings) <= MAX_LAYERS or len(mappings) < len(entries):
        raise section.error(LAYERS_KEY, written, LAYERS)
    numbers: dict[str, Number] = {}
    dispersions: dict[str, Dispersion] = {}
    for layer, mapping in enumerate(mappings, 1):
        path = section.key_path(f"{LAYERS_KEY}[{layer - 1}]")
        entry = Section(mapping, section.file, path)
        entry.allow_only([kind.quantity.key for kind in LAYER], "key of a layer")
        layer_numbers, colours = _read_numbers(entry, [kind.quantity for kind in LAYER])
        numbers |= {layer_number(layer, name): number for name, number in layer_numbers.items()}
        dispersions |= {layer_number(layer, name): colour for name, colour in colours.items()}
    return numbers, dispersions


def _single_to_yaml(cover: Cover) -> dict[str, object]:
    shape = find_shape(cover.shape)
    document: dict[str, object] = {"shape": shape.name}
    if not shape.has_glass:
        return document
    document |= _entries_to_yaml(shape.dimensions, cover.parameters)
    layers = []
    for layer in range(1, cover.layers + 1):
        numbers = {name: cover.parameters[layer_number(layer, name)] for name in (THICKNESS, INDEX)}
        dispersion = cover.dispersion.get(layer_number(layer, INDEX))
        layers.append(_entries_to_yaml(LAYER, numbers, dispersion))
    document |= layers[0] if len(layers) == 1 else {LAYERS_KEY: layers}
    medium = cover.dispersion.get(OUTSIDE.quantity.stem)
    document |= _entries_to_yaml((OUTSIDE,), cover.parameters, medium)
    return document if cover.surface == AUTO else document | {SURFACE_KEY: cover.surface}


def _entries_to_yaml(
    kinds: Sequence[Dimension],
    parameters: Mapping[str, Number],
    dispersion: Dispersion | None = None,
) -> dict[str, object]:
    """Return the value of each dimension by its key. `dispersion` is that of the index among
    them.
    """
    document: dict[str, object] = {}
    for kind in kinds:
        quantity = kind.quantity
        entries = [quantity.to_yaml(parameters[name]) for name in quantity.names]
        document[quantity.key] = entries if quantity.components else entries[0]
        if dispersion and quantity in INDICES:
            index = parameters[quantity.stem]
            document[quantity.key] = dispersion_to_yaml(entries[0], index, dispersion)
    return document


def _read_correlations(section: Section) -> tuple[tuple[str, str, float], ...]:
    """Read the pairs. Their names, and whether all correlations are possible together, are checked
    once the camera is known (`check_correlations`).
    """
    pairs = section.values.get(CORRELATIONS, [])
    if not isinstance(pairs, list):
        raise section.error(CORRELATIONS, pairs, PAIRS)
    correlations: list[tuple[str, str, float]] = []
    for index, entry in enumerate(pairs):
        match entry:
            case [str() as first, str() as second, value]:
                key = f"{CORRELATIONS}[{index}][2]"
                correlations.append((first, second, section.number(key, value, CORRELATION).value))
            case _:
                raise section.error(f"{CORRELATIONS}[{index}]", entry, PAIRS)
    return tuple(correlations)


def _with_room(shape: Shape, parameters: Mapping[str, Number]) -> dict[str, Number]:
    """Return the numbers with an unknown radius that leaves room for the camera where the other
    numbers place it.
    """
    numbers = dict(parameters)
    radius = numbers.get(RADIUS)
    if not (shape.check_camera and radius and radius.unknown):
        return numbers
    for _ in range(MAX_DOUBLINGS):
        if not shape.check_camera({name: number.value for name, number in numbers.items()}):
            break
        radius = replace(radius, value=2 * radius.value, sigma=2 * radius.sigma)
        numbers[RADIUS] = radius
    return numbers


def _refuse_camera_outside(
    section: Section, shape: Shape, parameters: Mapping[str, Number]
) -> None:
    """Raise InputError if the camera lies outside the cover's inner surface."""
    if not shape.check_camera:
        return
    outside = shape.check_camera({name: number.value for name, number in parameters.items()})
    if outside:
        raise InputError(
            f"{section.file}: {section.key_path(outside.key)} puts the camera outside the"
            f" {shape.name}{outside.detail}"
        )
