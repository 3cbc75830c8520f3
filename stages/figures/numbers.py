"""Numbers, lengths and names as the report writes them. Values in, text out."""

from __future__ import annotations

import math
from collections.abc import Sequence

from pipeline.report import MISSING as MISSING

MINUS = "\u2212"
NO_BREAK = "\u00a0"
MM = 1e3
"""Millimetres per metre."""

UNDISTURBED = "none"
"""Name of the condition in which nothing happens."""

NAMES = {
    "lpvds": "plain LPV-DS",
    "clpvds robust": "robust CLPV-DS",
    "clpvds paper": "printed CLPV-DS",
}
"""What figures and tables call the controllers."""

KINDS = {"qlf": "QLF", "pqlf": "P-QLF", "warped": "warped"}
"""What figures and tables call the kinds of dynamics, in their order."""

METHODS = {
    "none": "nothing",
    "roas": "ROAS as printed",
    "roas+": "ROAS+",
    "apf": "APF",
    "modulation": "modulation",
    "cbf": "CBF-QP",
}
"""What figures and tables call methods of avoidance that have no name of their own."""


def method_title(name: str) -> str:
    """The name of a method of avoidance: its own, or that of its kind."""
    return METHODS.get(name, name)


def kind_name(kind: str) -> str:
    """The name of a kind of dynamics."""
    return KINDS.get(kind, kind)


def controller_name(label: str) -> str:
    """The name of a controller, from its label."""
    return NAMES.get(label, label)


def condition_name(name: str) -> str:
    """The name of a condition as the paper writes it."""
    if name == UNDISTURBED:
        return "undisturbed"
    return f"Cond. {name[4:]}" if name.startswith("cond") and name[4:].isdigit() else name


def number(value: float | None, digits: int = 3) -> str:
    """A measured number to `digits` significant digits; all digits before the point; far from 1 by powers of ten."""
    if value is None or math.isnan(value):
        return MISSING
    if math.isinf(value):
        return "infinite"
    if value == 0 or isinstance(value, int):
        return f"{value:.0f}".replace("-", MINUS)
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    exponent = int(power)  # of the rounded value
    if not -3 <= exponent <= 7:
        return f"{mantissa}{_times_ten(exponent)}".replace("-", MINUS)
    return f"{value:.{max(0, digits - 1 - exponent)}f}".replace("-", MINUS)


def given(value: float) -> str:
    """A number as someone set it: without digits that are not there."""
    mantissa, _, power = f"{value:g}".partition("e")
    return f"{mantissa}{_times_ten(int(power)) if power else ''}".replace("-", MINUS)


def span(values: Sequence[float], digits: int = 3) -> str:
    """The one value, or the smallest and the largest, to at most `digits` significant digits."""
    low, high = (given(float(f"{value:.{digits}g}")) for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def percent(ratio: float, *, sign: bool = False) -> str:
    """A ratio as a percentage: whole from 10 %, to a tenth below."""
    value = 100.0 * ratio
    text = f"{value:+.0f}" if abs(value) >= 9.95 else f"{value:+.1f}"
    if text in ("+0.0", "-0.0"):
        text = "0.0"
    return (text if sign else text.removeprefix("+")).replace("-", MINUS) + NO_BREAK + "%"


def vector_mm(values: Sequence[float]) -> str:
    """A vector of metres in millimetres, as in ``[0, 20] mm``."""
    return "[" + ", ".join(given(round(value * MM, 9)) for value in values) + "]" + NO_BREAK + "mm"


def counted(number: int, name: str) -> str:
    """As in ``1 obstacle``, ``2 obstacles``."""
    return f"{number} {name}{'' if number == 1 else 's'}"


def joined(parts: Sequence[str]) -> str:
    """A list as in a sentence."""
    return parts[0] if len(parts) == 1 else ", ".join(parts[:-1]) + " and " + parts[-1]


def cell(value: object) -> str:
    """A parameter's value; none as a dash."""
    if value is None:
        return MISSING
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return given(value)
    if isinstance(value, list):
        return "[" + ", ".join(cell(item) for item in value) + "]"
    return str(value)


def _times_ten(exponent: int) -> str:
    return "·10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
