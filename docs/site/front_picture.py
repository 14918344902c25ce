"""Draw docs/img/front.svg: one cart towards a wall, by AC alone and behind its module.

    .venv/bin/python docs/site/front_picture.py

Purpose: run both systems of examples/wall/cart.soter, and draw the place of the cart over time in
the colour of the controller in control.
Non-goals: other programs, pages (`soter run --report` writes them).
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import soter

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "img" / "front.svg"
WIDTH, HEIGHT, MARGIN, TOP, BOTTOM = 760, 224, 2, 6, 34
UNTIL_S, X_MIN, X_MAX, WALL, EVERY = 6.0, -0.5, 12.4, 10.0, 10
"""EVERY: of the instants of a run one in so many is drawn. Places in m."""
STYLE = (
    ".front{--ink:#1a1f24;--muted:#5b646d;--paper:#fcfcfa;--wall:#dfe3e6;--ac:#c65f00;--sc:#0a5fa5;"
    '--bad:#b3122d;font:19px system-ui,"Segoe UI",Roboto,"Noto Sans",Arial,sans-serif}'
    "@media(prefers-color-scheme:dark){.front{--ink:#e6e9ec;--muted:#9aa3ab;--paper:#14171a;"
    "--wall:#3d454c;--ac:#f2a65a;--sc:#6fb7f0;--bad:#ff8095}}"
    ".front text{fill:var(--ink)}.front .muted{fill:var(--muted)}.front .back{fill:var(--paper)}"
    ".front path{fill:none;stroke-width:3.5;stroke-linecap:round}"
    ".front .wall{fill:var(--wall)}.front .AC{stroke:var(--ac)}.front .SC{stroke:var(--sc)}"
    ".front .alone{stroke:var(--ac);stroke-dasharray:2 8}.front .hit{stroke:var(--bad)}"
    ".front .bad{fill:var(--bad);font-weight:600}.front .axis{stroke:var(--muted);stroke-width:1}"
)


def _place(t: float, x: float) -> tuple[float, float]:
    across = MARGIN + t / UNTIL_S * (WIDTH - 2 * MARGIN)
    return across, HEIGHT - BOTTOM - (x - X_MIN) / (X_MAX - X_MIN) * (HEIGHT - TOP - BOTTOM)


def _path(kind: str, places: list[tuple[float, float]]) -> str:
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in places)
    return f'<path class="{kind}" d="M{points}"/>'


def drawn() -> str:
    """The picture, from two runs of `UNTIL_S` s with seed 1."""
    program = soter.load(ROOT / "examples" / "wall" / "cart.soter")
    parts = []
    for system in ("Unprotected", "Protected"):
        run = program.simulate(until=f"{UNTIL_S:g}s", seed=1, system=system)
        end_s = run.violation_list[0].time_s if run.violations else None
        end_s = UNTIL_S if end_s is None else end_s
        shown = run.time_s() <= end_s
        t, x = run.time_s()[shown][::EVERY], run.truth("c")["x"][shown][::EVERY]
        places = [_place(*at) for at in zip(t, x, strict=True)]
        if run.violations:
            a, b = _place(end_s, WALL)
            parts.append(_path("alone", [*places, (a, b)]))
            parts += [_path("hit", [(a - 8, b - 8 * s), (a + 8, b + 8 * s)]) for s in (1, -1)]
            parts.append(
                f'<text class="bad" x="{a + 16:.0f}" y="{b - 9:.0f}">AC alone: into the wall after '
                f"{end_s:.1f} s</text>"
            )
            continue
        modes = run.mode("SafeCart")[shown][::EVERY]
        cuts = [k for k in range(len(modes)) if k == 0 or modes[k] != modes[k - 1]]
        parts += [
            _path("AC" if modes[k] else "SC", places[k : n + 1])
            for k, n in pairwise([*cuts, len(modes) - 1])
        ]
    (left, wall), (right, zero) = _place(0.0, WALL), _place(UNTIL_S, X_MIN)
    label = "The cart over time: AC alone hits the wall; behind its module SC brakes in time"
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" class="front" viewBox="0 0 {WIDTH} {HEIGHT}" '
        f'width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="{label}">\n'
        f"<title>{label}</title>\n<style>{STYLE}</style>\n"
        f'<rect class="back" width="{WIDTH}" height="{HEIGHT}"/>\n'
        f'<path class="wall" d="M{left},{TOP} H{right} V{wall:.1f} H{left} Z"/>\n'
        f'<path class="axis" d="M{left},{zero} {right},{zero}"/>\n' + "\n".join(parts) + "\n"
        f'<text class="muted" x="{left + 8}" y="{wall - 9:.0f}">wall</text>\n'
        f'<text class="muted" x="{right}" y="{HEIGHT - 9}" text-anchor="end">{UNTIL_S:g} s</text>\n'
        f'<text x="{left}" y="{HEIGHT - 9}">with Soter: <tspan fill="var(--ac)">AC drives</tspan>, '
        '<tspan fill="var(--sc)">SC brakes</tspan></text>\n</svg>\n'
    )


if __name__ == "__main__":
    PICTURE.write_text(drawn(), encoding="utf-8")
    sys.exit(0)
