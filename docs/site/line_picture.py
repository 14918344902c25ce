"""Figures of each change as one picture: a panel a figure, a dot a line of line.jsonl.

Purpose: `drawn`, the text of docs/img/line.svg; the same lines give the same bytes.
Non-goals: measuring (bench/line.py), figures that are too many for a picture.
"""

from __future__ import annotations

import json
from html import escape
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parents[1]
LINES, PICTURE = DOCS / "benchmarks" / "line.jsonl", DOCS / "img" / "line.svg"
WIDTH, HEIGHT, LEFT, TOP = 360, 96, 12, 34
COLUMNS = 2
STYLE = (
    ".line{--ink:#1a1f24;--muted:#5b646d;--paper:#fcfcfa;--dot:#0a6ebd;"
    'font-family:system-ui,"Segoe UI",Roboto,Arial,sans-serif}'
    "@media(prefers-color-scheme:dark){.line{--ink:#eceef0;--muted:#a3acb4;--paper:#14171a;"
    "--dot:#5aaeee}}"
    ".line text{font-size:13px;fill:var(--ink)}.line .small{font-size:11px;fill:var(--muted)}"
    ".line .back{fill:var(--paper)}.line circle{fill:var(--dot)}"
    ".line polyline{fill:none;stroke:var(--dot);stroke-width:1.5}"
)
Lines = list[dict[str, Any]]


def read_lines() -> Lines:
    """All lines so far, the oldest first."""
    return [json.loads(x) for x in LINES.read_text(encoding="utf-8").splitlines()]


def changed_outputs(lines: Lines) -> list[float]:
    """Of how many examples a line has other hashes than the one before; of the first, none."""
    pairs = zip([lines[0], *lines], lines, strict=False)
    return [
        sum(now["outputs"][name] != before["outputs"].get(name) for name in now["outputs"])
        for before, now in pairs
    ]


def panels(lines: Lines) -> dict[str, list[float]]:
    """The figures that are drawn."""
    return {
        "lines in src": [sum(x["lines"].values()) for x in lines],
        "check of surveillance.soter / import numpy": [
            x["check_beside_numpy"]["surveillance.soter"] for x in lines
        ],
        "re-check / proof of brake.soter": [x["proof"]["recheck_beside_verify"] for x in lines],
        "slips: place and remedy right, %": [
            100 * x["slips"]["right"] / x["slips"]["all"] for x in lines
        ],
        "slips: misleading": [x["slips"]["misleading"] for x in lines],
        "escapes in 10 s of adversaries": [x["soundness"]["escapes"] for x in lines],
        "proof and re-check not accepted": [
            int(any((x["proof"]["verify"], x["proof"]["recheck"]))) for x in lines
        ],
        "examples of a dozen with other outputs": changed_outputs(lines),
    }


def panel(title: str, values: list[float], left: float, top: float) -> str:
    """One figure over all lines, from its least to its largest."""
    low, high = min(values), max(values)
    across = (WIDTH - 3 * LEFT) / max(len(values) - 1, 1)
    up = (HEIGHT - TOP - 20) / ((high - low) or 1)
    places = [
        (f"{left + LEFT + k * across:.1f}", f"{top + HEIGHT - 16 - (v - low) * up:.1f}")
        for k, v in enumerate(values)
    ]
    return (
        f'<text x="{left + LEFT}" y="{top + 16}">{escape(title)}: {values[-1]:,.5g}</text>'
        f'<text class="small" x="{left + LEFT}" y="{top + 29}">{low:,.5g} to {high:,.5g}</text>'
        f'<polyline points="{" ".join(",".join(p) for p in places)}"/>'
        + "".join(f'<circle cx="{x}" cy="{y}" r="2.5"/>' for x, y in places)
        + "\n"
    )


def drawn(lines: Lines) -> str:
    """The picture."""
    figures = panels(lines)
    rows = -(-len(figures) // COLUMNS)
    width, height = COLUMNS * WIDTH, rows * HEIGHT + 24
    parts = [
        panel(title, values, k % COLUMNS * WIDTH, k // COLUMNS * HEIGHT)
        for k, (title, values) in enumerate(figures.items())
    ]
    span = f"{len(lines)} lines, {lines[0]['made']} to {lines[-1]['made']}"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="line" viewBox="0 0 {width} {height}" '
        f'width="{width}" height="{height}" role="img" aria-label="Figures of each change">\n'
        f"<title>Figures of each change</title>\n<style>{STYLE}</style>\n"
        f'<rect class="back" width="{width}" height="{height}"/>\n{"".join(parts)}'
        f'<text class="small" x="{LEFT}" y="{height - 8}">{span}</text>\n</svg>\n'
    )
