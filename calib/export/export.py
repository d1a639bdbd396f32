"""The request and the result that all export formats share, and the loop over depths for formats of
a central camera.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, cast

from calib.apply.angular_reach import undistortion_limit
from calib.calibration import Calibration
from calib.export.formats import AXES, ExportLens, Format
from calib.io.file_set import FileSet
from calib.io.numerals import depth_text
from calib.progress import Progress

if TYPE_CHECKING:
    from calib.export.central import CentralModel


@dataclass(frozen=True, slots=True, eq=False)
class ExportRequest:
    """The calibration to write, and the options of its format."""

    calibration: Calibration
    form: Format
    lenses: Sequence[ExportLens]
    """The lenses of which a central camera takes the best; empty for maps."""
    depths: Sequence[float]
    """m, each depth once."""
    files: FileSet
    progress: Progress
    axes: str = AXES[0]
    """The axes of a ray image, one of formats.AXES."""

    def each_depth(self) -> Iterator[tuple[float, str]]:
        """Yield every depth with its text for file names, while a bar shows the progress."""
        advance = self.progress.task(self.form.name, len(self.depths))
        for done, depth in enumerate(self.depths, start=1):
            yield depth, depth_text(depth)
            advance(done, f"{depth_text(depth)} m")


@dataclass(frozen=True, slots=True)
class ExportedFiles:
    """The written files, and what to tell the user about them."""

    paths: tuple[Path, ...]
    models: tuple[CentralModel, ...] = ()
    """The central camera of each depth; the command prints its misfit."""
    remarks: tuple[str, ...] = ()
    """Further sentences for the user."""


class Exporter(Protocol):
    """A module of this package that writes a format."""

    def export(self, request: ExportRequest) -> ExportedFiles: ...


def export(request: ExportRequest) -> ExportedFiles:
    """Write a calibration in a format.

    Raises:
        InputError: a file cannot be written, or a library that the format needs is absent.
    """
    return cast(Exporter, import_module(f"calib.export.{request.form.module}")).export(request)


def limit_remarks(calibration: Calibration) -> tuple[str, ...]:
    """Return a sentence on the angle at which maps end, if the lens sees more than they show; else
    nothing.
    """
    return tuple(filter(None, [undistortion_limit(calibration)]))


def export_central(
    request: ExportRequest, name: str, text: Callable[[CentralModel], str]
) -> ExportedFiles:
    """Write one file for each depth, with the central camera that is nearest to the covered one
    there.

    Args:
        request: the request.
        name: of the file, with {} in place of the depth.
        text: the function that returns the file's text for a central camera.
    """
    from calib.export.central import best_central  # maps need no fits of a central camera

    paths: list[Path] = []
    models: list[CentralModel] = []
    for depth, depth_name in request.each_depth():
        models.append(best_central(request.calibration, depth, request.lenses))
        paths.append(request.files.write(name.format(depth_name), text(models[-1])))
    return ExportedFiles(tuple(paths), tuple(models))
