"""The check of a fleet's folder, before any camera is done."""

import os
from collections.abc import Sequence
from pathlib import Path

from calib.calibration_file import FILES
from calib.errors import InputError
from calib.export.file_names import file_names
from calib.export.formats import FORMATS
from calib.fleet.identity import FleetOptions
from calib.fleet.job import camera_files
from calib.fleet.manifest import Entry
from calib.fleet.places import is_remote
from calib.fleet.result import CAMERAS, PAGES, result_name
from calib.io.output_folder import OutputFolder, check_no_link
from calib.io.result_names import DIAGNOSED
from calib.report.write import NAME


def check_output(
    entries: Sequence[Entry],
    options: FleetOptions,
    fleet: Path,
    inputs: Sequence[Path],
    *,
    overwrite: bool,
) -> None:
    """Refuse a fleet's folder in which a result would replace an input or a foreign file, would go
    through a symbolic link, or would lie on or above a session or a prior.

    Args:
        entries: the cameras.
        asked: what is done with each of them.
        fleet: the folder of all results.
        inputs: the manifest, and other files that the batch reads.
        overwrite: foreign files may be replaced.

    Raises:
        InputError: it names what is in the way. Nothing has been written.
    """
    OutputFolder(fleet, overwrite=overwrite, inputs=inputs).check(PAGES)
    check_no_link(fleet / CAMERAS)
    sources = _places_of_inputs(entries)
    names = {
        ".": [*camera_files(options.depths)],
        DIAGNOSED: [*FILES, NAME],
        **{
            form.name: file_names(form, options.depths)
            for form in FORMATS
            if form.name in options.formats
        },
    }
    for entry in entries:
        folder = check_no_link(fleet / CAMERAS / entry.id)
        if source := sources.get(os.path.realpath(folder)):
            raise InputError(
                f"{folder} is where the results of {entry.id} go, and {source} is read from there:"
                " give another folder with -o."
            )
        if os.path.lexists(folder) and not folder.is_dir():
            raise InputError(
                f"{folder} is a file, and results are to go into a folder of that name: give"
                " another folder with -o."
            )
        OutputFolder(folder, overwrite=overwrite).check([result_name(entry.id)], by_size=True)
        for subfolder, files in names.items():
            place = check_no_link(folder / subfolder)
            OutputFolder(place, overwrite=overwrite).check(files, by_size=True)


def _places_of_inputs(entries: Sequence[Entry]) -> dict[str, str]:
    """Return every real path that is an input or is above one, with the input as it was given."""
    places: dict[str, str] = {}
    for entry in entries:
        for source in (entry.session, entry.prior):
            if source and not is_remote(source):
                real = Path(os.path.realpath(source))
                for place in (real, *real.parents):
                    places.setdefault(str(place), source)
    return places
