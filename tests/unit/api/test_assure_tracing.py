"""Hazards, requirements and owners: what is covered, what is listed as open, what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from soter.api import load
from soter.api.assurance.certificate_check import OTHER_PROGRAM, CertifiedProof
from soter.api.assurance.evidence import OTHER_REPORT
from soter.api.assurance.hazard_traceability import Tracing, _owner_gaps
from soter.api.assurance.safety_case import _add_assumptions, check_compiled
from soter.certificate.reading.folder import Certificate
from soter.certificate.report import RecheckAssumption, RecheckedModule, Report
from soter.diagnostics.diagnostic import SoterError
from soter.report.safety_case import CaseNode, SafetyCase
from soter.report.safety_case_page import case_body
from tables import all_rows
from unit.certificate.tubes.test_forged_rest import held

if TYPE_CHECKING:
    from soter.language.model.system import System
    from soter.report.safety_case import Traceability

CART = Path(__file__).resolve().parents[3] / "examples" / "wall" / "cart.soter"
HEAD = "kind,id,text,traces_to,owner,validation,evidence\n"
CLEAR = "always Clear(c.truth)"


def test_what_does_not_fit_is_told_before_anything_takes_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reports and certificates of another program: minutes of tests and flights come after that."""
    report = {"program_sha256": "0" * 64, "tests": [{"name": "Quiet", "verdict": "exhausted"}]}
    (tmp_path / "tests.json").write_text(json.dumps(report))
    other = CertifiedProof("proof", why=OTHER_PROGRAM)
    monkeypatch.setattr(
        "soter.api.assurance.certificate_check._compared_certificate", lambda *_: other
    )

    def argued(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("soter.api.assurance.safety_case.add_argument", argued)
    told: list[str] = []
    how = {"cert": "proof", "test_report": tmp_path / "tests.json", "tell": told.append}
    with pytest.raises(KeyboardInterrupt):
        load(CART).assure(tmp_path / "out", system="Protected", **how)
    assert told == [OTHER_REPORT, OTHER_PROGRAM]


@pytest.fixture(scope="module")
def flat() -> System:
    return load(CART).declared("Protected")


def case_of(**status: bool) -> SafetyCase:
    """A case with a goal for each property of the cart; flights only where they are named."""
    case = SafetyCase("Safety case", "cart.soter", "ab" * 32, "Protected", {})
    top = case.add(CaseNode("G1", "goal", "top"))
    for name, id_ in (("safe", "G1.1"), ("P2b", "G4.1"), ("failsafe", "G5.1"), ("flights", "G3")):
        if name == "flights" and name not in status:
            continue
        goal = CaseNode(id_, "goal", name)
        goal.property = "" if name == "flights" else f"SafeCart.{name}"
        case.add(goal, under=top)
        leaf = CaseNode(f"Sn.{name}", "solution", "leaf", checked=status.get(name, True))
        case.add(leaf, under=goal)
    for k, key in enumerate(("world c", "scheme"), 1):
        case.add(CaseNode(f"A{k}", "assumption", f"text of {key}", key=key), beside=top)
    return case


def traced(folder: Path, flat: System, rows: str | None, case: SafetyCase) -> Traceability:
    path = folder / "hazards.csv"
    if rows is not None:
        path.write_text(HEAD + rows, encoding="utf-8")
    Tracing.read_tracing(None if rows is None else path, flat).enter_traces(case)
    return case.traceability


def refused(folder: Path, flat: System, text: str | bytes) -> list[str]:
    """The messages of a file, each with its line."""
    path = folder / "hazards.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(SoterError) as error:
        Tracing.read_tracing(path, flat).enter_traces(case_of())
    diagnostics = error.value.diagnostics
    assert {d.code for d in diagnostics} == {"D021"}
    return [f"{d.primary.span.line if d.primary else 0}: {d.message}" for d in diagnostics]


def test_a_hazard_rests_on_what_its_requirements_lead_to(tmp_path: Path, flat: System) -> None:
    rows = (
        "hazard,H1,strikes,R1,,,\nrequirement,R1,stays,R2; SafeCart.safe,,,\n"
        f"requirement,R2,returns,SafeCart.P2b; {CLEAR},,,\n"
    )
    trace = traced(tmp_path, flat, rows, case_of())
    assert [(i.id, i.status, i.properties) for i in trace.items] == [
        ("H1", "supported", ("SafeCart.P2b", CLEAR, "SafeCart.safe")),
        ("R1", "supported", ("SafeCart.P2b", CLEAR, "SafeCart.safe")),
        ("R2", "supported", ("SafeCart.P2b", CLEAR)),
    ]
    assert {p.name: p.hazards for p in trace.properties}[CLEAR] == ("H1",)
    assert trace.covered
    undone = traced(tmp_path, flat, rows, case_of(P2b=False))
    assert [i.status for i in undone.items] == ["open", "open", "open"]
    assert not undone.covered
    assert ("hazard", "H1", "undeveloped: `SafeCart.P2b`") in [
        (o.kind, o.id, o.why) for o in undone.open
    ]


@pytest.mark.parametrize(
    ("flights", "status", "why"),
    [
        (None, "not flown", "only flights are behind it, which are a sample"),
        (True, "sampled", "only flights are behind it, which are a sample"),
        (False, "undeveloped", f"undeveloped: `{CLEAR}`"),
    ],
)
def test_flights_close_no_hazard_but_one_that_violates_opens_it(
    tmp_path: Path, flat: System, flights: bool | None, status: str, why: str
) -> None:
    rows = f"hazard,H1,strikes,{CLEAR},,,\nhazard,H2,strikes,{CLEAR};SafeCart.safe,,,\n"
    case = case_of() if flights is None else case_of(flights=flights)
    trace = traced(tmp_path, flat, rows, case)
    assert {p.name: p.status for p in trace.properties}[CLEAR] == status
    assert [o.why for o in trace.open if o.id == "H1"] == [why]
    assert trace.items[1].status == ("open" if flights is False else "supported")


def test_without_a_file_everything_is_open(tmp_path: Path, flat: System) -> None:
    trace = traced(tmp_path, flat, None, case_of())
    unowned = "no owner, no way to validate it, no evidence"
    assert [(o.kind, o.id, o.why) for o in trace.open] == [
        ("property", "SafeCart.safe", "no hazard traces to it"),
        ("property", CLEAR, "no hazard traces to it"),
        ("assumption", "A1", unowned),
        ("assumption", "A2", unowned),
    ]
    assert (trace.items, trace.covered) == ((), True)


def test_what_a_file_leaves_out_is_listed(tmp_path: Path, flat: System) -> None:
    rows = (
        "hazard,H1,nothing,,,,\nrequirement,R1,nothing,,,,\n\n,,,,,,\n"
        "assumption,world c,,,plant,,report\nassumption,scheme,,,me,proof,paper\n"
    )
    case = case_of()
    trace = traced(tmp_path, flat, rows, case)
    assert [(o.kind, o.id, o.why) for o in trace.open] == [
        ("hazard", "H1", "it leads to no property"),
        ("requirement", "R1", "it leads to no property"),
        ("property", "SafeCart.safe", "no hazard traces to it"),
        ("property", CLEAR, "no hazard traces to it"),
        ("assumption", "A1", "no way to validate it"),
    ]
    assert (case.node("A2").owner, case.node("A2").evidence) == ("me", "paper")
    assert not trace.covered


def test_a_row_about_an_assumption_that_nobody_derived_stays_open(
    tmp_path: Path, flat: System
) -> None:
    case = SafetyCase("Safety case", "cart.soter", "ab" * 32, "Protected", {})
    trace = traced(tmp_path, flat, "assumption,world c,,,plant,x,y\n", case)
    (item,) = (o for o in trace.open if o.kind == "assumption")
    assert item.why == "not known whether it is one: no certificate was accepted"


@all_rows(
    ("text", "messages"),
    [
        ("", ["1: the first line has no column `kind`"]),
        ("kind;id;text\n", ["1: columns are separated by commas"]),
        ("id,text\n", ["1: the first line has no column `kind`"]),
        ("kind,id,owned\n", ["1: there is no column `owned`"]),
        ("kind,id,id\n", ["1: the column `id` stands twice"]),
        (HEAD + "hazard,H1,x\n", ["2: 3 cells, where the first line has 7"]),
        (HEAD + "hazrd,H1,x,,,,\n", ["2: there is no kind `hazrd`"]),
        (HEAD + "hazard,,x,,,,\n", ["2: this hazard has no id"]),
        (HEAD + "hazard,H1,,,,,\n", ["2: hazard `H1` has no `text`"]),
        (HEAD + "hazard,H1,x,,me,,\n", ["2: the column `owner` is not for a row of kind `hazard`"]),
        (
            HEAD + "assumption,scheme,x,,,,\n",
            ["2: the column `text` is not for a row of kind `assumption`"],
        ),
        (
            HEAD + 'hazard,H1,"x\ny",,,,\nrequirement,H1,x,,,,\n',
            ["4: the id `H1` stands twice"],
        ),
        (
            HEAD + "hazard,H1,x,SafeCart.saf,,,\n",
            ["2: `H1` traces to `SafeCart.saf`, which is no requirement and no property"],
        ),
        (
            HEAD + "hazard,H1,x,H2,,,\nhazard,H2,x,,,,\n",
            ["2: `H1` traces to `H2`, which is no requirement and no property"],
        ),
        (
            HEAD + "requirement,SafeCart.safe,x,,,,\n",
            ["2: `SafeCart.safe` is a property of the program"],
        ),
        (HEAD + "assumption,schem,,,,,\n", ["2: the case has no assumption `schem`"]),
        (HEAD + 'hazard,"H1,x,,,,\n', ["2: this is no CSV: unexpected end of data"]),
    ],
)  # fmt: skip
def test_bad_input_is_told_with_its_line(
    tmp_path: Path, flat: System, text: str, messages: list[str]
) -> None:
    assert refused(tmp_path, flat, text) == messages


def test_requirements_that_trace_in_a_circle_are_refused(tmp_path: Path, flat: System) -> None:
    rows = "requirement,R1,x,R2,,,\nrequirement,R2,x,R1; SafeCart.safe,,,\n"
    (message,) = refused(tmp_path, flat, HEAD + rows)
    assert "these rows trace to themselves: `R" in message


def test_what_is_no_text_is_refused_and_a_spreadsheets_mark_is_not(
    tmp_path: Path, flat: System
) -> None:
    assert refused(tmp_path, flat, b"kind,id\nhazard,\xff\n") == [
        f"0: `{tmp_path / 'hazards.csv'}` is not UTF-8: byte 16"
    ]
    path = tmp_path / "hazards.csv"
    path.write_bytes(b"\xef\xbb\xbf" + HEAD.replace("\n", "\r\n").encode() + b"hazard,H1,x,,,,\r\n")
    assert [r.id for r in Tracing.read_tracing(path, flat).file.rows] == ["H1"]  # type: ignore[union-attr]


def test_a_near_name_is_proposed(tmp_path: Path, flat: System) -> None:
    path = tmp_path / "hazards.csv"
    path.write_text(HEAD + "hazard,H1,x,SafeCart.saf,,,\n")
    with pytest.raises(SoterError) as error:
        Tracing.read_tracing(path, flat)
    assert error.value.diagnostics[0].helps == ("did you mean `SafeCart.safe`?",)


@all_rows(
    ("row", "now"),
    [
        ("disturbance c.w in [-0.1, 0.1]", "disturbance c.w in [-0.15, 0.15]"),
        ("error m.q[1] 1e-05", "error m.q[1] 0.02"),
        ("declared late dm 1 ms", "declared late dm 2.5 ms"),
    ],
)
def test_evidence_about_another_bound_is_asked_for_and_not_taken_over(
    tmp_path: Path, flat: System, row: str, now: str
) -> None:
    """Beside it stand an assumption about another index, and one that is spelled much alike."""
    case = case_of()
    for k, key in enumerate((now, "error m.q[0] 1e-05", "declared late sc 1 ms"), 3):
        case.add(CaseNode(f"A{k}", "assumption", key, key=key), beside=case.node("G1"))
    with pytest.raises(SoterError) as error:
        traced(tmp_path, flat, f'assumption,"{row}",,,plant,tape,report 7\n', case)
    (said,) = error.value.diagnostics
    assert said.helps == (f"it is `{now}` now: does the evidence hold of this number?",)


IDS = st.sampled_from(["R1", "R2", "R3", "R4"])
TARGETS = st.lists(
    st.sampled_from(["R1", "R2", "R3", "R4", "SafeCart.safe", "SafeCart.P2b"]), max_size=3
)


@given(targets=st.dictionaries(IDS, TARGETS, max_size=4), safe=st.booleans(), returns=st.booleans())
def test_supported_is_what_leads_to_supported_properties_only(
    tmp_path_factory: pytest.TempPathFactory,
    flat: System,
    targets: dict[str, list[str]],
    safe: bool,
    returns: bool,
) -> None:
    """Against the definition: every way from a row ends in a property that is supported."""
    rows = "".join(f"requirement,{i},x,{';'.join(t)},,,\n" for i, t in targets.items())
    folder = tmp_path_factory.mktemp("traced")
    case = case_of(safe=safe, P2b=returns)
    good = {"SafeCart.safe": safe, "SafeCart.P2b": returns}

    def below(id_: str, above: tuple[str, ...]) -> set[str] | None:
        """What a row leads to; None: round in a circle, or nowhere."""
        if id_ in good:
            return {id_}
        if id_ in above or id_ not in targets:
            return None
        parts = [below(t, (*above, id_)) for t in targets[id_]]
        return None if None in parts else {x for part in parts if part for x in part}

    reached = {i: below(i, ()) for i in targets}
    if None in reached.values():
        with pytest.raises(SoterError):
            traced(folder, flat, rows, case)
        return

    def supported(id_: str) -> bool:
        return (
            good[id_] if id_ in good else bool(targets[id_]) and all(map(supported, targets[id_]))
        )

    for item in traced(folder, flat, rows, case).items:
        properties = reached[item.id]
        assert properties is not None
        assert set(item.properties) == properties
        assert (item.status == "supported") == supported(item.id)


def test_a_hazard_is_open_where_one_of_its_requirements_is(tmp_path: Path, flat: System) -> None:
    rows = (
        "hazard,H1,strikes,R1; R2,,,\nrequirement,R1,stays,SafeCart.safe,,,\n"
        "requirement,R2,the brake's lamp is lit,,,,\n"
        f"hazard,H2,strikes,R1; R3,,,\nrequirement,R3,stays,{CLEAR},,,\n"
    )
    trace = traced(tmp_path, flat, rows, case_of(flights=True))
    status = {i.id: i.status for i in trace.items}
    assert status == {"H1": "open", "R1": "supported", "R2": "open", "H2": "open", "R3": "open"}
    why = {o.id: o.why for o in trace.open}
    assert (why["H1"], why["H2"]) == ("open: `R2`", "open: `R3`")


def test_ids_that_only_look_like_others_are_refused(tmp_path: Path, flat: System) -> None:
    rows = "hazard,H1,x,SafeCart.safe,,,\nhazard,H\N{ZERO WIDTH SPACE}1,x,,,,\n"
    assert refused(tmp_path, flat, HEAD + rows) == [
        "3: the id of this hazard has letters that nobody sees"
    ]


def test_a_hazard_with_the_id_of_a_goal_has_an_anchor_of_its_own(
    tmp_path: Path, flat: System
) -> None:
    case = case_of()
    traced(tmp_path, flat, "hazard,G1.1,strikes,SafeCart.safe,,,\n", case)
    page = case_body(case)
    anchors = re.findall(r'id="([^"]*)"', page)
    assert len(anchors) == len(set(anchors))
    assert '<a href="#row-G1.1">' in page


def test_a_dm_that_follows_sc_is_said_not_to_be_tried(tmp_path: Path) -> None:
    """A certificate of a module with `rest` has no tables from which to make its DM."""
    flat, entry = held()
    certificate = Certificate(tmp_path, {}, {}, set())
    said, why, differs = check_compiled(flat, flat.modules[0], [entry], certificate)
    assert (said, differs) == ("", False)
    assert why == "not tried: its predicates are no tables of cells"


def test_a_requirement_leads_to_conditions_that_runs_cover_or_that_are_named(
    tmp_path: Path,
) -> None:
    """R1 of the cart over its module; no row reaches AC, and that of the law reaches nothing."""
    hazards = CART.with_name("cart_hazards.csv")
    case = load(CART).assure(tmp_path, system="Protected", hazards=hazards, trace=True).case
    trace = case.conditions
    assert trace is not None
    of = {(x.function, x.condition): x for x in trace.conditions}
    ttf = of["cart_SafeCart_ttf", "room < 0.0"]
    assert ("R1", "SafeCart.safe") in ttf.reached_by
    assert (ttf.source, ttf.covered_by) == ("cart.soter:62", "run of Protected, seed 1")
    assert of["cart_switch", "stale"].covered_by == "check of the decision modules"
    assert of["cart_clamp_fn", "lo <= hi"].not_covered == "never false"
    assert all(bool(x.covered_by) != bool(x.not_covered) for x in trace.conditions)
    orphans = {x.function for x in trace.conditions if not x.reached_by}
    assert orphans == {"cart_publish_2", "cart_c_step", "cart_SafeCart_Fast_step"}
    assert trace.empty == (("H3", "SafeCart.failsafe"),)
    rows = (tmp_path / "trace.csv").read_text(encoding="utf-8").splitlines()
    assert rows[-1] == "H3,SafeCart.failsafe,,,,,,,,it reaches no condition"
    assert "not covered: never false" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_conditions_of_computed_predicates_say_that_their_check_is_not_counted(
    tmp_path: Path,
) -> None:
    """Goal G6 of the same case says that all facts were tried: the page says why both are true."""
    tank = """soter 1;
topic level: float max_age 100ms;
topic pump: float in [-0.1, 0.1] = 0.0;
plant Tank period 50ms { reads pump; drives level = h; state h: float = 1.0; der h = pump; }
node Fill period 100ms { subscribes level; publishes pump; step { publish pump = 0.1; } }
node Hold period 100ms {
  subscribes level;
  publishes pump;
  step { publish pump = clamp(0.5 * (1.0 - level), -0.1, 0.1); }
}
rta Guard {
  ac Fill;
  sc Hold;
  period 100ms;
  safe level > 0.2 && level < 1.8;
  verify { grid level in [0.2, 1.8] / 40; }
}
system Plant { t: Tank; module Guard; until 1s; }
"""
    (tmp_path / "tank.soter").write_text(tank)
    (tmp_path / "hazards.csv").write_text(HEAD + "hazard,H1,spills,Guard.safe,,,\n")
    how = {"hazards": tmp_path / "hazards.csv", "trace": True}
    trace = load(tmp_path / "tank.soter").assure(tmp_path / "case", **how).case.conditions
    assert trace is not None
    assert trace.ran[-1].endswith("computes its predicates: what goal G6 tries is not counted")
    stale = next(x for x in trace.conditions if x.condition == "stale")
    assert stale.not_covered == "never true"


# ---------------------------------------------------------------- lists that somebody else wrote


def nodes_of(stated: list[tuple[str, str]]) -> list[Any]:
    module = RecheckedModule("M", {})
    module.assumptions = [RecheckAssumption("error x 0.02", "errors stay within: x within 0.02")]
    report = Report(modules=[module], stated=[RecheckAssumption(*s) for s in stated])
    nodes: list[Any] = []
    case: Any = SimpleNamespace(add=lambda node, **_: nodes.append(node))
    _add_assumptions(case, None, [module], [], report)  # type: ignore[arg-type]
    return nodes


ROW: Any = SimpleNamespace(
    id="error x 0.01", owner="Ann", validation="bench", evidence="b.csv", span=None
)


@pytest.mark.parametrize("stated", [[], [("error x 0.01", "errors stay within: x within 0.01")]])
def test_an_owner_of_a_number_that_no_program_has_is_refused(stated: list[tuple[str, str]]) -> None:
    """The evidence is about 0.01, the program assumes 0.02: D021, whatever the manifest says."""
    with pytest.raises(SoterError):
        list(_owner_gaps(nodes_of(stated), [ROW]))


def test_a_stated_text_has_no_key_of_a_derived_one() -> None:
    nodes = nodes_of([("error x 0.02", "errors of x do not matter")])
    assert [n.text for n in nodes if n.key == "error x 0.02"] == [
        "errors stay within: x within 0.02"
    ]
