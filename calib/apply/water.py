"""The index of refraction of water against air, by its salinity and temperature and the light's
wavelength.

Source: X. Quan and E. S. Fry, Empirical equation for the index of refraction of seawater, Applied
Optics 34 (1995) 3477, equation 3. It holds to 1.5e-5 from 0 to 30 degrees C, 0 to 35 per mille, and
400 to 700 nm.
"""

from calib.errors import InputError, brief
from calib.io.numerals import real_number
from calib.session import dispersion
from calib.session.dispersion import WAVELENGTHS_NM, Dispersion

SALINITY = (0.0, 35.0)
"""per mille: the range of the equation."""
TEMPERATURE = (0.0, 30.0)
"""degrees C: the range of the equation."""
WAVELENGTH = (400.0, 700.0)
"""nm: the range of the equation."""
GREEN = 550.0
"""nm: the middle of the light that a colour camera sees."""
WATER_ABBE = 55.0
"""The Abbe number of water of unknown salinity and temperature."""


def index_of_water(salinity: float, temperature: float, wavelength: float = GREEN) -> float:
    """Return the index of refraction of water against air.

    Args:
        salinity: per mille by weight; 0 is fresh water, 35 the oceans'.
        temperature: degrees C
        wavelength: nm, of the light.

    Raises:
        InputError: a number is outside the range of the equation.
    """
    for value, (low, high), name in (
        (salinity, SALINITY, "salinity"),
        (temperature, TEMPERATURE, "temperature"),
        (wavelength, WAVELENGTH, "wavelength"),
    ):
        if not low <= real_number(value, name) <= high:
            raise InputError(
                f"{name} is {brief(repr(value))}: give a number from {low:g} to {high:g}."
            )
    salt = (1.779e-4 - 1.05e-6 * temperature + 1.6e-8 * temperature**2) * salinity
    spread = (15.868 + 0.01155 * salinity - 0.00423 * temperature) / wavelength
    return (
        1.31405
        + salt
        - 2.02e-6 * temperature**2
        + spread
        - 4382 / wavelength**2
        + 1.1455e6 / wavelength**3
    )


def dispersion_of_water(salinity: float, temperature: float) -> Dispersion:
    """Return by how much the index of water differs between the channels of a colour picture. The
    arguments are those of `index_of_water`.
    """
    green = index_of_water(salinity, temperature, WAVELENGTHS_NM[dispersion.GREEN])
    red = index_of_water(salinity, temperature, WAVELENGTHS_NM[dispersion.RED])
    blue = index_of_water(salinity, temperature, WAVELENGTHS_NM[dispersion.BLUE])
    return Dispersion(red=red - green, blue=blue - green)
