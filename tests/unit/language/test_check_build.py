"""The whole static half in one call: order, systems, what is said when nothing can run."""

from __future__ import annotations

import pytest

from soter.diagnostics.diagnostic import Severity, SoterError
from soter.diagnostics.render import render
from soter.language.front_end import CheckResult, check_file, system_of
from soter.language.model.types import show_ns, write_ns

PLANT = """
topic pos: float;
input topic force: float in [-1.0, 1.0];
param GAIN: float = 1.0 in [0.0, 5.0];
plant Cart period 10ms { reads force; drives pos = x; state x: float; der x = GAIN * force; }
"""


def check(text: str) -> CheckResult:
    return check_file("test.soter", "soter 1;\n" + text)


def codes(text: str) -> list[str]:
    return [d.code for d in check(text).diagnostics.items]


DESIGN_4 = """soter 1;
input topic localPosition: float in [-9.0, 9.0];
topic control: float in [-1.0, 1.0];
node MotionPrimitive period 10ms {
  subscribes localPosition;
  publishes control;
  step { publish control = clamp(localPosition, -1.0, 1.0); }
}
node MotionPrimitiveSC period 150ms {
  publishes control;
  step { publish control = 0.0; }
}
rta SafeMotionPrimitive {
  ac MotionPrimitive;
  period 100ms;
  safe localPosition < 9.0;
  sc MotionPrimitiveSC;
}
"""

DESIGN_4_SAYS = """\
error[P1a]: `MotionPrimitiveSC` is slower than its decision module
  --> drone.soter:17:6
15 |   period 100ms;
   |          ----- the decision module samples every 100 ms
...
17 |   sc MotionPrimitiveSC;
   |      ^^^^^^^^^^^^^^^^^ steps every 150 ms
   = note: a switch could come too late: P1a needs period(SC) <= Δ
   = help: set the node's period to 100ms or less, or raise Δ to 150ms"""


def test_the_example_of_the_design_reads_as_it_does_there() -> None:
    (diagnostic,) = check_file("drone.soter", DESIGN_4).diagnostics.items
    assert render(diagnostic) == DESIGN_4_SAYS


def test_diagnostics_come_in_the_order_of_the_text() -> None:
    text = "const A: int = 1.5;\nnode N period 0ms { step { } }\n"
    text += "const B: int = 2.5;\nconst C: int = B;"
    items = check(text).diagnostics.items
    assert [d.code for d in items] == ["T001", "C001", "T001"]
    assert [d.primary.span.line for d in items if d.primary] == [2, 3, 4]


def test_warnings_about_absence_are_not_given_beside_errors() -> None:
    assert codes(PLANT + "const A: float = 1.0;\nsystem S { c: Cart; }") == ["W001"]
    assert codes(PLANT + "const A: float = 1;\nsystem S { c: Cart; until 0s; }") == ["C001"]


def test_other_warnings_are_given_beside_errors() -> None:
    text = PLANT + "system A { c: Cart; set GAIN = 2.0; }\nsystem B { a: A; until 0s; }"
    assert codes(text) == ["W006", "C001"]


def test_a_system_is_found_by_name_or_by_default() -> None:
    checked = check(PLANT + "system A { c: Cart; }\nsystem B default { d: Cart; }")
    assert system_of(checked, None).components[0].name == "d"
    assert system_of(checked, "A").components[0].name == "c"


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        (PLANT + "system A { c: Cart; }\nsystem B { d: Cart; }", None, "which system is meant?"),
        (PLANT + "system A { c: Cart; }", "C", "there is no system `C`"),
        ("fun f(): float { return 1.0; }", None, "the program declares nothing that could run"),
    ],
)
def test_no_system_to_run(text: str, name: str | None, said: str) -> None:
    checked = check(text)
    assert checked.ok
    with pytest.raises(SoterError) as caught:
        system_of(checked, name)
    (d,) = caught.value.diagnostics
    assert (d.code, d.message) == ("U002", said)


def test_a_program_with_errors_has_no_systems_to_run() -> None:
    with pytest.raises(SoterError) as caught:
        system_of(check("const A: int = 1.5;"), None)
    assert [d.code for d in caught.value.diagnostics] == ["T001"]


def test_a_file_without_systems_runs_everything_or_says_why_it_cannot() -> None:
    checked = check(
        "topic x: float;\nnode N period 10ms { subscribes x; step { assert x < 1.0; } }"
    )
    assert [d.code for d in checked.diagnostics.items] == ["M005"]
    assert not checked.ok
    with pytest.raises(SoterError) as caught:
        system_of(checked, None)
    assert [d.code for d in caught.value.diagnostics] == ["M005"]


def test_overrides_are_checked_like_settings() -> None:
    checked = check(PLANT + "system S { c: Cart; set GAIN = 2.0; }")
    assert system_of(checked, "S").params == {"GAIN": 2.0}
    assert system_of(checked, "S", {"GAIN": 3.0}).params == {"GAIN": 3.0}
    with pytest.raises(SoterError) as caught:
        system_of(checked, "S", {"GAIN": 9.0})
    (d,) = caught.value.diagnostics
    assert d.code == "V007"
    assert d.message == "parameter `GAIN` was set to 9.0, outside [0.0, 5.0]"


def test_p1a_follows_the_parameters() -> None:
    text = """
input topic x: float in [-9.0, 9.0];
topic u: float in [-1.0, 1.0];
param P: duration = 10ms;
node Ac period 10ms { subscribes x; publishes u; step { publish u = clamp(x, -1.0, 1.0); } }
node Sc period P { publishes u; step { publish u = 0.0; } }
rta M { ac Ac; sc Sc; period 20ms; safe x < 1.0; }
system S { module M; }
"""
    checked = check(text)
    assert checked.ok
    with pytest.raises(SoterError) as caught:
        system_of(checked, "S", {"P": 30_000_000})
    assert [d.code for d in caught.value.diagnostics] == ["P1a"]


def test_a_part_in_error_is_reported_once() -> None:
    text = PLANT.replace("input topic force", "topic force")
    text += "system A { c: Cart; }\nsystem B { a: A; }\nsystem C { a: B; b: B; }"
    items = check(text).diagnostics.items
    assert [d.code for d in items] == ["M005"]
    assert items[0].message == "plant `c` reads `force`, which nobody drives"


def test_warnings_are_warnings() -> None:
    checked = check("input topic x: bool;\nnode N period 1ms { subscribes x; step { } }")
    assert [d.severity for d in checked.diagnostics.items] == [Severity.WARNING]
    assert checked.ok


def test_an_order_of_declarations_means_nothing() -> None:
    parts = [
        "system Outer { a: Inner; always a.pos < 9.0 && a.c.truth.x < 9.0; until 1s; }",
        "system Inner default { c: Cart; until 1s; }",
        "plant Cart period TICK { drives pos = x; state x: float = START; der x = rate(x); }",
        "topic pos: float = START;",
        "fun rate(x: float): float { return START - x; }",
        "const START: float = 2.0 * HALF;",
        "const HALF: float = 0.5;",
        "param TICK: duration = 10ms;",
    ]
    for k in range(len(parts)):
        assert codes("\n".join(parts[k:] + parts[:k])) == []
        assert codes("\n".join(reversed(parts[k:] + parts[:k]))) == []


@pytest.mark.parametrize(
    ("ns", "shown"),
    [
        (0, "0 s"),
        (1, "1 ns"),
        (999, "999 ns"),
        (1500, "1.5 us"),
        (10_000_000, "10 ms"),
        (999_999_937, "999.999937 ms"),
        (1_000_000_000, "1 s"),
        (90_000_000_000, "90 s"),
        (3_600_000_000_000, "1 h"),
        (-20_000_000, "-20 ms"),
        (1_000_000_001, "1.000000001 s"),
    ],
)
def test_durations_are_shown_exactly(ns: int, shown: str) -> None:
    assert show_ns(ns) == shown
    assert write_ns(ns) == shown.replace(" ", "")
    if ns > 0:
        checked = check(f"const D: duration = {write_ns(ns)};")
        assert checked.program is not None
        assert checked.program.consts["D"].value == ns
