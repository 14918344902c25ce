"""Fills in the templates (`*.j2`) that stand beside the code, and makes what is put into them.

Purpose: `filled` is the one way to fill them in. A name without a value is an error; texts for HTML
and XML are escaped. The lines of a page's template are joined without their indentation, which is
there for its readers only. `sections_main` makes headings, sentences and tables, as a command told
them. `script_json` makes JSON for a script element; `rounded_numbers` rounds; `packed_numbers`
gives a long list of rounded numbers as differences of whole numbers, `{"e": digits, "d": [...]}`,
which the page (`assets/packed.js`) adds up and divides by 10^e: the same doubles.
Non-goals: what is told; pictures, which pages put beside these sections; compression that a browser
might not know.
"""

from __future__ import annotations

import json
import math
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from soter.report.wording import prose, visible

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from jinja2 import Environment
    from numpy.typing import NDArray


PAGE = ".html.j2"
ESCAPED = (PAGE, ".xml.j2")


def filled(template: str, /, **context: object) -> str:
    """Fills a template with values; `template` is its path below the `soter` folder."""
    return _environment().get_template(template).render(context)


@cache
def _environment() -> Environment:
    import jinja2  # noqa: PLC0415 - `check` needs no template
    from jinja2.ext import Extension  # noqa: PLC0415 - the same
    from markupsafe import Markup  # noqa: PLC0415 - the same

    class JoinedLines(Extension):
        def preprocess(self, source: str, name: str | None, _file: str | None = None) -> str:
            return re.sub(r"\n\s*", "", source) if name and name.endswith(PAGE) else source

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).resolve().parents[1]),
        extensions=[JoinedLines],
        undefined=jinja2.StrictUndefined,
        autoescape=lambda name: name is not None and name.endswith(ESCAPED),  # noqa: S701 - C is C
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["hash64"] = "{:#018x}".format
    environment.filters["visible"] = visible
    environment.filters["prose"] = lambda text: Markup(prose(text))  # noqa: S704 - it escapes
    return environment


@dataclass(frozen=True)
class PageSection:
    """A heading, sentences below it, and a table: rows of text under `head`.

    `opens`: the index of the row to which the table first scrolls. `drawn`: HTML.
    """

    title: str
    says: tuple[str, ...]
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    opens: int | None = None
    drawn: str = ""


def sections_main(title: str, headline: str, verdict: str, sections: Sequence[PageSection]) -> str:
    """The HTML body of a page; `verdict` ("good", "bad" or "") sets the headline's colour."""
    return filled(
        "report/plain_page.html.j2",
        title=title,
        headline=headline,
        verdict=verdict,
        sections=sections,
    )


LONG = 50
"""Shorter lists stay as they are."""
DIGITS_MAX = 12
EXACT_MAX = 2**53
"""Up to here doubles hold every whole number, so that one division gives the nearest double."""


def script_json(value: object) -> str:
    """The JSON of a value, in which no text can end the script element; ValueError for NaN."""
    text = json.dumps(value, allow_nan=False, separators=(",", ":"))
    for char in "<>&\u2028\u2029":
        text = text.replace(char, f"\\u{ord(char):04x}")
    return text


def rounded_numbers(values: NDArray[np.float64], digits: int = 3) -> list[float | None]:
    """The values (N,), rounded for JSON; a non-finite value becomes null, a gap in a line."""
    import numpy as np  # noqa: PLC0415 - sections of text need no figures

    rounded = np.round(values.astype(np.float64), digits) + 0.0
    return [value if np.isfinite(value) else None for value in rounded.tolist()]


def packed_numbers(value: object) -> object:
    """Packs a list of more than `LONG` numbers and gaps (None); other values stay unchanged.

    A list stays if an item is no number or has more than 12 digits after the decimal point.
    """
    if not isinstance(value, list) or len(value) <= LONG:
        return value
    if not all(v is None or (type(v) in (int, float) and math.isfinite(v)) for v in value):
        return value
    digits = max((_decimal_digits(v) for v in value if v is not None), default=0)
    if digits > DIGITS_MAX:
        return value
    deltas: list[int | None] = []
    before = 0
    for v in value:
        if v is None:
            deltas.append(None)
            continue
        whole = round(v * 10**digits)
        if abs(whole) > EXACT_MAX or whole / 10**digits != v:
            return value
        deltas.append(whole - before)
        before = whole
    return {"e": digits, "d": deltas}


def _decimal_digits(value: float) -> int:
    """How many digits the shortest decimal for this double has after the decimal point."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    return max(len(mantissa.partition(".")[2].rstrip("0")) - int(exponent or 0), 0)
