"""The drawing of a trace: lanes side by side, time downwards, a row a step.

Purpose: the SVG of the body and of the column of times beside it. A publication is a line from
its writer with a head at every reader; modes are bands behind the lanes of their module.
Non-goals: style (`assets/sequence.css`), the page around it (`page.py`).

Lengths are in pixels. Labels are set in a monospaced font, so their width is known here.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from soter.report.sequence_view import (
    ARROW,
    KINDS,
    Lane,
    Mode,
    SequenceStep,
    SequenceView,
    clipped,
    does,
    duration_text,
    late_ns,
    late_text,
    published_text,
    reached,
)
from soter.report.tables import display_width
from soter.report.wording import visible

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence


GUTTER_PX = 138
BODY_PX = 1100 - GUTTER_PX
"""Width that the lanes share where they fit; more lanes make the drawing wider."""
LANE_MIN_PX, LANE_MAX_PX = 116, 260
FIRST_PX, LINE_PX, BELOW_PX = 22, 26, 16
"""From the top of a row to its first line, from line to line, from the last to its end."""
UNDER_BOX_PX = 6
"""Added before the second line where a box is on the first, to keep its label off the box."""
DROPPED_PX = 12
"""Added where a label says that a queue is full."""
INSTANT_PX = 6
"""Space between two instants."""
STRIP_PX = 20
"""Space above the first row, for the modes at the start."""
BOX_PX, DOT_PX, LOST_PX, RING_PX = 22, 5, 7.5, 5
CHAR_PX = 6.95
"""Width of a character of the labels: 11.5 px, monospaced."""
LABEL_MAX = 56
MARKS = {"default": "\N{WHITE DIAMOND}", "other": "\N{BLACK DIAMOND}"}


@dataclass(frozen=True)
class StepRow:
    """The place of one step: its top edge, its first line, its height."""

    step: SequenceStep
    top: float
    line: float
    height: float

    def line_of(self, index: int) -> float:
        """The y of the step's publication of that number."""
        return self.line + _below_first(self.step, index)

    @property
    def end(self) -> float:
        """Return the lower edge."""
        return self.top + self.height


@dataclass(frozen=True)
class DrawingPlan:
    """The places of all lanes and steps. `centres`: the middle of each lane, by name."""

    view: SequenceView
    lane_px: float
    centres: dict[str, float]
    rows: tuple[StepRow, ...]

    @property
    def width(self) -> float:
        """Return the width of the body."""
        return self.lane_px * max(len(self.view.lanes), 1)

    @property
    def height(self) -> float:
        """Return the height of the body."""
        return self.rows[-1].end if self.rows else 0.0

    def instants(self) -> list[tuple[StepRow, ...]]:
        """Return the rows of each instant, in order."""
        groups: list[list[StepRow]] = []
        for row in self.rows:
            if not groups or groups[-1][-1].step.time_ns != row.step.time_ns:
                groups.append([])
            groups[-1].append(row)
        return [tuple(group) for group in groups]


def plan(view: SequenceView) -> DrawingPlan:
    """Lay the lanes and the steps out."""
    count = max(len(view.lanes), 1)
    lane_px = float(min(max(BODY_PX // count, LANE_MIN_PX), LANE_MAX_PX))
    centres: dict[str, float] = {}
    for index, lane in enumerate(view.lanes):
        centres.setdefault(lane.name, lane_px * (index + 0.5))
    rows: list[StepRow] = []
    top = float(STRIP_PX) if view.modes else 0.0
    for step in view.steps:
        if rows and rows[-1].step.time_ns != step.time_ns:
            top += INSTANT_PX
        lines = max(len(step.published), 1) if step.lane in centres else 1
        below = BELOW_PX + DROPPED_PX * bool(step.dropped)
        height = FIRST_PX + _below_first(step, lines - 1) + below
        rows.append(StepRow(step, top, top + FIRST_PX, height))
        top += height
    return DrawingPlan(view, lane_px, centres, tuple(rows))


def _below_first(step: SequenceStep, index: int) -> float:
    """The distance from the first line of a step to its line number `index`."""
    return LINE_PX * index + UNDER_BOX_PX * bool(index and _box_word(step)[0])


def body_svg(p: DrawingPlan) -> str:
    """Return the drawing right of the times."""
    layers = (
        _instants(p),
        _modes(p),
        _lifelines(p),
        _lateness(p),
        _overruns(p),
        (_row(p, row) for row in p.rows),
    )
    inside = "\n".join(part for layer in layers for part in layer)
    return (
        f'<svg class="sequence" width="{p.width:g}" height="{p.height:g}" role="img" '
        f'aria-label="Sequence of {len(p.rows)} steps; the table below says the same in words">'
        f"\n{inside}\n</svg>"
    )


def gutter_svg(p: DrawingPlan) -> str:
    """Return the column of times and numbers of steps; it stays in view beside the lanes."""
    parts = [f'<rect class="back" width="{GUTTER_PX}" height="{p.height:g}"/>']
    parts += [
        f'<path class="rule" d="M0 {rows[0].top:g}H{GUTTER_PX}"/>'
        f'<text class="time" x="{GUTTER_PX - 46}" y="{rows[0].line + 4:g}">'
        f"{escape(duration_text(rows[0].step.time_ns))}</text>"
        for rows in p.instants()
    ]
    for row in p.rows:
        step = row.step
        kind = " violates" if step.violates else ""
        tick = (
            f'<path class="checked" d="M{GUTTER_PX - 34} {row.end - 1:g}H{GUTTER_PX}"/>'
            if step.observable
            else ""
        )
        cross = _cross(10, row.line, 5, "cross") if step.violates else ""
        parts.append(
            f'<g class="mark{kind}" data-step="{step.number}">{_hit_area(row, GUTTER_PX)}'
            f'<text class="number" x="{GUTTER_PX - 10}" y="{row.line + 4:g}">{step.number}</text>'
            f"{tick}{cross}</g>"
        )
    return (
        f'<svg class="gutter" width="{GUTTER_PX}" height="{p.height:g}" aria-hidden="true">\n'
        + "\n".join(parts)
        + "\n</svg>"
    )


# ---------------------------------------------------------------- behind the steps


def _instants(p: DrawingPlan) -> Iterator[str]:
    for index, rows in enumerate(p.instants()):
        first, last = rows[0], rows[-1]
        yield (
            f'<rect class="instant{" odd" if index % 2 else ""}" y="{first.top:g}" '
            f'width="{p.width:g}" height="{last.end - first.top:g}"/>'
            f'<path class="rule" d="M0 {first.top:g}H{p.width:g}"/>'
        )


def _modes(p: DrawingPlan) -> Iterator[str]:
    """Shade the lanes of each module in the colour of its mode, from switch to switch."""
    lines = {row.step.number: row.line for row in p.rows}
    for each in p.view.modes:
        lanes = [lane for lane in p.view.lanes if lane.module == each.module]
        named = next((lane for lane in lanes if lane.role == "dm"), lanes[0] if lanes else None)
        tops = [0.0, *(lines.get(number, 0.0) for number, _ in each.modes[1:])]
        ends = [*tops[1:], p.height]
        for (_, mode), top, end in zip(each.modes, tops, ends, strict=False):
            yield from (_band(p, lane, mode, top, end) for lane in lanes)
            if named is not None:
                x = p.centres[named.name] - p.lane_px / 2 + 7
                yield f'<text class="mode {mode.lower()}" x="{x:g}" y="{top + 14:g}">{mode}</text>'


def _band(p: DrawingPlan, lane: Lane, mode: Mode, top: float, end: float) -> str:
    """Shade one lane; the controller that has control is shaded more."""
    held = " held" if lane.role == mode.lower() else ""
    left = p.centres[lane.name] - p.lane_px / 2
    return (
        f'<rect class="mode {mode.lower()}{held}" x="{left + 1:g}" y="{top:g}" '
        f'width="{p.lane_px - 2:g}" height="{max(end - top, 0):g}"/>'
    )


def _lifelines(p: DrawingPlan) -> Iterator[str]:
    for lane in p.view.lanes:
        yield f'<path class="life" d="M{p.centres[lane.name]:g} 0V{p.height:g}"/>'


def _lateness(p: DrawingPlan) -> Iterator[str]:
    """Draw a bar from the release of each late step down to it."""
    last_release = dict.fromkeys(p.centres, -1.0)
    for row in p.rows:
        x = p.centres.get(row.step.lane)
        release_ns = row.step.release_ns
        if x is None or release_ns is None or late_ns(row.step) == 0:
            continue
        top = next(r.top for r in p.rows if r.step.time_ns >= release_ns)
        # Two bars of a lane that overlap in time stand beside each other.
        shift = 5 if top < last_release[row.step.lane] else 0
        last_release[row.step.lane] = row.line
        yield (
            f'<path class="late" d="M{x + shift - 5:g} {top:g}H{x + shift + 5:g}'
            f'M{x + shift:g} {top:g}V{row.line:g}"/>'
        )


def _overruns(p: DrawingPlan) -> Iterator[str]:
    """Draw a step that overruns from its start to where it takes effect."""
    started: dict[str, float] = {}
    for row in p.rows:
        x = p.centres.get(row.step.lane)
        if x is None:
            continue
        if row.step.kind == "overrun":
            started[row.step.lane] = row.line
        elif row.step.kind == "effect" and row.step.lane in started:
            yield _running_bar(x, started.pop(row.step.lane), row.line)
    for name, top in started.items():
        yield _running_bar(p.centres[name], top, p.height)


def _running_bar(x: float, top: float, end: float) -> str:
    return f'<rect class="running" x="{x - 4.5:g}" y="{top:g}" width="9" height="{end - top:g}"/>'


# ---------------------------------------------------------------- a step


def _row(p: DrawingPlan, row: StepRow) -> str:
    """Draw one step, as a link to its row in the table."""
    step = row.step
    kind = " violates" if step.violates else ""
    x = p.centres.get(step.lane)
    inside = _start(p, row) if x is None else _lane_step(p, row, x)
    return (
        f'<a class="row{kind}" id="row-{step.number}" href="#step-{step.number}" '
        f'data-step="{step.number}" data-x="{0 if x is None else x:g}" data-top="{row.top:g}" '
        f'data-end="{row.end:g}"><title>{escape(_title(step))}</title>{_hit_area(row, p.width)}'
        f"{inside}</a>"
    )


def _title(step: SequenceStep) -> str:
    lines = [
        f"step {step.number}, {duration_text(step.time_ns)}"
        + (f", {visible(step.lane)}" if step.lane else ""),
        *([late_text(step)] if late_ns(step) else []),
        *does(step),
        *map(published_text, step.published),
        *([visible(step.note)] if step.note else []),
        *(["the property is violated here"] if step.violates else []),
    ]
    return "\n".join(lines)


def _hit_area(row: StepRow, width: float) -> str:
    return f'<rect class="hit" y="{row.top:g}" width="{width:g}" height="{row.height:g}"/>'


def _start(p: DrawingPlan, row: StepRow) -> str:
    """Draw what concerns the whole system: a box over all lanes."""
    named = [visible(row.step.lane)] if row.step.lane else []
    values = [*named, *does(row.step), *map(published_text, row.step.published)]
    text = clipped("  \N{MIDDLE DOT}  ".join(values), int((p.width - 32) / CHAR_PX))
    return (
        f'<rect class="box start" x="4" y="{row.line - BOX_PX / 2 - 2:g}" rx="4" '
        f'width="{p.width - 8:g}" height="{BOX_PX}"/>'
        f'<text x="14" y="{row.line + 2:g}">{escape(text)}</text>'
    )


def _lane_step(p: DrawingPlan, row: StepRow, x: float) -> str:
    step = row.step
    role = next(lane.role for lane in p.view.lanes if lane.name == step.lane)
    if step.kind == "lost":
        return (
            f'<circle class="lost" cx="{x:g}" cy="{row.line:g}" r="{LOST_PX}"/>'
            + _cross(x, row.line, 3.5, "lost")
            + f'<text class="quiet" x="{x + 13:g}" y="{row.line + 4:g}">release lost</text>'
        )
    box, half = _box(p, step, x, row.line, role)
    parts = []
    if len(step.published) > 1:
        end = row.line_of(len(step.published) - 1)
        parts.append(f'<path class="wire {role}" d="M{x:g} {row.line:g}V{end:g}"/>')
    for index, published in enumerate(step.published):
        y = row.line_of(index)
        edge = half + RING_PX * step.violates if index == 0 else 0.0
        text = published_text(published)
        readers = _reader_places(p, step, published.topic, x)
        parts.append(_publication(p, text, role, x, y, edge, readers))
    if step.dropped:
        y = row.line_of(max(len(step.published) - 1, 0)) + 24
        parts.append(
            f'<text class="dropped" text-anchor="middle" x="{x:g}" y="{y:g}">queue full</text>'
        )
    if late := late_text(step):
        # on the side without the first publication
        parts.append(_late_label(p, late, x, row.line, half, step))
    return "".join(parts) + box


def _late_label(
    p: DrawingPlan, late: str, x: float, y: float, half: float, step: SequenceStep
) -> str:
    goes_right = not step.published or not _goes_right(
        p, x, _reader_places(p, step, step.published[0].topic, x)
    )
    room = (p.width - x if goes_right else x) - half - 8
    if room < display_width(late) * CHAR_PX:
        return f'<text class="late" text-anchor="middle" x="{x:g}" y="{y + 24:g}">{late}</text>'
    place, anchor = (x + half + 6, "start") if goes_right else (x - half - 6, "end")
    return f'<text class="late" text-anchor="{anchor}" x="{place:g}" y="{y + 4:g}">{late}</text>'


def _reader_places(p: DrawingPlan, step: SequenceStep, topic: str, x: float) -> list[float] | None:
    """Return the x of the lanes that get a publication; None: it reaches nobody at all."""
    if not reached(step):
        return None
    names = {reader for flow in p.view.topics if flow.name == topic for reader in flow.readers}
    return sorted(place for name, place in p.centres.items() if name in names and place != x)


def unread(view: SequenceView, step: SequenceStep) -> bool:
    """Tell whether a step publishes a value that no other actor reads."""
    if not step.lane:
        return False
    lanes = {lane.name for lane in view.lanes} - {step.lane}
    readers = {flow.name: lanes.intersection(flow.readers) for flow in view.topics}
    return any(not readers.get(published.topic) for published in reached(step))


def _goes_right(p: DrawingPlan, x: float, readers: Sequence[float] | None) -> bool:
    """Tell on which side a publication's label stands: where its farthest reader is."""
    if not readers:
        return x < p.width * 0.75
    return readers[-1] - x >= x - readers[0]


def _publication(
    p: DrawingPlan,
    text: str,
    role: str,
    x: float,
    y: float,
    edge: float,
    readers: list[float] | None,
) -> str:
    """Draw one value on its way: line, heads, label above the line."""
    right = _goes_right(p, x, readers)
    sign = 1 if right else -1
    start = x + sign * edge
    room = (p.width - start if right else start) - 10
    label = clipped(text, min(LABEL_MAX, max(int(room / CHAR_PX), 4)))
    quiet = " quiet" if readers is None else ""
    words = (
        f'<text class="value{quiet}" text-anchor="{"start" if right else "end"}" '
        f'x="{start + sign * 7:g}" y="{y - 5:g}">{escape(label)}</text>'
    )
    if not readers:
        end = start + sign * 34
        shape = (
            f'<path class="wire stopped" d="M{start:g} {y:g}H{end:g}M{end:g} {y - 3:g}V{y + 3:g}"/>'
            if readers is None
            else f'<path class="wire {role}" d="M{start:g} {y:g}H{end:g}"/>'
            f'<circle class="end {role}" cx="{end + sign * 3:g}" cy="{y:g}" r="3"/>'
        )
        return shape + words
    left_end = min(readers[0], x)
    right_end = max(readers[-1], x)
    heads = "".join(_arrow_head(place, y, rightwards=place > x) for place in readers)
    return (
        f'<path class="wire {role}" d="M{left_end:g} {y:g}H{right_end:g}"/>'
        f'<path class="head {role}" d="{heads}"/>{words}'
    )


def _arrow_head(x: float, y: float, *, rightwards: bool) -> str:
    back = x - 8 if rightwards else x + 8
    return f"M{x:g} {y:g}L{back:g} {y - 4:g}V{y + 4:g}Z"


def _box(p: DrawingPlan, step: SequenceStep, x: float, y: float, role: str) -> tuple[str, float]:
    """Draw the step itself, a box with a word or two or a dot; return half its width as well."""
    text, kind = _box_word(step)
    gated = " gated" if step.gated else ""
    if not text:
        ring = _ring(step, x, y, DOT_PX, DOT_PX)
        return f'{ring}<circle class="dot {role}{gated}" cx="{x:g}" cy="{y:g}" r="{DOT_PX}"/>', 6.0
    text = clipped(text, int((p.lane_px - 24) / CHAR_PX))
    half = (display_width(text) * CHAR_PX + 16) / 2
    shape = (
        f'<rect class="box {role} {kind}{gated}" x="{x - half:g}" y="{y - BOX_PX / 2:g}" '
        f'width="{2 * half:g}" height="{BOX_PX}" rx="4"/>'
        f'<text class="{kind}" text-anchor="middle" x="{x:g}" y="{y + 4:g}">{escape(text)}</text>'
    )
    return _ring(step, x, y, half, BOX_PX / 2) + shape, half


def _box_word(step: SequenceStep) -> tuple[str, str]:
    """Return the word in the box, and its kind."""
    if step.fault is not None:
        return "fault", "fault"
    if step.switch is not None:
        kind = "takeover" if step.switch.after == "SC" else "giveback"
        return f"{step.switch.before} {ARROW} {step.switch.after}", kind
    other = any(not pick.default for pick in step.choices)
    values = ", ".join(visible(pick.value) for pick in step.choices)
    picked = f"{MARKS['other' if other else 'default']} {values}" if step.choices else ""
    word = KINDS[step.kind]
    if step.kind == "effect" and step.lasts_ns:
        word = f"effect +{duration_text(step.lasts_ns)}"
    return f"{word} {picked}".strip(), "chosen" if other else "plain"


def _ring(step: SequenceStep, x: float, y: float, half: float, high: float) -> str:
    """Return the ring around the step that violates the property."""
    if not step.violates:
        return ""
    return (
        f'<rect class="ring" x="{x - half - RING_PX:g}" y="{y - high - RING_PX:g}" '
        f'width="{2 * (half + RING_PX):g}" height="{2 * (high + RING_PX):g}" rx="8"/>'
    )


def _cross(x: float, y: float, r: float, kind: str) -> str:
    return (
        f'<path class="{kind}" d="M{x - r:g} {y - r:g}L{x + r:g} {y + r:g}'
        f'M{x + r:g} {y - r:g}L{x - r:g} {y + r:g}"/>'
    )


def head_groups(lanes: Sequence[Lane]) -> list[tuple[str | None, int]]:
    """Return the headings above the lanes: a module (None: none) and its adjacent lanes' number."""
    groups: list[tuple[str | None, int]] = []
    for lane in lanes:
        if groups and groups[-1][0] == lane.module:
            groups[-1] = (lane.module, groups[-1][1] + 1)
        else:
            groups.append((lane.module, 1))
    return groups
