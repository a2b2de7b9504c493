"""The text of reports: a template in ``studies/templates`` in, sentences around numbers that were computed elsewhere out.

A file ``templates/NAME.txt`` holds Jinja macros, one for each sentence, paragraph or caption; `Words("NAME")` gives each of
them as a function. A macro chooses words by typed values (an enum, a number); it computes nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from studies.errors import StudyError


@cache
def _environment() -> Any:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("studies"), undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        extensions=["jinja2.ext.do"],
    )  # fmt: skip
    environment.filters.update(percent=percent, probability=probability_text, digits=digits, plus_minus=plus_minus)
    environment.filters["capital"] = lambda text: text[:1].upper() + text[1:]
    return environment


class Words:
    """The macros of ``templates/NAME.txt`` as functions of keyword arguments; white space is run together.

    Raises `StudyError` for a macro that the template does not have, `jinja2.UndefinedError` for a value that it lacks.
    """

    def __init__(self, name: str) -> None:
        self.name = name

    def __getattr__(self, macro: str) -> Callable[..., str]:
        module = _environment().get_template(f"{self.name}.txt").module
        if not hasattr(module, macro):
            raise StudyError(f"templates/{self.name}.txt has no macro '{macro}'")
        return lambda **values: " ".join(str(getattr(module, macro)(**values)).split())


def percent(share: float, places: int = 2) -> str:
    """'0.42 %' of 0.0042, to so many significant digits; 'unknown' for NaN."""
    if share != share:
        return "unknown"
    text = f"{100 * share:.{places}g}"
    return f"{float(text):.0f} %" if "e+" in text else f"{text} %"


def probability_text(share: float) -> str:
    """'97 %'; 'more than 99 %' and 'less than 1 %' beyond, as a probability is one among what was compared."""
    return "more than 99 %" if share > 0.99 else "less than 1 %" if share < 0.01 else percent(share)


def digits(value: float, places: int = 3) -> str:
    """A number to so many significant digits; below a million all that stand before the point."""
    rounded = abs(float(f"{value:.{places - 1}e}"))  # 999.7 is 1000
    return f"{value:.0f}" if 10.0**places <= rounded and abs(value) < 1e6 else f"{value:.{places}g}"


def digits_if_any(value: float | None) -> str | None:
    """The same of a cell that may be empty."""
    return None if value is None else digits(value)


def with_unit(text: str, unit: str) -> str:
    """A quantity with its unit, which is left out where it is '1'."""
    return text if unit == "1" else f"{text} {unit}"


def plus_minus(value: float, half: float) -> str:
    """'0.01630 +- 0.00060': half the 95 % interval to two digits, the value to the same place."""
    if not 0 < half < float("inf"):
        return f"{value:.4g} +- {half:.2g}"
    places = max(0, 1 - int(f"{half:e}".split("e")[1]))
    if places > 7:
        return f"{value:.3e} +- {half:.1e}"
    return f"{value:.{places}f} +- {half:.{places}f}"
