"""The names of an export's files, so that what is in their way is refused before the work."""

from collections.abc import Sequence

from calib.export.depthai import mesh_name
from calib.export.formats import AXES, Format
from calib.io.numerals import depth_text


def file_names(
    form: Format,
    depths: Sequence[float],
    size: tuple[int, int] | None = None,
    axes: str = AXES[0],
) -> list[str]:
    """Return the names of the files that an export writes.

    Args:
        form: the format.
        depths: m, of the maps or central cameras.
        size: px, width and height of the pictures; None leaves names out that depend on it.
        axes: of a ray image.
    """
    suffix = "" if axes == AXES[0] else f"_{axes}"
    mesh = mesh_name(*size) if size else ""
    names = []
    for template in form.files:
        if "{mesh}" in template and not size:
            continue
        if "{depth}" in template:
            names += [template.format(depth=depth_text(depth), mesh=mesh) for depth in depths]
        else:
            names.append(template.format(axes=suffix))
    return names
