"""The appendix's figure: phase plane, sets, one drive without and one with the module.

Purpose: `python examples/mountain_car/figure.py` proves the module and draws what it found: K (the
paper's phi_safe), S_0 (where ttf is false), the set in which AC may return, and two runs of the
bang-bang driver from the same start, coloured by who had control.
Non-goals: statistics (bench/running/mountain_car.py).
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import plotly.graph_objects as go

import soter

if TYPE_CHECKING:
    from numpy.typing import NDArray

PROGRAM = Path(__file__).with_name("cliff.soter")
OUTPUT = Path(".soter") / "mountain_car.html"
BLUE, GREEN, GREY, PURPLE = "#1f5fbf", "#1a7f4b", "#8a8f98", "#7b2fb5"
REGIONS = (
    ("#d5d8dc", "outside K: the cliff, or not shown to be safe"),
    ("#f8d3a6", "K: SC keeps the car from the cliff for ever"),
    ("#f7efb5", "S<sub>0</sub>: no controller at all leaves K within Δ: AC may stay"),
    ("#d8ecd4", "φ<sub>safer</sub>: AC may return"),
)
"""Outermost first; each lies inside the one before."""


def depth_of(sets: list[NDArray[np.bool_]]) -> NDArray[np.int64]:
    """For every cell in how many of the nested sets it lies."""
    return np.sum(sets, axis=0)


def regions(depth: NDArray[np.int64], edges: list[NDArray[np.float64]]) -> go.Heatmap:
    """The nested sets as one map of flat colours."""
    n = len(REGIONS)
    scale = [[k / n + d / n, REGIONS[k][0]] for k in range(n) for d in (0, 1)]
    middles = [(e[:-1] + e[1:]) / 2.0 for e in edges]
    return go.Heatmap(
        x=np.round(middles[0], 5),
        y=np.round(middles[1], 6),
        z=depth.T.astype(np.uint8),
        zmin=-0.5,
        zmax=n - 0.5,
        colorscale=scale,
        showscale=False,
        hovertemplate="x %{x:.3f}, v %{y:.4f}<extra></extra>",
    )


def swatches() -> list[go.Scatter]:
    """One entry of the legend for each region."""
    return [
        go.Scatter(
            x=[None],
            y=[None],
            mode="markers",
            name=text,
            marker={"size": 13, "symbol": "square", "color": colour, "line": {"width": 1}},
        )
        for colour, text in REGIONS
    ]


def drive(program: soter.Program, system: str, seed: int) -> dict[str, Any]:
    """x, v and who had control (1: AC), until the flag or the cliff."""
    run = program.simulate(system=system, seed=seed)
    car, mode = run.truth("car"), run.mode("SafeCar").astype(bool)
    over = (car["x"] <= program.constant("CLIFF")) | (car["x"] >= program.constant("GOAL"))
    end = int(np.argmax(over)) + 1 if over.any() else len(over)
    return {"x": car["x"][:end], "v": car["v"][:end], "ac": mode[:end]}


def path(run: dict[str, Any], keep: NDArray[np.bool_], **style: Any) -> go.Scatter:  # noqa: ANN401
    """The steps that begin where `keep` says, with gaps between."""
    x, v = run["x"].copy(), run["v"].copy()
    drawn = keep.copy()
    drawn[1:] |= keep[:-1]
    x[~drawn], v[~drawn] = np.nan, np.nan
    return go.Scatter(x=x, y=v, mode="lines", **style)


def switches(run: dict[str, Any]) -> go.Scatter:
    """Where control changed hands."""
    at = np.flatnonzero(run["ac"][1:] != run["ac"][:-1]) + 1
    words = ["AC → SC" if not run["ac"][i] else "SC → AC" for i in at]
    return go.Scatter(
        x=run["x"][at],
        y=run["v"][at],
        mode="markers",
        name="switch",
        text=words,
        hovertemplate="%{text}<extra></extra>",
        marker={"size": 9, "color": PURPLE, "line": {"width": 1.5, "color": "white"}},
    )


def draw(
    program: soter.Program, depth: NDArray[np.int64], edges: list[NDArray[np.float64]], seed: int
) -> go.Figure:
    """The whole figure."""
    alone, safe = (drive(program, s, seed) for s in ("AdvancedOnly", "Protected"))
    everywhere = np.ones(len(alone["x"]), dtype=bool)
    figure = go.Figure([regions(depth, edges), *swatches()])
    figure.add_trace(
        path(
            alone,
            everywhere,
            name="AC alone: over the cliff",
            line={"color": GREY, "width": 2, "dash": "dot"},
        )
    )
    for keep, name, colour in (
        (safe["ac"], "protected, AC in control", BLUE),
        (~safe["ac"], "protected, SC in control", GREEN),
    ):
        figure.add_trace(path(safe, keep, name=name, line={"color": colour, "width": 3}))
    figure.add_trace(switches(safe))
    _marks(figure, program, safe, alone)
    _axes(figure, edges)
    return figure


def _marks(
    figure: go.Figure, program: soter.Program, safe: dict[str, Any], alone: dict[str, Any]
) -> None:
    cliff, goal = program.constant("CLIFF"), program.constant("GOAL")
    figure.add_vline(x=cliff, line={"color": "#a02020", "width": 3})
    figure.add_vline(x=goal, line={"color": GREEN, "width": 1.5, "dash": "dash"})
    figure.add_trace(
        go.Scatter(
            x=[safe["x"][0], alone["x"][-1]],
            y=[safe["v"][0], alone["v"][-1]],
            mode="markers+text",
            text=["start", "falls"],
            textposition=["bottom center", "bottom right"],
            marker={"size": 10, "color": ["#222222", "#a02020"], "symbol": ["circle", "x"]},
            showlegend=False,
            hoverinfo="skip",
        )
    )
    for x, text, side in ((cliff, "cliff", "left"), (goal, "flag", "left")):
        figure.add_annotation(
            x=x, y=1, yref="paper", text=text, showarrow=False, xanchor=side, xshift=4, yshift=10
        )


def _axes(figure: go.Figure, edges: list[NDArray[np.float64]]) -> None:
    figure.update_layout(
        title="A mountain car that no driver can push over the cliff",
        template="plotly_white",
        font={"family": "system-ui, sans-serif", "size": 14},
        width=1100,
        height=640,
        margin={"l": 70, "r": 20, "t": 80, "b": 150},
        legend={"orientation": "h", "y": -0.13, "x": 0, "traceorder": "normal"},
    )
    figure.update_xaxes(
        title="position x", range=[edges[0][0] - 0.06, edges[0][-1]], showgrid=False, zeroline=False
    )
    figure.update_yaxes(
        title="speed v, per step", range=[edges[1][0], edges[1][-1]], showgrid=False, zeroline=False
    )


def main() -> None:
    """Prove, drive, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-o", "--output", type=Path, default=OUTPUT)
    given = parser.parse_args()
    program = soter.load(PROGRAM)
    result = program.verify().modules[0]
    group = result.cases[0].groups[0]
    edges = [np.array(e) for e in group.edges]
    sets = [group.core != 0, group.levels[0], group.levels[-1]]
    given.output.parent.mkdir(parents=True, exist_ok=True)
    figure = draw(program, depth_of(sets), edges, given.seed)
    figure.write_html(given.output, config={"displayModeBar": False})
    shares = ", ".join(f"{100 * s.mean():.1f} %" for s in sets)
    print(f"{result.name}: {result.verdict}; K, S_0 and safer are {shares} of the plane")
    print(f"wrote {given.output}")


if __name__ == "__main__":
    main()
