"""The effects that can be requested by name are known before a fit."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from calib.diagnosis.possible_effects import check_possible
from calib.diagnosis.requested_effects import NAMES
from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.session.session import Session, session_from_mapping

HELD = Settings(free=("none",))
CONE = {
    **{
        "shape": "cone",
        "inner_radius_mm": 41.95,
        "radius_slope": -0.105,
        "axis_offset_mm": [0.0, -30.0],
    },
    **{"thickness_mm": {"value": 3.0, "sigma": 0.1}, "refractive_index": 1.5},
}
DOME = {
    "shape": "dome",
    "inner_radius_mm": 50.0,
    "centre_mm": [0.0, 0.0, 0.0],
    "thickness_mm": 3.0,
    "refractive_index": 1.5,
}
BARE = {"shape": "none"}
LENS = {"fx": 1279.0, "fy": 1279.0, "cx": 832.0, "cy": 636.0}


def session(cover: Mapping[str, object], **camera: object) -> Session:
    board = {"columns": 9, "rows": 9, "square_mm": 20.0}
    read = session_from_mapping(
        {"board": board, "camera": {"width": 1640, "height": 1232, **camera}, "cover": cover},
        "here",
    )
    return Session(Path("s"), *read, frames=(), corners=None, bare=None)


@pytest.mark.parametrize(
    ("cover", "camera", "names", "words"),
    [
        (
            CONE,
            {"intrinsics": LENS},
            "flat_port",
            "with cover.shape: cone there can be no flat_port",
        ),
        (
            DOME,
            {"intrinsics": LENS},
            "board_shape,cover_tilt",
            "with cover.shape: dome there can be no cover_tilt",
        ),
        (
            BARE,
            {"intrinsics": LENS},
            "thickness",
            "with cover.shape: none there can be no thickness",
        ),
        (BARE, {"intrinsics": LENS}, "fine_surface", "can be no fine_surface"),
        (
            CONE,
            {"intrinsics": LENS, "shutter": {"type": "global"}},
            "rolling_shutter",
            "cone and a global shutter there can be no",
        ),
        (CONE, {"intrinsics": LENS}, "thickness", "the fit estimates what thickness would change"),
        (CONE, {}, "focal", "the fit estimates what focal would change"),
    ],
)
def test_impossible_effects_are_refused(
    cover: Mapping[str, object], camera: dict[str, object], names: str, words: str
) -> None:
    with pytest.raises(InputError, match=words) as refused:
        check_possible(session(cover, **camera), HELD, names.split(","))
    assert "\n" not in str(refused.value)
    assert str(refused.value).endswith(".")


def test_effects_on_held_numbers_can_be_requested() -> None:
    """All that a cone can have; of the glass, what the session does not give a sigma."""
    at = session(CONE, intrinsics=LENS)
    absent = ("flat_port", "thickness", "screen_glass")
    check_possible(at, HELD, [name for name in NAMES if name not in absent])
    with pytest.raises(InputError, match="with a printed board there can be no screen_glass"):
        check_possible(at, HELD, ["screen_glass"])
    with pytest.raises(InputError, match="estimates what cover_radius would change"):
        check_possible(at, Settings(), ["cover_radius"])


def test_a_requested_window_counts_as_a_cover_for_later_effects() -> None:
    bare = session(BARE, intrinsics=LENS)
    check_possible(bare, HELD, ["flat_port", "cover_tilt"])
    with pytest.raises(InputError, match="no cover_tilt"):
        check_possible(bare, HELD, ["cover_tilt", "flat_port"])
