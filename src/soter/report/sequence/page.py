"""The sequence view: one page on which a trace can be read step by step.

Purpose: what failed and where, in a sentence; the drawing with its legend; the same steps as a
table, which serves readers without a script or without eyes; what it rests on.
Non-goals: laying the drawing out (`sequence_drawing`), replaying.
"""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING

from soter.report.html import document, write_text
from soter.report.plain_page import data_head
from soter.report.printable_text import visible
from soter.report.run.result_wording import prose
from soter.report.sequence.drawing import (
    GUTTER_PX,
    MARKS,
    body_svg,
    gutter_svg,
    head_groups,
    plan,
    unread,
)
from soter.report.sequence.text import does, explanation, late_text, published_text
from soter.report.sequence.view import duration_text, matter_text, violating

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from soter.report.sequence.drawing import DrawingPlan
    from soter.report.sequence.view import Lane, SequenceStep, SequenceView

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
COLUMNS = ("step", "time", "actor", "does", "publishes", "")


def write_page(view: SequenceView, path: str | os.PathLike[str]) -> Path:
    """Write the page to `path` and return it; it needs no network. Raises `ReportError`."""
    return write_text(page(view), path)


def page(view: SequenceView) -> str:
    """Return the whole file as text; the same view gives the same text."""
    sections = [_header(view), _drawing(view), _table(view), _grounds(view), _provenance(view)]
    main = "\n".join(section for section in sections if section)
    return document(f"{visible(view.test)}: a sequence", main, "sequence")


def _header(view: SequenceView) -> str:
    names = (view.program, view.system, view.test)
    kicker = " · ".join(escape(visible(name)) for name in names if name)
    says = f'<p class="subtitle">{prose(visible(view.property_text))}</p>'
    return (
        f'<header class="top"><p class="kicker">{kicker}</p>'
        f"<h1><span>{_unbroken(prose(visible(view.verdict)))}</span></h1>"
        f"{says if view.property_text else ''}{_why(view)}{_matter(view)}{_remark(view)}</header>"
    )


def _matter(view: SequenceView) -> str:
    said = matter_text(view)
    return f'<p class="note">{_unbroken(prose(said))}</p>' if said else ""


def _remark(view: SequenceView) -> str:
    text = _unbroken(prose(visible(view.remark)))
    return f'<p class="note">{text}</p>' if view.remark else ""


def _unbroken(html: str) -> str:
    """Keep a number and its unit on one line."""
    return TIME.sub(r"\1&nbsp;\2", html)


def _why(view: SequenceView) -> str:
    step = violating(view)
    if step is None:
        return ""
    said = _unbroken(prose(explanation(view)))
    return (
        f'<p class="why-fails"><i class="mark cross"></i><span>{said} '
        f'<a href="#row-{step.number}">Show it</a></span></p>'
    )


# ---------------------------------------------------------------- the drawing


def _drawing(view: SequenceView) -> str:
    laid = plan(view)
    width = GUTTER_PX + laid.width
    share = min(PAPER_PX / width, 1.0)
    return (
        f'<section>{_key(view)}<p class="note sideways">Wider than this window: it scrolls '
        f"sideways over {_lanes_told(view)}.</p>"
        f'<div class="frame" style="--need: {width:g}px; --paper-share: {share:.3f}">'
        '<div class="scroller" tabindex="0" role="group" '
        'aria-label="Sequence; the arrow keys go from step to step">'
        f'<div class="sheet" style="width: {width:g}px">'
        f'{_head(view, laid)}<div class="rows">{gutter_svg(laid)}{body_svg(laid)}</div></div></div>'
        '<aside class="panel" aria-live="polite" hidden></aside></div>'
        '<p class="note scripted" hidden>Point at a step, or click to keep it; '
        "<kbd>↑</kbd> <kbd>↓</kbd> go from step to step, <kbd>Home</kbd> <kbd>End</kbd> to the "
        "first and the last, <kbd>v</kbd> to the violation, <kbd>Esc</kbd> clears.</p></section>"
    )


def _lanes_told(view: SequenceView) -> str:
    """The lanes from the left to the right, with their roles."""
    names = (f"{_name(lane.name)} ({ROLES[lane.role]})" for lane in view.lanes)
    return ", ".join(dict.fromkeys(names))


def _head(view: SequenceView, laid: DrawingPlan) -> str:
    """Name the lanes, under the modules they belong to; stays in view."""
    groups = "".join(
        f'<div class="{"module" if module is not None else "free"}" '
        f'style="width: {count * laid.lane_px:g}px"><span>{_name(module or "")}</span></div>'
        for module, count in head_groups(view.lanes)
    )
    lanes = "".join(_lane(lane, laid.lane_px) for lane in view.lanes)
    modules = f'<div class="modules">{groups}</div>' if any(m.module for m in view.lanes) else ""
    return (
        f'<div class="head"><div class="corner" style="width: {GUTTER_PX}px">'
        f"<span>time</span><span>step</span></div>"
        f'<div>{modules}<div class="lanes">{lanes}</div></div></div>'
    )


def _lane(lane: Lane, lane_px: float) -> str:
    inside = lane.module is not None and lane.name.startswith(f"{lane.module}.")
    name = lane.name[len(lane.module or "") + 1 :] if inside else lane.name
    plain = "" if name.lower() == ROLES[lane.role].lower() else f"<span>{_name(name)}</span>"
    return (
        f'<div class="lane" style="width: {lane_px:g}px" title="{escape(visible(lane.name))}">'
        f'<b class="role {lane.role}">{ROLES[lane.role]}</b>{plain}</div>'
    )


def _name(name: str) -> str:
    """Escape a dotted name; it may break after a dot."""
    return escape(visible(name)).replace(".", ".<wbr>")


def _key(view: SequenceView) -> str:
    """Explain the marks that occur."""
    entries = [entry for shown, entry in _marks(view) if shown]
    items = "".join(f"<li>{sign}<span>{text}</span></li>" for sign, text in entries)
    return f'<ul class="key">{items}</ul>'


def _marks(view: SequenceView) -> list[tuple[bool, tuple[str, str]]]:
    steps = view.steps
    kinds = {step.kind for step in steps}
    picks = [pick for step in steps for pick in step.choices]
    return [
        (True, ('<i class="sample-step"></i>', "a step")),
        (
            any(pick.default for pick in picks),
            (f"<b>{MARKS['default']}</b>", "a choice, the default"),
        ),
        (
            any(not pick.default for pick in picks),
            (f'<b class="chosen">{MARKS["other"]}</b>', "another choice than the default"),
        ),
        (
            any(step.published for step in steps),
            ('<i class="sample-arrow"></i>', "a value, from its writer to its readers"),
        ),
        (
            any(unread(view, step) for step in steps),
            ('<i class="sample-unread"></i>', "a value that no other actor reads"),
        ),
        (
            any(step.dropped for step in steps),
            ('<b class="dropped">queue full</b>', "a full queue lost a value"),
        ),
        (
            any(step.gated for step in steps),
            ('<i class="sample-gated"></i>', "computed, outputs not enabled"),
        ),
        (bool(view.modes), ('<i class="area mode-ac"></i>', "AC in control")),
        (bool(view.modes), ('<i class="area mode-sc"></i>', "SC in control")),
        (
            any(late_text(step) for step in steps),
            ('<i class="sample-late"></i>', "from the release to the late step"),
        ),
        ("lost" in kinds, ('<i class="sample-lost"></i>', "a release that is lost")),
        (
            "overrun" in kinds,
            ('<i class="sample-running"></i>', "from the start of a step to its effect"),
        ),
        (
            any(step.observable for step in steps),
            ('<i class="sample-checked"></i>', "properties are checked here"),
        ),
        (
            bool(matter_text(view)),
            ('<i class="sample-step aside"></i>', "pale: a step that does not matter"),
        ),
        (violating(view) is not None, ('<i class="mark cross"></i>', "the violation")),
    ]


# ---------------------------------------------------------------- words


def _table(view: SequenceView) -> str:
    head = "".join(f'<th scope="col">{name}</th>' for name in COLUMNS)
    rows = "".join(map(_step, view.steps))
    return (
        '<section><h2>Every step</h2><div class="scroll"><table class="events steps stacked">'
        f"<thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div></section>"
    )


def _step(step: SequenceStep) -> str:
    late = late_text(step)
    after = f'<br><span class="late">{late}</span>' if late else ""
    time = escape(duration_text(step.time_ns))
    deeds = [f"<li>{prose(phrase)}</li>" for phrase in does(step)]
    if step.note:
        deeds.append(f'<li class="detail">{prose(visible(step.note))}</li>')
    values = "".join(f"<li>{escape(published_text(value))}</li>" for value in step.published)
    marks = [
        *(['<span class="violated"><i class="mark cross"></i>violated</span>']
          if step.violates else []),
        *(['<span class="detail">checked</span>'] if step.observable else []),
    ]  # fmt: skip
    return (
        f'<tr id="step-{step.number}" class="{"violates" if step.violates else step.kind}'
        f'{"" if step.matters else " aside"}">'
        f'<td class="number"{data_head("step")}><a href="#row-{step.number}">{step.number}</a></td>'
        f'<td class="where"{data_head("time")}>{time}{after}</td>'
        f"<td{data_head('actor')}>{_name(step.lane)}</td>"
        f"<td{data_head('does')}>{_items(''.join(deeds))}</td>"
        f'<td class="values{" gated" if step.gated else ""}"{data_head("publishes")}>'
        f"{_items(values)}</td>"
        f"<td>{' '.join(marks)}</td></tr>"
    )


def _items(items: str) -> str:
    return f"<ul>{items}</ul>" if items else ""


def _grounds(view: SequenceView) -> str:
    if not view.assumptions:
        return ""
    items = "".join(f"<li>{prose(visible(text))}</li>" for text in view.assumptions)
    return f'<section class="grounds"><h2>What this rests on</h2><ul>{items}</ul></section>'


def _provenance(view: SequenceView) -> str:
    told = {
        "program": view.program,
        "program sha256": view.program_sha256,
        "system": view.system,
        "test": view.test,
        "seed": str(view.seed),
        "soter": view.tool_version,
        **view.provenance,
    }
    items = "".join(
        f"<div><dt>{escape(visible(name))}</dt><dd>{escape(visible(value))}</dd></div>"
        for name, value in told.items()
        if value
    )
    return f'<section class="provenance"><h2>Provenance</h2><dl>{items}</dl></section>'
