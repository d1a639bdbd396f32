"""An index of refraction with its colours in session.yaml."""

import pytest

from calib.errors import InputError
from calib.session.cover import Cover
from calib.session.cover_section import cover_sections, cover_to_yaml, read_cover
from calib.session.schema import Section
from calib.session.typed_number import typed_number

GLASS = {"shape": "flat", "distance_mm": 20.0, "thickness_mm": 6.0}


def read(cover: object) -> Cover:
    return read_cover(*cover_sections(Section({"cover": cover}, "session.yaml"), ""))


@pytest.mark.parametrize(
    "index",
    [
        {"value": 1.49, "abbe": 57.0},
        {"value": 1.49, "sigma": 0.01, "abbe": 57.0},
        {"value": 1.49, "exact": True, "abbe": 57.0},
        {"abbe": 57.0},
        {"value": 1.49, "red": 1.487, "blue": 1.497},
    ],
)
def test_a_written_index_is_read_again(index: dict[str, object]) -> None:
    cover = read({**GLASS, "refractive_index": index, "outside_index": {"value": 1.3, "abbe": 55}})
    assert read(cover_to_yaml(cover)) == cover
    assert set(cover.dispersion) == {"refractive_index", "outside_index"}
    assert cover.in_channel("green").parameters == cover.parameters


def test_layers_and_several_covers_have_colours() -> None:
    layers = [{"thickness_mm": 3, "refractive_index": {"value": 1.5, "abbe": 60}}] * 2
    laminated = {"shape": "flat", "distance_mm": 20, "layers": layers}
    cover = read([{**GLASS, "refractive_index": 1.5}, laminated])
    assert read(cover_to_yaml(cover)) == cover
    assert cover.has_dispersion
    assert not cover.dispersion
    blue = cover.in_channel("blue").numbers
    assert (
        blue["cover.refractive_index"].value == 1.5 < blue["cover2.layer2.refractive_index"].value
    )


@pytest.mark.parametrize(
    ("index", "sentence"),
    [
        ({"value": 1.49, "abbe": 5}, "refractive_index.abbe is 5: write a number from 10 to 120"),
        ({"value": 1.49, "red": 1.48}, "refractive_index.blue is missing"),
        ({"value": 1.49, "abbe": 57, "red": 1.48}, "the Abbe number alone"),
        ({"value": "unknown", "red": 1.48, "blue": 1.5}, "or the Abbe number"),
        ({"value": 1.49, "abbe": 57, "yellow": 1}, "yellow is not a key of an index"),
        ({"sigma": 0.1, "abbe": 57}, "value is missing"),
    ],
)
def test_impossible_colours_are_refused(index: object, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        read({**GLASS, "refractive_index": index})


def test_a_typed_index_has_its_colours() -> None:
    assert typed_number("1.49 ± 0.01 abbe 57") == {"value": 1.49, "sigma": 0.01, "abbe": 57}
    assert typed_number("1.49 red 1.487 blue 1.497") == {"value": 1.49, "red": 1.487, "blue": 1.497}
    assert typed_number("1.49 abbe") == "1.49 abbe"
