"""Colours of plots and recordings: distinguishable by the colour-blind (Okabe and Ito), one meaning each."""

LEGS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9")
RUNS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#8C6BB1", "#4D4D4D")
RESPONSE = "#0072B2"
REFERENCE = "#7A828E"
RAW = "#B9C0CA"
DEVIATION = "#D55E00"
MARK = "#E69F00"
SUPPLY = "#4D4D4D"
INK = "#1F2933"
BASE, PLATFORM, CYLINDER, ROD, JOINT = "#6C7482", "#D6DBE2", "#2F5D8A", "#C8CDD4", "#EBAA3C"  # of a machine in 3-D
GRID = "#E3E7EC"


def rgb(color: str) -> tuple[int, int, int]:
    """#RRGGBB as three bytes."""
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)
