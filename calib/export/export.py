"""What every export format is asked for and gives, and the loop over depths that formats of a
central camera share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from calib.apply.angular_reach import undistortion_limit
from calib.calibration import Calibration
from calib.export.central import CentralModel, best_central
from calib.export.formats import AXES, ExportLens, Format
from calib.io.file_set import FileSet
from calib.progress import Progress


@dataclass(frozen=True, slots=True, eq=False)
class Export:
    """What is to be written."""

    calibration: Calibration
    form: Format
    lenses: Sequence[ExportLens]
    """Of which a central camera takes the best; none for maps."""
    depths: Sequence[float]
    """m, each once."""
    files: FileSet
    progress: Progress
    axes: str = AXES[0]
    """Of formats.AXES: those of a ray image."""

    def each_depth(self) -> Iterator[tuple[float, str]]:
        """Every depth with its text for file names, while a bar shows how many are done."""
        advance = self.progress.task(self.form.name, len(self.depths))
        for done, depth in enumerate(self.depths, start=1):
            yield depth, depth_text(depth)
            advance(done, f"{depth_text(depth)} m")


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written."""

    paths: tuple[Path, ...]
    models: tuple[CentralModel, ...] = ()
    """The central camera of each depth, whose misfit a person should hear of."""
    remarks: tuple[str, ...] = ()
    """What else a person should hear, a sentence each."""


class Exporter(Protocol):
    """A module of this package that writes a format."""

    def export(self, wanted: Export) -> Exported: ...


def export(wanted: Export) -> Exported:
    """Write a calibration in a format.

    Raises:
        InputError: a file cannot be written, or a library that the format needs is absent.
    """
    return cast(Exporter, import_module(f"calib.export.{wanted.form.module}")).export(wanted)


def limits(calibration: Calibration) -> tuple[str, ...]:
    """Return a sentence on the angle at which maps end, if the lens sees what no map holds."""
    return tuple(filter(None, [undistortion_limit(calibration)]))


def export_central(wanted: Export, name: str, text: Callable[[CentralModel], str]) -> Exported:
    """One file for each depth, of the central camera that comes nearest to the covered one there.

    Args:
        name: of the file, with {} in the place of the depth.
        text: the file's, of a camera.
    """
    paths, models = [], []
    for depth, said in wanted.each_depth():
        models.append(best_central(wanted.calibration, depth, wanted.lenses))
        paths.append(wanted.files.write(name.format(said), text(models[-1])))
    return Exported(tuple(paths), tuple(models))


def depth_text(depth: float) -> str:
    """The shortest text that only this depth has: 1, 0.5, 1.0000001."""
    return repr(float(depth)).removesuffix(".0")
