"""The index of a medium by the colour of light.

The index that session.yaml states is that of green light, which most of a grey picture is made of.
An Abbe number, or the indices of red and blue, say how much the other two channels of a colour
picture differ from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from calib.session.schema import UNKNOWN, Number, Quantity, Section

RED, GREEN, BLUE = CHANNELS = ("red", "green", "blue")
"""The channels of a colour picture."""
WAVELENGTHS_NM = {RED: 610.0, GREEN: 550.0, BLUE: 465.0}
"""nm: the middle of the light that each channel of a colour sensor sees by day."""
D_LINE_NM, F_LINE_NM, C_LINE_NM = 587.56, 486.13, 656.27
"""nm: the spectral lines of yellow, blue and red light by which the Abbe number is defined."""
ABBE_KEY = "abbe"
COLOUR_KEYS = (ABBE_KEY, RED, BLUE)
"""The keys that stand beside the index in session.yaml."""
ABBE = Quantity(ABBE_KEY, low=10, high=120)
"""The dispersion of flint glass is 20, that of fluorite 95."""


@dataclass(frozen=True, slots=True)
class Dispersion:
    """The dependence of a medium's index on the colour of light: an Abbe number, or the indices of
    red and blue light less that of green light.
    """

    abbe: float | None = None
    """(n_d - 1) / (n_F - n_C); None if the two differences are stated."""
    red: float = 0.0
    blue: float = 0.0

    def index(self, green: float, channel: str) -> float:
        """Return the index of the light of one of CHANNELS, from that of green light."""
        if channel == GREEN:
            return green
        if self.abbe is None:
            return green + (self.red if channel == RED else self.blue)
        at_green = _cauchy(WAVELENGTHS_NM[GREEN]) / self.abbe
        at_channel = _cauchy(WAVELENGTHS_NM[channel]) / self.abbe
        return 1 + (green - 1) * (1 + at_channel) / (1 + at_green)


def _cauchy(wavelength: float) -> float:
    """Return (n - n_d) / (n_F - n_C) of Cauchy's equation n = a + b / wavelength^2; `wavelength` is
    in nm.
    """
    return (wavelength**-2 - D_LINE_NM**-2) / (F_LINE_NM**-2 - C_LINE_NM**-2)


def read_dispersion(section: Section, quantity: Quantity) -> tuple[Section, Dispersion | None]:
    """Return the section with the index as a plain number, which may have a sigma, and its
    dispersion; None if it has none.
    """
    written = section.values.get(quantity.key)
    if not isinstance(written, Mapping) or not any(key in written for key in COLOUR_KEYS):
        return section, None
    pair = Section(written, section.file, section.key_path(quantity.key))
    pair.allow_only(("value", "sigma", "exact", *COLOUR_KEYS), "key of an index with its colours")
    remainder = {key: value for key, value in written.items() if key not in COLOUR_KEYS}
    index = remainder if remainder.keys() - {"value"} else remainder.get("value", UNKNOWN)
    plain = Section({**section.values, quantity.key: index}, section.file, section.path)
    if ABBE_KEY not in written:
        green = _index(pair, "value", quantity)
        red = _index(pair, RED, quantity)
        blue = _index(pair, BLUE, quantity)
        return plain, Dispersion(red=red - green, blue=blue - green)
    if len(written) > len(remainder) + 1:
        advice = f"the Abbe number alone, or {RED} and {BLUE} in its place"
        raise pair.error(ABBE_KEY, written[ABBE_KEY], advice)
    return plain, Dispersion(abbe=pair.number(ABBE_KEY, written[ABBE_KEY], ABBE).value)


def dispersion_to_yaml(index: object, green: Number, dispersion: Dispersion) -> dict[str, object]:
    """Return the YAML value that is read as this index with its dispersion. `index` is the YAML
    value without it.
    """
    mapping = dict(index) if isinstance(index, Mapping) else {"value": index}
    if dispersion.abbe is not None:
        return {**mapping, ABBE_KEY: dispersion.abbe}
    indices = {channel: dispersion.index(green.value, channel) for channel in (RED, BLUE)}
    return {**mapping, **indices}


def _index(pair: Section, key: str, quantity: Quantity) -> float:
    expected = f"the index of {key if key != 'value' else GREEN} light"
    number = pair.number(key, pair.get(key, expected), quantity)
    if number.unknown:
        raise pair.error(key, pair.values[key], f"{expected}, or the Abbe number")
    return number.value
