"""Text from the templates (`*.j2`) that stand beside the code: of pages, and of packages.

Purpose: one way to fill them in. A name that nobody gives is an error; whatever goes into HTML and
XML is escaped. The lines of a page's template are there for its reader: they are joined, without
what they are indented by. Non-goals: what is filled in.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from soter.report.printable_text import visible
from soter.report.run.result_wording import prose

if TYPE_CHECKING:
    from jinja2 import Environment

PAGE = ".html.j2"
ESCAPED = (PAGE, ".xml.j2")


def filled(template: str, /, **context: object) -> str:
    """The text of a template, which is named by its path below this package."""
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
