"""The index of refraction of water against air, by its salinity and temperature and the light's
wavelength.

Source: X. Quan and E. S. Fry, Empirical equation for the index of refraction of seawater, Applied
    Optics 34 (1995) 3477, equation 3. It
holds from 0 to 30 degrees C, 0 to 35 per mille, and 400 to 700 nm, to 1.5e-5.
"""

from calib.errors import InputError, brief
from calib.io.numerals import number

SALINITY, TEMPERATURE, WAVELENGTH = (0.0, 35.0), (0.0, 30.0), (400.0, 700.0)
"""per mille, degrees C and nm: where the equation holds."""
GREEN = 550.0
"""nm: what a camera of all colours sees most of."""


def index_of_water(salinity: float, temperature: float, wavelength: float = GREEN) -> float:
    """Return the index of water of so much salt, per mille by weight (0 fresh, 35 the oceans'), at
    a temperature, degrees C, for light of a wavelength, nm.

    Raises:
        InputError: the equation does not hold there.
    """
    for value, (low, high), name in (
        (salinity, SALINITY, "salinity"),
        (temperature, TEMPERATURE, "temperature"),
        (wavelength, WAVELENGTH, "wavelength"),
    ):
        if not low <= number(value, name) <= high:
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
