"""What a report draws beside a signal: limits, the truth with its estimate, units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import soter
from soter.language.evaluate.topic_ranges import signal_limits
from soter.language.front_end import check_file, system_of
from soter.report.run import signals
from soter.report.run.page import page_headline
from soter.simulate import run_report
from soter.simulate.run_report import report_page
from tables import all_rows

if TYPE_CHECKING:
    import pytest

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
PROGRAM = """soter 1;
type Motion = {{ x: float, v: float }};
const WALL: float = 10.0;
param HALF: float = 0.5;
input topic m: Motion;
input topic n: Motion;
input topic r: float[3];
const LAST: int = 2;
topic u: float in [-1.0, 1.0];
fun Inside(m: Motion): bool {{ return abs(m.x) < WALL; }}
fun Both(m: Motion): bool {{ return Inside(m) && m.v >= -2.0; }}
fun Long(m: Motion): bool {{ let far = m.x; return far < 1.0; }}
node A period 10ms {{ subscribes m; publishes u; step {{ publish u = 0.0; }} }}
node B period 10ms {{ subscribes m; publishes u; step {{ publish u = 0.5; }} }}
rta M {{ ac A; sc B; period 20ms; safe {safe}; ttf m.x > 1.0; safer m.x < 0.0; }}
"""


@all_rows(
    ("safe", "expected"),
    [
        ("Inside(m)", {("m.x", -10.0), ("m.x", 10.0)}),
        ("Both(m)", {("m.x", -10.0), ("m.x", 10.0), ("m.v", -2.0)}),
        ("m.x < WALL - HALF", {("m.x", 9.5)}),
        ("3.0 >= m.x", {("m.x", 3.0)}),
        ("-m.x < 4.0", {("m.x", -4.0)}),
        ("2.0 * m.x + 1.0 <= 5.0", {("m.x", 2.0)}),
        ("WALL - m.x > 1.0", {("m.x", 9.0)}),
        ("WALL - abs(m.x) > 1.0", {("m.x", -9.0), ("m.x", 9.0)}),
        ("abs(2.0 * m.x) < 6.0", {("m.x", -3.0), ("m.x", 3.0)}),
        ("abs(m.x) > 1.0", set()),  # no bound: what lies between is what is forbidden
        ("abs(m.x - 1.0) < 2.0", set()),
        ("m.x < 1.0 || m.v < 1.0", set()),
        ("m.x + m.v < 1.0", set()),
        ("m.x < n.x", set()),
        ("Long(m)", set()),
        ("m.x * 0.0 < 1.0", set()),
        ("abs(r[1]) < 2.0 && r[LAST] < 4.0", {("r[1]", -2.0), ("r[1]", 2.0), ("r[2]", 4.0)}),
        ("r[m.x > 0.0 ? 0 : 1] < 2.0", set()),
        ("true", set()),
    ],
)
def test_bounds_of_one_signal_are_read_off_safe(
    tmp_path: Path, safe: str, expected: set[tuple[str, float]]
) -> None:
    path = tmp_path / "p.soter"
    path.write_text(PROGRAM.format(safe=safe))
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics.items
    limits = signal_limits(system_of(checked, None))
    assert {(x.signal, x.value) for x in limits} == expected
    assert {x.by for x in limits} <= {"safe of M"}


def test_a_report_shows_truth_and_estimate_with_unit_and_limits_in_one_panel() -> None:
    run = soter.load(CART).simulate(until="5s")
    (chart,) = report_page(run, "cart", {}).charts
    panels: dict[str, list[str]] = {}
    for series in chart.series:
        panels.setdefault(series.panel, []).append(series.name)
    assert panels == {
        "c.x": ["c.x", "motion.x"],
        "c.v": ["c.v", "motion.v"],
        "accel": ["accel"],
        "goal": ["goal"],
    }
    of = {s.name: s for s in chart.series}
    assert {n: s.unit for n, s in of.items()} == {
        "c.x": "m", "motion.x": "m", "c.v": "m/s", "motion.v": "m/s", "accel": "m/s^2", "goal": "m",
    }  # fmt: skip
    assert {t.value: t.label for t in of["c.x"].thresholds} == {-10.0: "always", 10.0: "always"}
    assert {t.label for t in of["motion.x"].thresholds} == {"safe of SafeCart"}


ARM = """soter 1;
topic j: {{ q: float[{size}], w: float }};
topic u: float[2];
plant P period 10ms {{
  drives j = {{ q: q, w: w }};
  drives u = [w, 0.0];
  state q: float[{size}]; state w: float = 1.0;
  der q = {rates}; der w = -w;
}}
system S {{ p: P; until 1s; always abs(p.truth.q[1]) < 3.0; }}
"""


def test_elements_of_short_arrays_are_drawn_each_with_its_estimate_and_limits(
    tmp_path: Path,
) -> None:
    path = tmp_path / "p.soter"
    for size, drawn in ((2, True), (signals.ELEMENTS_MAX + 1, False)):
        path.write_text(ARM.format(size=size, rates=[1.0] * size))
        (chart,) = report_page(soter.load(path).simulate(), "", {}).charts
        panels: dict[str, list[str]] = {}
        for series in chart.series:
            panels.setdefault(series.panel, []).append(series.name)
        elements = {f"p.q[{i}]": [f"p.q[{i}]", f"j.q[{i}]"] for i in range(size) if drawn}
        assert panels == elements | {"p.w": ["p.w", "j.w", "u[0]"], "u": ["u[1]"]}
        limited = {s.name: {t.value for t in s.thresholds} for s in chart.series if s.thresholds}
        assert limited == ({"p.q[1]": {-3.0, 3.0}} if drawn else {})


def test_the_headline_of_a_run_claims_no_more_than_that_run(tmp_path: Path) -> None:
    path = tmp_path / "cart.soter"
    path.write_text(CART.read_text().replace("system Protected", "system Proved"))
    page = report_page(soter.load(path).simulate(until="1s"), "cart", {})
    assert page_headline(page) == ["System Proved: no violation in this run."]
    assert page.charts[0].title == "System Proved"


def test_signals_that_are_not_drawn_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    run = soter.load(CART).simulate(until="1s")
    assert not any("signals" in note for note in report_page(run, "cart", {}).notes)
    monkeypatch.setattr(run_report, "SERIES_MAX", 4)
    page = report_page(run, "cart", {})
    assert len(page.charts[0].series) == 4
    assert any(note.startswith("of 6 signals 4 are drawn over time") for note in page.notes)


def test_a_margin_that_is_drawn_is_explained() -> None:
    page = report_page(soter.load(CART.with_name("shield.soter")).simulate(until="1s"), "", {})
    assert page.charts[0].series[0].panel == "margin of Shielded"
    assert "margin of Shielded: for how long AC surely keeps control from then on" in page.notes


def test_a_unit_is_no_part_of_a_type(tmp_path: Path) -> None:
    path = tmp_path / "p.soter"
    path.write_text(
        'soter 1;\ntype A = { x: float unit "m" };\ntype B = { x: float unit "s" } ;\n'
        "const a: A = { x: 1.0 };\nconst b: B = a;\n"
        'input topic t: A[2] unit "km";\ninput topic v: int[3] unit "1";\n'
    )
    checked = check_file(str(path))
    assert checked.ok, checked.diagnostics.items
    assert checked.program is not None
    t, v = (checked.program.topics[n].type for n in ("t", "v"))
    assert t.element.fields[0][1].unit == "m"  # type: ignore[attr-defined]
    assert v.element.unit == "1"  # type: ignore[attr-defined]
