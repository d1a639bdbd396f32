"""The tiles in the head of a report: the few numbers that say how good a calibration is."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from calib.apply.map_uncertainty import map_sigmas
from calib.fitting.declared import VIEWS, Comparison, comparisons
from calib.report.evidence import Evidence
from calib.rounding import two_digits
from calib.session.parameter_names import CAMERA


@dataclass(frozen=True, slots=True)
class Tile:
    """A number with its unit, and what it is."""

    label: str
    value: str
    note: str = ""
    """A second number to compare it with; empty if there is none."""

    def html(self) -> str:
        value = _html(self.value)
        note = f"<small>{_html(self.note)}</small>" if self.note else ""
        return f"<div><dt>{escape(self.label)}</dt><dd>{value}{note}</dd></div>"


def _html(text: str) -> str:
    """Return the HTML of a text that may break before its standard deviation: a tile is narrow."""
    return escape(text).replace(" ± ", " <wbr>± ")


def tiles_html(tiles: Sequence[Tile]) -> str:
    return f'<dl class="tiles">{"".join(tile.html() for tile in tiles)}</dl>'


def report_tiles(evidence: Evidence) -> tuple[Tile, ...]:
    """Return the tiles of a calibration: its error, the uncertainty of its maps, its coverage, its
    focal length, and the number that sizes or places its cover, if it was fitted.
    """
    tiles = [_error(evidence), *_maps(evidence)]
    tiles.append(Tile("coverage", f"{100 * evidence.covered:.0f} %", "of the picture has corners"))
    tiles.extend(_scale(evidence))
    return tuple(tiles)


def _error(evidence: Evidence) -> Tile:
    calibration = evidence.calibration
    noise = calibration.noise_px
    note = "" if noise is None else f"noise of the corners {noise:.3f} px"
    if validation := calibration.outcome.cross_validation:
        return Tile("error on held-out views", f"{validation.held_out_px:.3f} px", note)
    diagnosis = calibration.history.diagnosis
    if diagnosis and diagnosis.qualities:
        held_out_px = diagnosis.qualities[-1].held_out_px
        return Tile("error on held-out views", f"{held_out_px:.3f} px", note)
    return Tile("error of the fitted views", f"{calibration.stages[-1].rms_px:.3f} px", note)


def _maps(evidence: Evidence) -> Iterator[Tile]:
    """Yield the tile of the median depth; nothing without a covariance."""
    if not evidence.sigma:
        return
    depth = evidence.depths[len(evidence.depths) // 2]
    sigma = map_sigmas(evidence.calibration, [depth])[depth]
    worst = evidence.worst_sigma([depth])
    yield Tile(
        f"expected error of the map at {depth:g} m", f"{two_digits(sigma)} px", f"largest {worst}"
    )


def _scale(evidence: Evidence) -> Iterator[Tile]:
    numbers = list(comparisons(evidence.calibration))
    of_cover = [n for n in numbers if not (CAMERA.has(n.name) or n.held)]
    focal = [number for number in numbers if number.name == CAMERA.fx]
    for number in (*focal, *of_cover[:1]):
        name = number.name.replace("_", " ").replace(".", " ", 1)
        label = "focal length fx" if number.name == CAMERA.fx else name
        yield Tile(label, number.estimated, origin(number))


def origin(number: Comparison) -> str:
    """Return where the estimate of a number comes from, in a few words."""
    if number.held:
        return "not fitted"
    if number.is_open or number.is_unusual:
        return "these views do not tell it"
    if number.source == VIEWS or number.unknown:
        return "estimated from the views"
    return f"declared {number.stated}"
