"""docs/tolerances.md has the table of calib/session/tolerances.py, and every number that a cover
can have is of one of its kinds.
"""

import math
import re
from pathlib import Path

from calib.session import tolerances
from calib.session.shapes.registry import dimensions
from calib.session.tolerances import Tolerance, WidePrior

PAGE = (Path(__file__).parents[2] / "docs" / "tolerances.md").read_text(encoding="utf-8")
TABLE = {name: value for name, value in vars(tolerances).items() if isinstance(value, Tolerance)}
WRITTEN = {"m": (1e3, " mm"), "rad": (math.degrees(1), " deg"), "px": (1.0, " px"), "": (1.0, "")}


def test_the_page_has_the_table() -> None:
    rows = re.findall(r"^\| `(\w+)` \| (.*?) \| (.*?) \|$", PAGE, re.MULTILINE)
    expected = []
    for name, kind in TABLE.items():
        factor, unit = WRITTEN[kind.unit]
        expected.append((name, f"{kind.sigma * factor:.3g}{unit}", kind.reason))
    for name, prior in vars(tolerances).items():
        if isinstance(prior, WidePrior):
            factor, unit = WRITTEN[prior.unit]
            stated = f"{prior.mean * factor:.3g} ± {prior.sigma * factor:.3g}{unit}"
            expected.append((name, stated, prior.reason))
    assert rows == expected


def test_every_number_of_a_cover_has_one_tolerance_or_none() -> None:
    kinds: dict[str, tuple[Tolerance | None, str, str]] = {}
    for dimension in dimensions():
        kind = dimension.tolerance, dimension.option, dimension.effect
        for name in dimension.quantity.names:
            assert kinds.setdefault(name, kind) == kind
    assert {name for name, (tolerance, *_) in kinds.items() if not tolerance} == {"outside_index"}
    assert all(option for tolerance, option, _ in kinds.values() if tolerance)
    assert all(dimension.quantity.wide for dimension in dimensions())
