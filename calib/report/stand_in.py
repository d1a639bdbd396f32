"""The colours that figures are drawn with, in place of the page's own: variables of style.css,
which follow light and dark.
"""

INK, FAINT = "#010101", "#020202"
SERIES = ("#030301", "#030302", "#030303", "#030304", "#030305")
VARIABLES = {INK: "--ink", FAINT: "--faint"} | {
    colour: f"--series-{i}" for i, colour in enumerate(SERIES)
}
"""Stand-in colours, and the variable of style.css that each becomes."""
