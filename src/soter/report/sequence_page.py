"""The sequence view: one page on which a trace can be read step by step.

Purpose: what failed and where, in a sentence; the drawing with its legend; the same steps as a
table, which serves readers without a script or without eyes; what it rests on.
Non-goals: laying the drawing out (`sequence_drawing.py`), replaying.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from soter.report.html import document, write_text
from soter.report.sequence_drawing import (
    GUTTER_PX,
    MARKS,
    body_svg,
    gutter_svg,
    head_groups,
    plan,
    unread,
)
from soter.report.sequence_view import (
    does,
    duration_text,
    explanation,
    late_text,
    matter_text,
    published_text,
    violating,
)
from soter.report.templates import filled
from soter.report.wording import prose, visible

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from soter.report.sequence_view import Lane, SequenceView


ROLES = {
    "plant": "plant",
    "dm": "DM",
    "ac": "AC",
    "sc": "SC",
    "node": "node",
    "input": "input",
}
PAPER_PX = 690
"""Width of the page in print, as in `assets/report.css`."""
TIME = re.compile(r"(\d) (ns|us|µs|ms|s)\b")


def write_page(view: SequenceView, path: str | os.PathLike[str]) -> Path:
    """Write the page to `path` and return it; it needs no network. Raises `ReportError`."""
    return write_text(page(view), path)


def page(view: SequenceView) -> str:
    """Return the whole file as text; the same view gives the same text."""
    laid, steps = plan(view), view.steps
    width = GUTTER_PX + laid.width
    facts = {
        "program": view.program,
        "program sha256": view.program_sha256,
        "system": view.system,
        "test": view.test,
        "seed": str(view.seed),
        "soter": view.tool_version,
        **view.provenance,
    }
    main = filled(
        "report/sequence_page.html.j2",
        view=view,
        failing=violating(view),
        explanation=explanation(view),
        matter=matter_text(view),
        unbroken=_unbroken,
        marks=MARKS,
        roles=ROLES,
        unread=any(unread(view, step) for step in steps),
        late=any(late_text(step) for step in steps),
        told=dict.fromkeys((lane.name, ROLES[lane.role]) for lane in view.lanes),
        laid=laid,
        width=width,
        share=min(PAPER_PX / width, 1.0),
        gutter_px=GUTTER_PX,
        groups=head_groups(view.lanes),
        short=_short,
        drawn=gutter_svg(laid) + body_svg(laid),
        late_text=late_text,
        duration_text=duration_text,
        does=does,
        published_text=published_text,
        facts={visible(name): visible(value) for name, value in facts.items() if value},
    )
    return document(f"{visible(view.test)}: a sequence", main, "sequence")


def _unbroken(text: str) -> str:
    """Escape a text for HTML, and keep a number and its unit on one line."""
    return TIME.sub(r"\1&nbsp;\2", prose(visible(text)))


def _short(lane: Lane) -> str:
    """The name of a lane within its module; "" where it only repeats its role."""
    inside = lane.module is not None and lane.name.startswith(f"{lane.module}.")
    name = lane.name[len(lane.module or "") + 1 :] if inside else lane.name
    return "" if name.lower() == ROLES[lane.role].lower() else name
