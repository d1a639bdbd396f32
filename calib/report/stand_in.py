"""Placeholder colours for matplotlib, and the variables of style.css that replace them.

The variables differ between the light and the dark theme.
"""

INK, FAINT = "#010101", "#020202"
SERIES = ("#030301", "#030302", "#030303", "#030304", "#030305")
VARIABLES = {INK: "--ink", FAINT: "--faint"} | {
    colour: f"--series-{i}" for i, colour in enumerate(SERIES)
}
"""The variable of style.css that replaces each placeholder colour."""
