"""The width of figures on the command line."""

import re

from geovp_classic.errors import BadData


def width_in(text: str, min_in: float = 2.5) -> float:
    """Parse a length such as "3.3in", "84mm" or "240pt" into inches.

    Raise BadData for other texts, and for a length below `min_in`.
    """
    units_in = {"in": 1.0, "cm": 1 / 2.54, "mm": 1 / 25.4, "pt": 1 / 72.27, "": 1.0}
    match = re.fullmatch(r"(\d+\.?\d*|\.\d+)\s*([a-z]*)", text)
    if not match or match[2] not in units_in:
        raise BadData(f"--width {text!r} is not a length: give a length such as 3.3in or 84mm")
    inches = float(match[1]) * units_in[match[2]]
    if inches < min_in:
        raise BadData(f"--width {text} is too narrow for legible labels: give {min_in}in or more")
    return inches
