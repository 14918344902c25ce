"""The paper's Figures 5, 12a, 12b and 12c, flown by this project's programs.

    python examples/drone/figures.py 5|12a|12b|12c [-o FILE]

Purpose: each figure as one page: what ours shows, beside what the paper's shows in words, and the
numbers of the flights that were just flown; they are printed, too.
Non-goals: the paper's own pictures; statistics over many flights (bench/).
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mission
import numpy as np
from city_shapes import tube_outline
from flights import ARMS, PROGRAM, City, array, flight, read_lap, scene
from sketch import (
    BLUE,
    DANGER,
    DOTTED,
    GREEN,
    RED,
    SOLID,
    TOOK,
    Panel,
    buildings,
    decided,
    goals,
    shaded,
    two_tone,
    walled,
    where,
)

import soter
from soter.report.html import write_document
from soter.report.run.figure_parts import takeovers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from soter.report.run.record import Decision


HERE = Path(__file__).resolve().parent
EIGHT = HERE / "eight.soter"
FLIGHTS, LAPS = 20, 100
"""Of each kind: those drawn, or drawn from; those whose times are averaged."""
CLOSE_M = 0.8
"""A flight that never was farther from the loop follows it closely; walls are 1.5 m from it."""


@dataclass(frozen=True)
class Drawn:
    """A figure: its drawings, what the paper's shows, what ours shows, the numbers."""

    title: str
    drawings: tuple[str, ...]
    paper: str
    ours: str
    numbers: tuple[tuple[str, str, str], ...]
    """Quantity, ours, the paper's (may be empty)."""
    command: str


# ---------------------------------------------------------------- Figure 5


@dataclass(frozen=True)
class Round:
    """A flight along the figure eight: where it was, until it touched something."""

    path: NDArray[np.float64]
    pace: float
    off_m: float
    hit: bool
    ac_share: float

    @property
    def on_the_ground(self) -> bool:
        """Whether that was the ground."""
        return self.hit and bool(self.path[-1, 2] < 0.5)


def eight(
    program: soter.Program, system: str, seeds: Iterable[int], **params: float
) -> list[Round]:
    """Flights of a system of eight.soter."""
    rounds = []
    city = City(program)
    place = program.function("place")
    angles = np.linspace(0.0, 2.0 * np.pi, 720)
    curve = np.array([[p.x, p.y, p.z] for p in map(place, angles.tolist())])
    for seed in seeds:
        run = program.simulate(system, seed=seed, params=params)
        trace = run.require_trace()[::4]
        loop = trace["topics"]["loop"]
        path = array(trace["d"]["p"])[loop["active"] == 1]
        touched = np.flatnonzero(city.clearance(path) < 0.0)
        path = path[: touched[0] + 1] if len(touched) else path
        off = np.sqrt(((path[:, np.newaxis] - curve[::4]) ** 2).sum(axis=2)).min(axis=1)
        share = run.modules["SafeMotionPrimitive"].ac_share
        rounds.append(
            Round(path, float(loop["pace"][-1]), float(off.max()), bool(len(touched)), share)
        )
    return rounds


def figure_5() -> Drawn:
    """A learned controller on the eight, an autopilot from goal to goal, both alone."""
    program, laps = soter.load(str(EIGHT)), soter.load(str(PROGRAM))
    seeds = range(1, FLIGHTS + 1)
    alone, safe = (eight(program, s, seeds) for s in ("LearnedAlone", "LearnedProtected"))
    taught = eight(program, "Taught", seeds, FASTEST=program.constant("HASTE"))
    city = City(laps)
    left = walled(city, (17.4, 29.4), (17.4, 28.2), DANGER)
    right = walled(city, (10.4, 30.6), (16.4, 42.0), DANGER)
    for r in sorted(alone, key=lambda r: r.off_m):
        left.line(r.path, GREEN if r.off_m <= CLOSE_M else RED)
        if r.hit:
            left.cross(r.path[-1], "stroke:var(--violation)")
    hits = 0
    for seed in seeds:
        run = laps.simulate("AdvancedOnly", seed=seed)
        position = array(run.require_trace()["d"]["p"])[::4]
        touched = np.flatnonzero(city.clearance(position) < 0.0)
        hits += bool(len(touched))
        right.line(position[: touched[0] + 1] if len(touched) else position, BLUE)
        if len(touched):
            right.cross(position[touched[0]], "stroke:var(--violation)")
    goals(right, city)
    protected_hits = sum(laps.simulate("Protected", seed=s, trace=False).violations for s in seeds)
    near = [r for r in alone if r.off_m <= CLOSE_M]
    far = [r for r in alone if r.off_m > CLOSE_M]
    worst_m = max((r.off_m for r in far), default=0.0)
    hit = [r for r in alone if r.hit]
    grounded = sum(r.on_the_ground for r in hit)
    share = float(np.mean([r.ac_share for r in safe]))
    return Drawn(
        "Figure 5: third-party and learned controllers",
        (left.svg("flights along a figure eight"), right.svg("laps between the buildings")),
        "Left, a controller from data that was to follow a loop like an eight: in green the "
        "flights that follow it closely, in red those that dangerously deviate. Right, PX4's "
        "low-level controllers, sent from g1 to g4 again and again: in blue the flights; they "
        "overshoot at high speed and collide with obstacles, drawn red. No numbers are given; "
        "both serve for most of their missions.",
        "Left, a 10-16-3 network that imitates an autopilot (eight.soter, eight_train.py). It was"
        " taught on slow loops; each flight here draws a pace of its own, up to twice as fast. "
        "Right, the PX4-style autopilot with aggressive gains (motion_primitive.soter). Red: "
        "buildings and walls; crosses: collisions, where a line ends.",
        (
            ("flights along the eight, network alone", f"{len(alone)}", ""),
            (
                f"never more than {CLOSE_M:g} m off the loop (green)",
                f"{len(near)}, at {_span(r.pace for r in near)} rad/s",
                "",
            ),
            (
                "farther off (red)",
                f"{len(far)}, at {_span(r.pace for r in far)} rad/s, up to {worst_m:.1f} m",
                "",
            ),
            ("that collide, of them with the ground", f"{len(hit)}, {grounded}", "some"),
            (
                "its teacher at the same paces: farthest off, collisions",
                f"{max(r.off_m for r in taught):.1f} m, {sum(r.hit for r in taught)}",
                "",
            ),
            ("the same flights behind the module: collisions", f"{sum(r.hit for r in safe)}", ""),
            ("AC in control there", f"{100 * share:.1f} %", ""),
            ("laps of the autopilot alone that collide", f"{hits} of {FLIGHTS}", "some"),
            ("the same behind the module: violations", f"{protected_hits}", ""),
        ),
        "python examples/drone/figures.py 5",
    )


# ---------------------------------------------------------------- Figure 12a


def figure_12a() -> Drawn:
    """A lap with the regions of the motion primitive and what its DM did."""
    program = soter.load(str(PROGRAM))
    laps = {
        name: [read_lap(program.simulate(name, seed=s, trace=False)) for s in range(1, LAPS + 1)]
        for name in ARMS
    }
    most = max(laps["Protected"][:FLIGHTS], key=lambda lap: lap.switches_to_sc)
    flown = flight(program, "Protected", program.simulate("Protected", seed=most.seed))
    drawn = scene(program)
    panel = Panel((11.0, 30.2), (17.8, 40.4), width_px=640)
    regions = (
        ("fill:var(--safe-fill)", "half_width_m"),
        ("fill:var(--look-fill)", "look_ahead_half_width_m"),
        ("fill:var(--safer-fill)", "safer_half_width_m"),
    )
    for style, width in regions:
        outlines = [tube_outline(t, getattr(t, width)) for t in drawn.tubes]
        panel.union(outlines, f"{style};stroke:none")
    city = City(program)
    buildings(panel, city, SOLID)
    for tube in drawn.tubes:
        panel.line(np.array([tube.start, tube.end]), DOTTED)
    two_tone(panel, flown.position, flown.in_control)
    decided(panel, flown.decisions, flown.time_s, flown.position)
    goals(panel, city)
    seconds = {n: [x.lap_s for x in of if x.lap_s and not x.collided] for n, of in laps.items()}
    means = {n: float(np.mean(s)) for n, s in seconds.items()}
    share = float(np.mean([x.ac_share for x in laps["Protected"]]))
    hits = {n: sum(x.collided for x in of) for n, of in laps.items()}
    paper = {"AdvancedOnly": "10 s", "Protected": "14 s", "SafeOnly": "24 s"}
    return Drawn(
        "Figure 12a: an RTA-protected motion primitive",
        (panel.svg("a lap in its tubes, coloured by who is in control"),),
        "One lap in which SC takes control several times. The green tube inside the yellow one is"
        " φ_safer; red dots are where the DM switches to SC, green dots where it gives control "
        "back. From g1 to g4 it takes 10 s with AC alone, which may collide, 14 s protected, 24 s"
        " with SC alone.",
        f"The lap with the most takeovers of {FLIGHTS}, seed {most.seed}. Yellow: φ_safe; white: "
        "where whoever is in control keeps it; green: φ_safer, for a vehicle that hovers. "
        "Orange: AC flies; blue: SC. The aggressive set of gains.",
        (
            *(
                (f"g1 to g4, {ARMS[n]} ({LAPS} laps, clean ones)", f"{means[n]:.1f} s", paper[n])
                for n in ARMS
            ),
            *(
                (f"laps that collide, {ARMS[n]}", f"{hits[n]} of {LAPS}", p)
                for n, p in (("AdvancedOnly", "some"), ("Protected", "none"))
            ),
            ("AC in control, protected", f"{100 * share:.1f} %", "> 96 %, over 104 h of missions"),
            ("takeovers in the lap drawn", f"{most.switches_to_sc}", "several"),
        ),
        "python examples/drone/figures.py 12a",
    )


# ---------------------------------------------------------------- Figures 12b, 12c


def figure_12b() -> Drawn:
    """A stretch of the mission with its plans, and three places worth a look."""
    flown = mission.fly(mission.STACK, "Protected", "mission", until_s=240.0, seed=6)
    record = flown.flight()
    panel = walled(flown.city, (0.0, 50.0), (0.0, 50.0), SOLID, width_px=700)
    off = _off_plan(flown)
    for plan in flown.watch.adopted:
        panel.line(plan.points, DOTTED)
    two_tone(panel, record.position, record.in_control)
    took = [d for d in takeovers(record.decisions) if d.time_s > 1.0]
    named = _apart([where(record.time_s, record.position, d.time_s) for d in took])
    decided(panel, record.decisions, record.time_s, record.position)
    for k, p in enumerate(named[:2]):
        panel.text(p, f"N{k + 1}", up=10)
    free = np.where(record.in_control, off, 0.0)
    worst = int(np.argmax(free))
    panel.dot(record.position[worst], "fill:var(--ink)", 3.5)
    panel.text(record.position[worst], "N3", up=10)
    for name, p in mission.scene([flown]).goals:
        if name.startswith("p"):
            panel.dot(p, "fill:var(--ink)", 3.0)
            panel.text(p, name, up=-16)
    module = flown.run.modules[mission.MOTION]
    return Drawn(
        "Figure 12b: the motion primitive in a surveillance mission",
        (panel.svg("the mission in the city, with its plans"),),
        "The city from above. Dotted: one of the reference trajectories; solid: what was flown "
        "with the protected stack. At N1 and N2 SC takes control and pushes the drone back into "
        "φ_safer; at N3 the drone deviates from its reference and is still safe, so AC keeps "
        "control. AC is in control for most of the mission.",
        "240 s of surveillance.soter, system Protected, seed 6. Dotted: every plan that came into"
        " force, through the aims of its boxes. Red dots: the DM takes over (N1, N2: the first "
        "two places), rings: it gives back. N3: the farthest from the plan in force with AC in "
        "control.",
        (
            ("AC in control of the motion primitive", f"{100 * module.ac_share:.1f} %", "> 96 %"),
            ("takeovers", f"{len(took)}", "2 are drawn"),
            ("SC in control in all of them", f"{_in_sc(record.decisions):.2f} s", ""),
            ("off its plan at N3", f"{free[worst]:.1f} m", ""),
            ("least clearance", f"{record.clearance_m.min():.2f} m", ""),
            ("plans in force", f"{len(flown.watch.adopted)}", ""),
            ("violations", f"{flown.run.violations}", ""),
        ),
        "python examples/drone/figures.py 12b",
    )


def figure_12c() -> Drawn:
    """A mission that nobody charges: the battery's DM lands it."""
    flown = mission.fly(mission.HOSTILE, "Careless", "never charges", until_s=600.0, seed=1)
    w = flown.watch
    time_s, charge, margin = (w.column(n) for n in ("time_s", "charge", "margin"))
    position, docked = w.column("p"), w.column("docked")
    battery = w.column("modes")[:, 0]
    forced = next(
        d.time_s for d in flown.decisions("SafeBattery") if d.to == "SC" and d.time_s > 1.0
    )
    first = int(np.searchsorted(time_s, forced))
    last = first + int(np.argmax(docked[first:]))
    constant = flown.program.constant
    low = float(constant("battery.E") + constant("battery.SPENT") * constant("battery.TURN"))
    low += float(constant("battery.CELL"))
    put_by = float(constant("battery.LANDING"))
    over = Panel(
        (0.0, float(time_s[-1])),
        (0.0, 112.0),
        width_px=640,
        height_px=560,
        names=("time / s", "charge / %; dotted: margin"),
    )
    shaded(over, time_s, battery)
    every = slice(None, None, 20)
    over.line(np.column_stack([time_s, 100 * charge])[every], "stroke:var(--ink);stroke-width:2")
    over.line(np.column_stack([time_s, 100 * margin])[every], DOTTED)
    for level, words in (
        (100 * float(constant("battery.FULL")), "φ_safer of the margin"),
        (100 * low, "ttf of the margin"),
    ):
        over.line(np.array([[0.0, level], [time_s[-1], level]]), "stroke:var(--takeover)")
        over.text((4.0, level), words, anchor="start", up=4)
    over.dot((forced, 100 * charge[first]), TOOK)
    around = np.stack(
        [position[first - 200 : last + 1].min(axis=0), position[first - 200 : last + 1].max(axis=0)]
    )
    x, y = ((around[0, k] - 3.0, around[1, k] + 3.0) for k in (0, 1))
    down = walled(flown.city, x, y, SOLID, width_px=640)
    part = slice(first - 200, last + 1)
    two_tone(down, position[part], battery[part])
    down.dot(position[first], TOOK)
    down.dot(position[last], "fill:var(--ink)", 4.0)
    down.text(position[last], f"dock {flown.docks()[-1] + 1}")
    return Drawn(
        "Figure 12c: battery safety",
        (over.svg("charge and margin over time"), down.svg("the landing from above")),
        "A trajectory on which the charge falls below the safety threshold: the DM gives control "
        "to SC, which lands the drone. φ_safe is a charge above 0, φ_safer one above 85 %, and "
        "ttf holds where the charge less the most that 2Δ may cost is below what a landing takes "
        "at most.",
        "System Careless of surveillance_adversaries.soter: a mission that never charges. Left, "
        "the charge, and dotted what is left of it when a landing is taken off; blue ground: SC "
        "of SafeBattery. Right, the last 10 s of the mission, and the landing, from above.",
        (
            (
                "the DM takes over at",
                f"{forced:.1f} s, at {100 * charge[first]:.1f} % of charge",
                "",
            ),
            ("margin then", f"{100 * margin[first]:.1f} %", ""),
            (
                "in a dock after",
                f"{time_s[last] - forced:.1f} s of {put_by:g} s put by",
                "",
            ),
            ("charge at touch-down", f"{100 * charge[last]:.1f} %", "above 0"),
            ("charge at the end", f"{100 * charge[-1]:.1f} %", ""),
            ("violations", f"{flown.run.violations}", ""),
        ),
        "python examples/drone/figures.py 12c",
    )


# ---------------------------------------------------------------- what the figures measure


def _off_plan(flown: mission.Mission) -> NDArray[np.float64]:
    """Distance in m, (n,), from the plan that is in force."""
    time_s, p = flown.watch.column("time_s"), flown.watch.column("p")
    plans = flown.watch.adopted
    which = np.searchsorted([plan.time_s for plan in plans], time_s, side="right") - 1
    off = np.zeros(len(p))
    for k, plan in enumerate(plans):
        mine = which == k
        a, b = plan.points[:-1], plan.points[1:]
        along = np.einsum("nkj,kj->nk", p[mine, np.newaxis] - a, b - a)
        share = np.clip(along / np.maximum(((b - a) ** 2).sum(axis=1), 1e-12), 0.0, 1.0)
        foot = a + share[:, :, np.newaxis] * (b - a)
        off[mine] = np.linalg.norm(p[mine, np.newaxis] - foot, axis=2).min(axis=1)
    return off


def _in_sc(decisions: Iterable[Decision]) -> float:
    """For how long SC flew, s, from each takeover to the return that followed."""
    duration_s, since = 0.0, None
    for d in decisions:
        if d.to == "SC":
            since = d.time_s
        elif since is not None:
            duration_s, since = duration_s + d.time_s - since, None
    return duration_s


def _apart(places: list[Any]) -> list[Any]:
    """The first of the places, and each that is not within 2 m of an earlier one."""
    distinct_places: list[Any] = []
    for p in places:
        if all(np.linalg.norm(p - q) > 2.0 for q in distinct_places):
            distinct_places.append(p)
    return distinct_places


def _span(values: Iterable[float]) -> str:
    sorted_values = sorted(values)
    return f"{sorted_values[0]:.2f} to {sorted_values[-1]:.2f}" if sorted_values else "-"


# ---------------------------------------------------------------- the page


def main_text(drawn: Drawn) -> str:
    """The page's inside."""
    rows = "".join(
        f'<tr><th scope="row">{escape(what)}</th><td><strong>{escape(ours)}</strong></td>'
        f"<td>{escape(paper)}</td></tr>"
        for what, ours, paper in drawn.numbers
    )
    columns = "repeat(auto-fit, minmax(420px, 1fr))"
    pictures = "".join(f"<div>{drawing}</div>" for drawing in drawn.drawings)
    texts = (("The paper's", drawn.paper), ("Ours", drawn.ours))
    words = "".join(f"<div><h2>{head}</h2><p>{escape(text)}</p></div>" for head, text in texts)
    if len(drawn.drawings) == 1:  # both texts beside it, one above the other
        words = f'<div style="display:grid;gap:28px;align-content:start">{words}</div>'
    grid = f'style="display:grid;gap:28px 36px;grid-template-columns:{columns}"'
    return (
        f'<header class="top"><h1>{escape(drawn.title)}</h1></header>'
        f"<section {grid}>{pictures}{words}</section>"
        '<section><div class="scroll"><table class="comparison"><thead><tr><td></td>'
        '<th scope="col">ours</th><th scope="col">the paper\'s</th></tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
        f'<p class="note">Made by <code>{escape(drawn.command)}</code>, soter '
        f"{escape(soter.__version__)}. City: Drona project (MIT, 2016).</p></section>"
    )


FIGURES: dict[str, Callable[[], Drawn]] = {
    "5": figure_5,
    "12a": figure_12a,
    "12b": figure_12b,
    "12c": figure_12c,
}


def main() -> None:
    """Fly, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("figure", choices=FIGURES)
    parser.add_argument("-o", "--output", type=Path, help="default: .soter/figure-N.html")
    arguments = parser.parse_args()
    drawn = FIGURES[arguments.figure]()
    print(drawn.title)
    for what, ours, paper in drawn.numbers:
        print(f"  {what:58} {ours}" + (f"   (the paper: {paper})" if paper else ""))
    output = arguments.output or Path(".soter") / f"figure-{arguments.figure}.html"
    output.parent.mkdir(parents=True, exist_ok=True)
    write_document(drawn.title, main_text(drawn), output)
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
