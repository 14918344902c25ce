"""Makes the page of a safety case: verdict, argument as a picture in the GSN, every goal.

Purpose: one HTML file without scripts for an assessor, in the order of an assessor's questions: is
the case supported, by which argument, assumptions and evidence, and what is not covered; what is
open, hazards and requirements, predicates in full, owners of assumptions; versions, hashes and
flags, on every printed page. In the picture goals are boxes, strategies parallelograms, solutions
circles, assumptions and contexts stand beside their goal; an undeveloped goal has the diamond. If a
case is too wide, the top picture goes down to the modules, and each module has a picture of its
own.
Non-goals: the case as data (`safety_case.py`).
"""

from __future__ import annotations

import re
import textwrap
from collections import Counter
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING

from soter.report.html import asset_text, write_document
from soter.report.safety_case import (
    MEANINGS,
    SUPPORTED,
    CaseNode,
    SafetyCase,
    TracedItem,
    TracedProperty,
)
from soter.report.templates import filled

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence
    from pathlib import Path


COLUMN, BOX, GAP, LINE, MARGIN = 138, 126, 44, 15, 8
LETTERS, LINES_MAX = 17, 6
PHONE_COLUMNS = 3
"""A node over more columns than these stands over the first one, so that a phone shows it."""
TOGETHER_MAX = 9
"""Most columns of goals in one picture."""
RADIUS, SIDE = 50, 54
LEGEND_LINE = 24
LEGEND = (
    ("goal", "goal"),
    ("strategy", "strategy"),
    ("solution", "solution: the evidence"),
    ("assumption", "assumptions"),
    ("context", "context"),
    ("supported", "supported \N{CHECK MARK}"),
    ("undeveloped", "undeveloped"),
    ("diamond", "undeveloped: nothing below"),
)
"""(shape, meaning) of all symbols; a picture's legend has those that it uses."""


@dataclass
class _Spot:
    """A node in a drawing (or several equal solutions), its position, and the spots below it."""

    nodes: list[CaseNode]
    x: float = 0.0
    """The horizontal middle, in columns."""
    y: float = 0.0
    below: list[_Spot] = field(default_factory=list)

    @property
    def node(self) -> CaseNode:
        return self.nodes[0]

    @property
    def lines(self) -> list[str]:
        """The lines of the node's text, cut to the space in its symbol."""
        lines = textwrap.wrap(self.node.text.replace("`", ""), LETTERS) or [""]
        if len(lines) > LINES_MAX:
            lines = [*lines[: LINES_MAX - 1], f"{lines[LINES_MAX - 1][: LETTERS - 1]}…"]
        return lines

    @property
    def height(self) -> float:
        if self.node.kind == "solution":
            return 2.0 * RADIUS
        return LINE * (len(self.lines) + 1) + 14.0


def argument_pictures(case: SafetyCase) -> list[tuple[str, str]]:
    """The drawings as (title, SVG): the top goal (title ""), parts too wide for it, other goals."""
    below = {i for n in case.nodes for i in n.supported_by}
    drawings: list[tuple[str, str]] = []
    for root in (n for n in case.goals if n.id not in below):
        spot = _spot_tree(case, root, None)
        title = "" if not drawings else root.id
        if _column_count(spot) <= TOGETHER_MAX:
            drawings.append((title, _picture_svg(case, spot)))
            continue
        parts = _goals_of_parts(case, root)
        drawings.append(
            (title, _picture_svg(case, _spot_tree(case, root, frozenset(p.id for p in parts))))
        )
        drawings += [(p.id, _picture_svg(case, _spot_tree(case, p, None))) for p in parts]
    return drawings


def _goals_of_parts(case: SafetyCase, root: CaseNode) -> list[CaseNode]:
    """The goals directly below the only strategy of the root, or directly below the root."""
    nodes = [case.node(i) for i in root.supported_by]
    if [n.kind for n in nodes] == ["strategy"]:
        nodes = [case.node(i) for i in nodes[0].supported_by]
    return nodes


def _spot_tree(case: SafetyCase, node: CaseNode, ends: frozenset[str] | None) -> _Spot:
    """The spot of a node and the tree below it; the tree stops at the nodes in `ends`."""
    spot = _Spot([node])
    if ends is not None and node.id in ends:
        return spot
    spot.below = [_spot_tree(case, case.node(i), ends) for i in node.supported_by]
    return spot


def _column_count(spot: _Spot) -> int:
    """How many columns the goals of a branch need."""
    goals = [s for s in spot.below if s.node.kind != "solution"]
    return max(sum(_column_count(s) for s in goals), len(spot.below) - len(goals), 1)


def _spot_rows(spot: _Spot) -> list[list[_Spot]]:
    """The spots by row; equal solutions are one spot, below everything that they support."""
    rows = [[spot]]
    while True:
        row: list[_Spot] = []
        same: dict[tuple[str, str, str, bool], _Spot] = {}
        for above in rows[-1]:
            for i, s in enumerate(above.below):
                n = s.node
                key = (n.text, n.path, n.sha256, n.checked)
                if n.kind == "solution" and key in same:
                    same[key].nodes.append(n)
                    above.below[i] = same[key]
                    continue
                if n.kind == "solution":
                    same[key] = s
                row.append(s)
        if not row:
            return rows
        rows.append(row)


def _place_columns(spot: _Spot, left: float) -> float:
    """Places goals in columns from `left` on and centres each parent; returns the right end."""
    goals = [s for s in spot.below if s.node.kind != "solution"]
    if not goals:
        spot.x = left + COLUMN * _column_count(spot) / 2
        return left + COLUMN * _column_count(spot)
    end = left
    for s in goals:
        end = _place_columns(s, end)
    spot.x = min((goals[0].x + goals[-1].x) / 2, left + PHONE_COLUMNS * COLUMN / 2)
    return end


def _picture_svg(case: SafetyCase, root: _Spot) -> str:
    beside = _nodes_beside(case, root.node)
    width = max(_place_columns(root, 0.0), 3.0 * COLUMN)
    root_x = root.x
    if beside:  # assumptions to the left of the top goal, contexts to its right
        short = max(1.5 * COLUMN - root_x, 1.5 * COLUMN - (width - root_x), 0.0)
        _move_branch(root, short)
        width += 2 * short
    rows = _spot_rows(root)
    y = _place_rows(rows)
    spots = [s for row in rows for s in row]
    parts = [line for s in spots for below in s.below for line in _arrow_svg(s, below)]
    parts += [line for s in spots for line in _spot_svg(case, s)]
    parts += [
        line for k, (kind, ids) in enumerate(beside) for line in _boxes_svg(root, kind, ids, k)
    ]
    drawn = {part for s in spots for part in _legend_symbols(case, s.node)}
    lines = _legend_lines([*drawn, *(kind for kind, _ in beside)])
    parts += [
        f'<g transform="translate({MARGIN} {y - 10 + LEGEND_LINE * k:.0f})">{line}</g>'
        for k, line in enumerate(lines)
    ]
    width += 2 * MARGIN
    height = y + 6 + LEGEND_LINE * len(lines)
    name = escape(f"{root.node.id} {root.node.text}", quote=True)
    return (
        f'<svg class="gsn" xmlns="http://www.w3.org/2000/svg" viewBox="{-MARGIN} 0 {width:.0f} '
        f'{height:.0f}" width="{width:.0f}" height="{height:.0f}" role="img" aria-label="{name}">'
        + "".join(parts)
        + "</svg>"
    )


def _place_rows(rows: list[list[_Spot]]) -> float:
    """Places rows below one another, circles below what they support; gives the bottom's y."""
    above: dict[int, list[_Spot]] = {}
    for a in (a for row in rows for a in row):
        for b in dict.fromkeys(map(id, a.below)):
            above.setdefault(b, []).append(a)
    y = float(MARGIN)
    for row in rows:
        circles = [s for s in row if s.node.kind == "solution"]
        for s in row:
            s.y = y
        for s in circles:
            s.x = sum(a.x for a in above[id(s)]) / len(above[id(s)])
        _move_apart(circles)
        y += max(s.height for s in row) + GAP
    return y


def _move_branch(spot: _Spot, by: float) -> None:
    spot.x += by
    for s in spot.below:
        _move_branch(s, by)


def _move_apart(spots: Sequence[_Spot]) -> None:
    """Moves circles of a row apart, without changing their order, until none covers another."""
    least = RADIUS + 0.0
    for s in sorted(spots, key=lambda s: s.x):
        s.x = max(s.x, least)
        least = s.x + 2 * RADIUS + 12


def _nodes_beside(case: SafetyCase, node: CaseNode) -> list[tuple[str, list[str]]]:
    """The ids of the assumptions and of the contexts of a node, by kind."""
    near = [case.node(i) for i in node.in_context_of]
    kinds = ("assumption", "context")
    ids_by_kind = [(kind, [n.id for n in near if n.kind == kind]) for kind in kinds]
    return [(kind, ids) for kind, ids in ids_by_kind if ids]


# ---------------------------------------------------------------- shapes


def _spot_svg(case: SafetyCase, s: _Spot) -> Iterator[str]:
    n, status = s.node, case.status(s.node)
    left, top, high = s.x - BOX / 2, s.y, s.height
    yield f'<a href="#{escape(n.id, quote=True)}"><g class="{n.kind} {status}">'
    if n.kind == "solution":
        yield f'<circle cx="{s.x:.1f}" cy="{top + RADIUS:.1f}" r="{RADIUS}"/>'
        about = f"for {len(s.nodes)} goals" if len(s.nodes) > 1 else n.id
        words = textwrap.wrap(re.split("[,:]", n.text)[0].replace("`", ""), 13)
        words = [*words[:2], f"{words[2][:12]}…"] if len(words) > 3 else words
        hash_ = [n.sha256[:12]] if n.sha256 else []
        yield from _text_svg(
            s.x, top + RADIUS - 7 * (len(words) + len(hash_)), [about, *words, *hash_]
        )
    else:
        slant = 9 if n.kind == "strategy" else 0
        yield (
            f'<path d="M{left + slant:.1f} {top:.1f}H{left + BOX + slant:.1f}'
            f'L{left + BOX - slant:.1f} {top + high:.1f}H{left - slant:.1f}Z"/>'
        )
        sign = "\N{CHECK MARK}" if status == SUPPORTED else ""
        yield from _text_svg(s.x, top + 16, [f"{n.id} {sign}".strip(), *s.lines])
        if n.kind == "goal" and not n.supported_by:
            yield _diamond_svg(s.x, top + high)
    yield "</g></a>"


def _text_svg(x: float, y: float, lines: Sequence[str]) -> Iterator[str]:
    for i, line in enumerate(lines):
        kind = ' class="id"' if i == 0 else ""
        yield f'<text{kind} x="{x:.1f}" y="{y + LINE * i:.1f}">{escape(line)}</text>'


def _diamond_svg(x: float, y: float) -> str:
    return (
        f'<path class="diamond" d="M{x:.1f} {y:.1f}l8 9l-8 9l-8 -9Z">'
        "<title>undeveloped</title></path>"
    )


def _arrow_svg(above: _Spot, below: _Spot) -> Iterator[str]:
    x0, y0, x1, y1 = above.x, above.y + above.height, below.x, below.y
    half = (y1 - y0) / 2
    yield (
        f'<path class="wire" d="M{x0:.1f} {y0:.1f}C{x0:.1f} {y0 + half:.1f} {x1:.1f} '
        f'{y1 - half:.1f} {x1:.1f} {y1 - 7:.1f}"/>'
    )
    yield f'<path class="head" d="M{x1:.1f} {y1:.1f}l-4 -8h8Z"/>'


def _boxes_svg(root: _Spot, kind: str, ids: Sequence[str], at: int) -> Iterator[str]:
    """Yields the SVG of assumptions (left) or contexts (right), all of them in one box."""
    side = -1 if at == 0 and kind == "assumption" else 1
    x, y = root.x + side * 1.05 * COLUMN, root.y + root.height / 2
    edge, end = root.x + side * BOX / 2, x - side * SIDE
    count = f"{len(ids)} {kind}{'s' if len(ids) > 1 else ''}"
    span = ids[0] if len(ids) == 1 else f"{ids[0]}, …"
    yield f'<path class="wire" d="M{edge:.1f} {y:.1f}H{end - side * 8:.1f}"/>'
    yield f'<path class="head hollow" d="M{end:.1f} {y:.1f}l{-side * 8} -4v8Z"/>'
    radius = 22 if kind == "assumption" else 10
    yield f'<a href="#{kind}s"><g class="{kind}"><rect x="{x - SIDE:.1f}" y="{y - 22:.1f}" '
    yield f'width="{2 * SIDE}" height="44" rx="{radius}"/>'
    yield from _text_svg(x, y - 3, [span, count])
    yield "</g></a>"


def _legend_symbols(case: SafetyCase, node: CaseNode) -> tuple[str, ...]:
    """The symbols that the drawing of a node uses: its kind, its status, perhaps a diamond."""
    undeveloped = node.kind == "goal" and not node.supported_by
    return node.kind, case.status(node), *(("diamond",) if undeveloped else ())


def _legend_lines(drawn: Sequence[str]) -> list[str]:
    """The legend of the symbols that were drawn, in lines short enough for a phone."""
    shapes = {
        "goal": '<g class="goal"><path d="M0 0H26V14H0Z"/></g>',
        "strategy": '<g class="strategy"><path d="M4 0H30L26 14H0Z"/></g>',
        "solution": '<g class="solution"><circle cx="14" cy="7" r="8"/></g>',
        "assumption": '<g class="assumption"><rect width="26" height="14" rx="7"/></g>',
        "context": '<g class="context"><rect width="26" height="14" rx="4"/></g>',
        "supported": '<g class="supported"><path d="M0 0H26V14H0Z"/></g>',
        "undeveloped": '<g class="undeveloped"><path d="M0 0H26V14H0Z"/></g>',
        "diamond": '<g class="undeveloped">' + _diamond_svg(14, -2) + "</g>",
    }
    lines, x = [""], 0
    for kind, text in LEGEND:
        if kind not in drawn:
            continue
        long = 52 + 7 * len(text)
        if x and x + long > PHONE_COLUMNS * COLUMN:
            lines.append("")
            x = 0
        lines[-1] += (
            f'<g transform="translate({x} 0)">{shapes[kind]}'
            f'<text class="legend" x="36" y="12">{text}</text></g>'
        )
        x += long
    return lines


ON_EVERY_PAGE = ("Soter", "re-checker", "certificate", "C compiler")
"""Entries of `provenance` that every printed page shows, beside the program."""
KINDS = {
    "hazard": "Hazards",
    "requirement": "Requirements",
    "property": "Properties that no hazard traces to",
    "assumption": "Assumptions",
}
PLURALS = {kind: kind.replace("property", "propertie") + "s" for kind in KINDS}
HOW = {
    "proof": "by proof",
    "exploration": "by exploring its test",
    "flights": "by flights, a sample",
}


def write_case(case: SafetyCase, path: str | os.PathLike[str]) -> Path:
    """Writes the page to `path`; raises `SoterError` D006 if that is impossible."""
    return write_document(case.title, case_body(case), path)


def case_body(case: SafetyCase) -> str:
    """The HTML of the main part of the page."""
    text = [f"program SHA-256 {case.program_sha256}"]
    text += [f"{name} {case.provenance[name]}" for name in ON_EVERY_PAGE if name in case.provenance]
    open_goals = [g for g in case.goals if case.status(g) != SUPPORTED]
    below = {i for n in case.nodes for i in n.supported_by}
    count = Counter(item.kind for item in case.traceability.open)
    return filled(
        "report/safety_case_page.html.j2",
        case=case,
        css=asset_text("assurance.css"),
        facts=_page_facts(case),
        pictures=argument_pictures(case),
        open_goals=open_goals,
        beside=[g for g in open_goals if g is not case.goals[0] and g.id not in below],
        counted=[f"{n} {PLURALS[kind] if n > 1 else kind}" for kind, n in count.items()],
        near=lambda n: [case.node(i) for i in n.supported_by],
        open_items=_open_items(case),
        names={p.name for p in case.traceability.properties},
        traced=_traced_items(case),
        provided=lambda behind: _open_conditions(case, behind),
        how=HOW,
        evidence=_evidence_rows(case),
        meanings=MEANINGS,
        formula=_formula_html,
        identified=text,
    )


def _page_facts(case: SafetyCase) -> dict[str, str]:
    return {
        "program": case.program,
        "SHA-256": case.program_sha256,
        "system": case.system,
        "parameters": ", ".join(f"{n} = {v}" for n, v in case.params.items()) or "none",
        **case.provenance,
        "notation": "GSN Community Standard, version 3",
        "terms": "ASTM F3269-21; the last table says what they are called in the program",
    }


def _open_items(case: SafetyCase) -> list[tuple[str, int, dict[tuple[str, str], list[str]]]]:
    """For each kind of open item: the title, the number of items, and the ids by reason."""
    listed = []
    for kind, title in KINDS.items():
        mine = [item for item in case.traceability.open if item.kind == kind]
        ids_by_why: dict[tuple[str, str], list[str]] = {}
        for item in mine:
            ids_by_why.setdefault((kind, item.why), []).append(item.id)
        if mine:
            listed.append((title, len(mine), ids_by_why))
    return listed


def _traced_items(
    case: SafetyCase,
) -> list[tuple[str, list[tuple[TracedItem, list[TracedProperty]]]]]:
    """Hazards and requirements in the given order, each with the properties it traces to."""
    properties = {p.name: p for p in case.traceability.properties}
    sections = []
    for kind in ("hazard", "requirement"):
        if items := [i for i in case.traceability.items if i.kind == kind]:
            rows = [(i, [properties[name] for name in i.properties]) for i in items]
            sections.append((KINDS[kind], rows))
    return sections


def _open_conditions(case: SafetyCase, behind: Sequence[TracedProperty]) -> str:
    """The conditions under which a supported row holds: open assumptions, missing flights."""
    count = sum(item.kind == "assumption" for item in case.traceability.open)
    parts = [f"with {count} assumption{'s' if count > 1 else ''} open"] if count else []
    if any(p.status == "not flown" for p in behind):
        parts.append("flights are missing")
    return "; ".join(parts)


def _evidence_rows(case: SafetyCase) -> list[tuple[list[CaseNode], list[CaseNode]]]:
    """The rows of the evidence table: each piece of evidence once, with the goals it supports."""
    nodes_by_evidence: dict[tuple[str, str, str, str, bool], list[CaseNode]] = {}
    for n in case.nodes:
        if n.kind == "solution":
            nodes_by_evidence.setdefault((n.text, n.why, n.path, n.sha256, n.checked), []).append(n)
    return [
        (nodes, [g for g in case.nodes if any(m.id in g.supported_by for m in nodes)])
        for nodes in nodes_by_evidence.values()
    ]


def _formula_html(text: str) -> str:
    """A text as HTML in which no line breaks between a minus sign and its operand."""
    return re.sub(r"-\w", r'<span class="whole">\g<0></span>', escape(text))
