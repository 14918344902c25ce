"""Fly the surveillance program and keep what a report shows of it.

Purpose: from a run of the whole stack to the records of the HTML report: the flight on the map, the
three modules, the battery, the plans in force and those turned down, the landings. `Watch` sees
the run while it goes on: a trace of ten minutes would take 2 GB.
Non-goals: one lap with its tubes (`flights.py`), many flights (`bench/drone/stack.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from city_scene import Scene
from city_view import CityView
from flights import CREDIT, City, array
from patrol import REASONS

import soter
from soter.report.run.record import (
    Cell,
    Chart,
    Comparison,
    Decision,
    Flight,
    ModeBand,
    ReportPage,
    Series,
    Threshold,
    Violation,
    Way,
)
from soter.simulate.result_assumptions import run_assumptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.simulate.result import Run

HERE = Path(__file__).resolve().parent
STACK, HOSTILE = HERE / "surveillance.soter", HERE / "surveillance_adversaries.soter"
PLANNER, MOTION = "SafePlanner", "SafeMotionPrimitive"
STEP_NS = 50_000_000
"""A state in ten is kept."""
NOTE = (
    "Dotted: each plan that came into force, from where it was asked for, through the aims of its "
    "boxes. Dashed and red: candidates of RRT* that the planner's DM turned down. There are no "
    "tubes: the boxes in force change with every plan."
)


@dataclass(frozen=True)
class Judged:
    """A plan of which something was decided at `time_s`; `points` (k, 3) in m."""

    time_s: float
    number: int
    points: NDArray[np.float64]
    why: str = ""


class Watch:
    """Sees every state of a run, as a log does, and keeps little: `log=Watch(program)`."""

    problem = None

    def __init__(self, program: soter.Program) -> None:
        self.program = program
        self.adopted: list[Judged] = []
        self.turned_down: list[Judged] = []
        self._kept: list[dict[str, NDArray[Any]]] = []
        self._last: NDArray[Any] | None = None

    def begin(self, system: Any, *_: object) -> None:  # noqa: ANN401 - what a log is told
        """Find the topics by their own names, whatever file the system stands in."""
        self._topic = {t.name.rsplit(".", 1)[-1]: t.name for t in system.topics}
        self._planner = next(m.index for m in system.modules if m.name.endswith(PLANNER))

    def see(self, states: NDArray[Any], _changes: Sequence[object]) -> None:
        """The next states, (n,)."""
        rows = states if self._last is None else np.concatenate([self._last, states])
        self._last = states[-1:].copy()
        force = rows["topics"][self._topic["inForce"]]
        for i in np.flatnonzero(np.diff(force["adopted"].astype(np.int64))) + 1:
            self.adopted.append(self._plan_in_force(rows[i]))
        mode = rows["modules"]["mode"][:, self._planner].astype(np.int64)
        for i in np.flatnonzero(np.diff(mode) < 0) + 1:
            self.turned_down += self._candidate(rows[i - 1], rows[i])
        self._kept.append(self._sampled(states[states["header"]["ct"] % STEP_NS == 0]))

    def end(self, run: Run | None, why: str) -> None:
        """Nothing is to be closed."""

    def end_by(self, error: BaseException) -> None:
        """Nothing is to be kept."""

    def column(self, name: str) -> NDArray[Any]:
        """What was sampled, (n,) or (n, 3)."""
        return np.concatenate([part[name] for part in self._kept])

    def _sampled(self, s: NDArray[Any]) -> dict[str, NDArray[Any]]:
        topics = s["topics"]
        force, landing = topics[self._topic["inForce"]], topics[self._topic["landing"]]
        return {
            "time_s": s["header"]["ct"] / 1e9,
            "p": array(s["d"]["p"]),
            "v": array(s["d"]["v"]),
            "modes": s["modules"]["mode"] == 1,
            "charge": s["b"]["charge"].copy(),
            "docked": s["b"]["docked"] == 1,
            "margin": topics[self._topic["margin"]].copy(),
            "landing": landing["active"] == 1,
            "left": landing["left"].copy(),
            "waited": topics[self._topic["waited"]].copy(),
            "adopted": force["adopted"].copy(),
            "refused": force["refused"].copy(),
        }

    def _plan_in_force(self, row: Any) -> Judged:  # noqa: ANN401 - a state
        force = row["topics"][self._topic["inForce"]]
        request = row["topics"][self._topic["request"]]
        blocks = force["corridor"]["blocks"]
        aims = array(blocks["items"]["aim"][: int(blocks["len"])])
        points = np.concatenate([array(request["start"])[np.newaxis], aims])
        return Judged(float(row["header"]["ct"]) / 1e9, int(force["number"]), points)

    def _candidate(self, before: Any, row: Any) -> list[Judged]:  # noqa: ANN401 - two states
        """The plan for which the planner's DM took over, if it was for the plan."""
        if row["modules"][self._planner]["saw_gate_fault"]:
            return []
        plan = before["topics"][self._topic["candidate"]]
        request = before["topics"][self._topic["request"]]
        points = array(plan["items"][: int(plan["len"])])
        why = self._verdict(points, request)
        time_s = float(row["header"]["ct"]) / 1e9
        return [Judged(time_s, int(request["number"]), points, why)] if why else []

    def _verdict(self, points: NDArray[np.float64], request: Any) -> str:  # noqa: ANN401
        """Why a plan (k, 3) does not count for a request, in the program's words; "" if it does."""
        if not np.isfinite(points).all():
            return "NotFinite"
        ends = [_vector(array(request[end])) for end in ("start", "goal")]
        cover = self.program.function("cover.CoverFor")([_vector(p) for p in points], *ends)
        if cover.verdict != "Covered":
            return str(cover.verdict)
        length = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        return "TooLong" if length > float(request["longest"]) else ""


def _vector(p: NDArray[np.float64]) -> dict[str, float]:
    return dict(zip("xyz", map(float, p), strict=True))


@dataclass(frozen=True)
class Mission:
    """A flight of the whole stack: what the report shows, and what was counted on board."""

    program: soter.Program
    run: Run
    watch: Watch
    title: str

    @property
    def last(self) -> dict[str, Any]:
        """The last value of each topic, by its own name."""
        topics = self.run.final["topics"]
        return {n.rsplit(".", 1)[-1]: topics[n] for n in topics.dtype.names}

    @property
    def city(self) -> City:
        """Where it flew."""
        return City(self.program)

    def flight(self) -> Flight:
        """The map's record; in control is who flies, AC or SC of the motion primitive."""
        w, motion = self.watch, self.run.modules[MOTION]
        position = w.column("p")
        clearance = self.city.clearance(position)
        speed = np.linalg.norm(w.column("v"), axis=1)
        summary: dict[str, float | int | str] = {
            "violations": self.run.violations,
            "ac_share": motion.ac_share,
            "switches_to_sc": motion.switches_to_sc,
            "min_clearance_m": float(clearance.min()),
            "flown_m": round(self.flown_m()),
            "plans_in_force": len(w.adopted),
            "plans_turned_down": len(w.turned_down),
        }
        return Flight(
            self.run.system.name,
            self.title,
            w.column("time_s"),
            position,
            self._mode(MOTION),
            MOTION,
            clearance,
            speed,
            self.decisions(MOTION),
            tuple(
                Violation(v.time_s, v.what) for v in self.run.violation_list if v.time_s is not None
            ),
            summary,
            tuple(self._ways()),
        )

    def chart(self) -> Chart:
        """The three modules, the battery, landings and plans over time."""
        book = self.last["landings"]
        summary: dict[str, float | int | str] = {
            "violations": self.run.violations,
            "landings": int(book["number"]),
            "landings_by_the_DM": int(book["forced"]),
            "landings_too_late": int(book["late"]),
            "plans_refused_on_board": self.refused(),
        }
        if book["number"]:
            summary["least_charge_at_touch-down"] = f"{100 * float(book['least']):.1f} %"
            summary["time_left_then_s"] = float(book["left"])
        names = [m.name for m in self.run.system.modules]
        return Chart(
            name=self.run.system.name,
            title=f"{self.title}: three modules",
            time_s=self.watch.column("time_s"),
            series=tuple(self._series()),
            modes=tuple(ModeBand(n, self._mode(n)) for n in names),
            decisions=tuple(d for n in names if n != MOTION for d in self.decisions(n)),
            summary=summary,
        )

    def flown_m(self) -> float:
        """The length of its way in m."""
        speed = np.linalg.norm(self.watch.column("v"), axis=1)
        return float(speed.mean()) * self.run.duration_s

    def decisions(self, module: str) -> tuple[Decision, ...]:
        """What a module's DM decided; of the planner's, what it had against the plan."""
        against = {p.time_s: f"`{p.why}`: no plan for the request" for p in self.watch.turned_down}
        changes = [d for d in self.run.decisions if d.module == module]
        reasons = [
            against.get(d.time_ns / 1e9, d.reason) if module == PLANNER else d.reason
            for d in changes
        ]
        return tuple(
            Decision(d.time_ns / 1e9, d.module, d.after, reason, d.saw.predicates())
            for d, reason in zip(changes, reasons, strict=True)
        )

    def docks(self) -> list[int]:
        """The docks that it rested in, by number."""
        docked = self.watch.column("p")[self.watch.column("docked")]
        docks = np.array([[d.x, d.y, d.z] for d in self.program.constant("docks.DOCK")])
        gaps = np.linalg.norm(docked[:, np.newaxis] - docks, axis=2)
        return sorted({int(i) for i in gaps.argmin(axis=1)})

    def _mode(self, module: str) -> NDArray[np.bool_]:
        index = next(m.index for m in self.run.system.modules if m.name == module)
        modes: NDArray[np.bool_] = self.watch.column("modes")[:, index]
        return modes

    def refused(self) -> str:
        """How many plans the follower refused, and why."""
        counts = self.last["landings"]["reasons"]
        why = [f"{int(n)} ({r})" for r, n in zip(REASONS, counts, strict=True) if n]
        return ", ".join(why) or "none"

    def _ways(self) -> list[Way]:
        ways = [
            Way(plan.points, f"plan {plan.number}, in force from {plan.time_s:.1f} s")
            for plan in self.watch.adopted
        ]
        return ways + [
            Way(plan.points, f"for request {plan.number} at {plan.time_s:.1f} s: {plan.why}", True)
            for plan in self.watch.turned_down
            if len(plan.points) > 1 and np.isfinite(plan.points).all()
        ]

    def _series(self) -> list[Series]:
        w, constant = self.watch, self.program.constant
        low = float(constant("battery.E") + constant("battery.SPENT") * constant("battery.TURN"))
        low += float(constant("battery.CELL"))
        full, time_s = float(constant("battery.FULL")), w.column("time_s")
        down = np.searchsorted([p.time_s for p in w.turned_down], time_s, side="right")
        return [
            Series("charge", "%", 100 * w.column("charge"), "charge"),
            Series(
                "margin",
                "%",
                100 * w.column("margin"),
                "margin: charge less what a landing may take",
                (
                    Threshold("ttf: below, the DM lands the drone", 100 * low),
                    Threshold("φ_safer: above, the mission goes on", 100 * full),
                ),
            ),
            Series(
                "left",
                "s",
                w.column("left"),
                "time that a landing still has",
                (Threshold("0: the landing is late", 0.0),),
            ),
            Series("height", "m", w.column("p")[:, 2], "height"),
            Series("in force", "", w.column("adopted").astype(float), "plans in force"),
            Series("turned down", "", down.astype(float), "plans in force"),
            Series("refused", "", w.column("refused").astype(float), "plans in force"),
        ]


def fly(
    file: Path, system: str, title: str, *, until_s: float, seed: int, charge: float = 1.0
) -> Mission:
    """One flight of a system of the stack, in a dock and charged so far when it starts."""
    program = soter.load(str(file))
    watch: Any = Watch(program)  # sees what a log does
    run = program.simulate(
        system,
        until=until_s,
        seed=seed,
        params={"battery.START_CHARGE": charge},
        trace=False,
        log=watch,
    )
    return Mission(program, run, watch, title)


def scene(missions: Sequence[Mission]) -> Scene:
    """The city with the places of the mission and the docks that were used."""
    city = missions[0].city
    constant = missions[0].program.constant
    prefix = "" if missions[0].program.path.endswith("surveillance.soter") else "stack."
    places = tuple((f"p{i + 1}", (p.x, p.y, p.z)) for i, p in enumerate(constant(f"{prefix}PLACE")))
    used = sorted({d for m in missions for d in m.docks()})
    docks = constant("docks.DOCK")
    names = tuple((f"dock {d + 1}", (docks[d].x, docks[d].y, docks[d].z)) for d in used)
    return Scene(
        (0.0, 0.0, 0.0),
        tuple(city.size),
        city.boxes,
        city.ceiling,
        (*places, *names),
        note=NOTE,
        credit=CREDIT,
    )


PAPER = {
    "flown": "104 h, 1,505 km",
    "violations": "34 crashes, SC not scheduled in time",
    "takeovers by SC, all modules": "109",
    "AC in control, motion primitive": "> 96 %",
}
"""Of the paper's stress test, all flights together."""


def quantities(mission: Mission) -> dict[str, str]:
    """The figures of one flight, as text."""
    run, book = mission.run, mission.last["landings"]
    text_by_quantity = {
        "flown": f"{run.duration_s:g} s, {mission.flown_m() / 1000:.2f} km",
        "violations": f"{run.violations}",
        "takeovers by SC, all modules": f"{sum(m.switches_to_sc for m in run.modules.values())}",
    }
    for name, text in (
        ("SafeBattery", "battery"),
        (PLANNER, "planner"),
        (MOTION, "motion primitive"),
    ):
        text_by_quantity[f"AC in control, {text}"] = f"{100 * run.modules[name].ac_share:.1f} %"
    text_by_quantity["plans in force"] = f"{len(mission.watch.adopted)}"
    text_by_quantity["plans turned down by the DM"] = f"{len(mission.watch.turned_down)}"
    text_by_quantity["plans refused on board"] = mission.refused()
    text_by_quantity["landings, of them by the DM"] = (
        f"{int(book['number'])}, {int(book['forced'])}"
    )
    if book["number"]:
        left = f"{100 * float(book['least']):.1f} %, {float(book['left']):.0f} s"
        text_by_quantity["least charge and time left at touch-down"] = left
    return text_by_quantity


def page(missions: Sequence[Mission], command: str) -> ReportPage:
    """The report of the flights."""
    flight_figures = [quantities(m) for m in missions]
    rows = {quantity: None for figures in flight_figures for quantity in figures}
    comparison = Comparison(
        tuple(m.title for m in missions),
        tuple(
            (
                q,
                tuple(
                    Cell(figures.get(q, "-"), "" if i else PAPER.get(q, ""))
                    for i, figures in enumerate(flight_figures)
                ),
            )
            for q in rows
        ),
        "The paper's figures are those of its stress test, all flights together, in another city "
        "and another simulator.",
    )
    broken = sum(m.run.violations for m in missions)
    forced = sum(int(m.last["landings"]["forced"]) for m in missions)
    turned_down = sum(len(m.watch.turned_down) for m in missions)
    hours = sum(m.run.duration_s for m in missions) / 60.0
    headline = (
        f"{broken or 'No'} violation{'s' if broken > 1 else ''} in {hours:.0f} minutes: "
        f"{turned_down} plans were turned down, {forced} landing{'s' if forced != 1 else ''} "
        "forced."
    )
    files = dict.fromkeys(Path(m.program.path).name for m in missions)
    notes = [note for m in missions for note in (*m.run.notes, *run_assumptions(m.run.system))]
    failures = [
        f"first failure of {n}: {why}" for m in missions for n, why in m.run.extern_failures.items()
    ]
    return ReportPage(
        "The surveillance drone: battery, planner and motion primitive, each behind its own DM",
        f"{', '.join(files)}: systems {', '.join(m.run.system.name for m in missions)}",
        headline,
        comparison,
        CityView(scene(missions)),
        tuple(m.flight() for m in missions),
        tuple(m.chart() for m in missions),
        tuple(dict.fromkeys([*failures, *notes])),
        {
            **{f"seed of {m.run.system.name}": str(m.run.seed) for m in missions},
            "program": str(missions[0].program.sha256),
            "soter": soter.__version__,
            "command": command,
        },
    )
