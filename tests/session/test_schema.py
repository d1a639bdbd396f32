"""Mappings of any kind are read, or refused in a sentence; numbers that are written read as the
same numbers.
"""

from collections.abc import Mapping
from pathlib import Path

import pytest
import yaml
from hypothesis import assume, example, given
from hypothesis import strategies as st

from calib.errors import InputError
from calib.io.yaml_reader import read_yaml
from calib.session.board_section import SQUARE
from calib.session.camera import COEFFICIENT, PINHOLE
from calib.session.schema import Number, Quantity, Section
from calib.session.session import session_from_mapping, session_to_yaml
from calib.session.shapes.registry import dimensions
from tests.session.malformed import CONE, DOME, FLAT, SESSION

QUANTITIES = [
    SQUARE,
    *PINHOLE,
    COEFFICIENT,
    *{entry.quantity.key: entry.quantity for entry in dimensions()}.values(),
]


def read(quantity: Quantity, written: object) -> Number:
    return Section({}, "session.yaml").number(quantity.key, written, quantity)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("schema") / "session.yaml"


@given(data=st.data(), quantity=st.sampled_from(QUANTITIES))
def test_a_number_that_was_read_is_written_and_read_as_the_same(
    file: Path, data: st.DataObject, quantity: Quantity
) -> None:
    """Through YAML text, to the last bit, its sigma too."""
    value = data.draw(st.floats(max(quantity.low, -1e300), min(quantity.high, 1e300)), "value")
    sigma = data.draw(st.one_of(st.none(), st.floats(1e-100, 1e100)), "sigma")
    number = read(quantity, value if sigma is None else {"value": value, "sigma": sigma})
    file.write_text(yaml.safe_dump({quantity.key: quantity.to_yaml(number)}))
    assert read(quantity, read_yaml(file)[quantity.key]) == number


@given(quantity=st.sampled_from(QUANTITIES), share=st.floats(0, 1))
def test_a_number_that_was_computed_comes_back_to_the_last_bit_but_one(
    quantity: Quantity, share: float
) -> None:
    low, high = max(quantity.low, -1e6), min(quantity.high, 1e6)
    value = (low + share * (high - low)) / quantity.unit[1]
    written = quantity.to_yaml(Number(value))
    assert isinstance(written, float)
    assert written / quantity.unit[1] == pytest.approx(
        value, rel=4.5e-16, abs=5e-324
    )  # two units of the last place


words = st.one_of(
    st.text(max_size=8),
    st.sampled_from(["cone", "flat", "dome", "none", "cylinder", "1.5", "3 mm", "nan", "-"]),
)
scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**17), 10**18 - 1),
    st.floats(),
    st.sampled_from([0.05, 1.5, 3, 20, 1000]),
    words,
)
keys = st.one_of(
    words,
    st.sampled_from(
        [
            "format",
            "board",
            "camera",
            "cover",
            "columns",
            "rows",
            "square_mm",
            "width",
            "height",
            "model",
            "intrinsics",
        ]
    ),
    st.sampled_from(
        [
            "fx",
            "fy",
            "cx",
            "cy",
            "distortion",
            "lens",
            "lens_coefficients",
            "shutter",
            "readout_ms",
            "shape",
            "value",
            "sigma",
            *(q.key for q in QUANTITIES),
        ]
    ),
)
nested = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=5), st.dictionaries(keys, inner, max_size=5)),
    max_leaves=12,
)
"""Return the values that `read_yaml` may return: keys are text, and numbers of 19 digits or more
are floats.
"""

GOOD = [
    yaml.safe_load(SESSION.replace(CONE, cover))
    for cover in (CONE, FLAT, DOME.replace("40.0", "20.0"), "  shape: none\n")
]


def places(mapping: Mapping[str, object], path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Every key of a mapping and of those in it."""
    results = []
    for key, value in mapping.items():
        results.append((*path, key))
        if isinstance(value, Mapping):
            results += places(value, (*path, key))
    return results


def changed(
    mapping: Mapping[str, object], path: tuple[str, ...], value: object
) -> dict[str, object]:
    inner = mapping[path[0]] if len(path) > 1 else None
    return {
        **mapping,
        path[0]: changed(inner, path[1:], value) if isinstance(inner, Mapping) else value,
    }


def read_or_refused(mapping: Mapping[str, object]) -> bool:
    """Whether it is read; what is read is written and read as the same."""
    setup = {key: value for key, value in mapping.items() if key != "format"}
    refused = ""
    try:
        board, camera, cover = session_from_mapping(setup, "session.yaml")
    except InputError as error:
        refused = str(error)
    if refused:
        assert refused.startswith("session.yaml: ")
        return False
    assert session_from_mapping(session_to_yaml(board, camera, cover), "again") == (
        board,
        camera,
        cover,
    )
    return True


@pytest.mark.parametrize("good", GOOD, ids=lambda good: good["cover"]["shape"])
def test_each_good_session_is_read(good: dict[str, object]) -> None:
    assert read_or_refused(good)


@given(st.dictionaries(keys, nested, max_size=5))
@example({})
def test_any_mapping_is_read_or_refused_in_a_sentence(mapping: dict[str, object]) -> None:
    read_or_refused(mapping)


@given(st.data(), st.sampled_from(GOOD), nested)
def test_a_good_session_with_anything_in_one_place_is_read_or_refused_in_a_sentence(
    data: st.DataObject, good: dict[str, object], value: object
) -> None:
    read_or_refused(changed(good, data.draw(st.sampled_from(places(good)), "place"), value))


@given(st.sampled_from(GOOD), keys, nested)
def test_a_key_more_is_refused(good: dict[str, object], key: str, value: object) -> None:
    assume(key not in good)
    assert not read_or_refused({**good, key: value})
