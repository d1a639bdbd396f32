"""Programs for other programs, which exports write beside their data."""

from importlib.resources import files


def file_beside(name: str) -> str:
    """Return the text of a file of this package."""
    return files("calib.export").joinpath(name).read_text(encoding="utf-8")
