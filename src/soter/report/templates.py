"""Text from the templates (`*.j2`) that stand beside the code: of pages, and of packages.

Purpose: one way to fill them in. A name that nobody gives is an error; whatever goes into HTML and
XML is escaped. Non-goals: what is filled in.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment

ESCAPED = (".html.j2", ".xml.j2")


def filled(template: str, /, **context: object) -> str:
    """The text of a template, which is named by its path below this package."""
    return _environment().get_template(template).render(context)


@cache
def _environment() -> Environment:
    import jinja2  # noqa: PLC0415 - `check` needs no template

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).resolve().parents[1]),
        undefined=jinja2.StrictUndefined,
        autoescape=lambda name: name is not None and name.endswith(ESCAPED),  # noqa: S701 - C is C
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["hash64"] = "{:#018x}".format
    return environment
