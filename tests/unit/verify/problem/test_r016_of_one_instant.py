"""What DM and SC read together may count as the proof takes it, or R016 says why it may not."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.certificate.reading.module_facts import DiffersError
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_to_prove
from soter.verify.problem.extract import extract
from tables import all_rows
from unit.certificate import small_proofs

if TYPE_CHECKING:
    from pathlib import Path

DIRECT = """soter 1;
topic pos: float in [-9.0, 9.0] max_age 60ms;
topic vel: float in [-9.0, 9.0] max_age 60ms;
topic u: float in [-1.0, 1.0];
plant P period 10ms {
  reads u; drives pos = x; drives vel = v;
  state x: float; state v: float;
  let w = x;
  der x = v; der v = u;
}
node Fast period 20ms { publishes u; step { publish u = 1.0; } }
node Slow period 20ms {
  subscribes pos, vel; publishes u;
  step { publish u = clamp(-pos - vel, -1.0, 1.0); }
}
rta M {
  ac Fast; sc Slow; period 20ms;
  safe abs(pos) < 8.0;
  ttf abs(pos) + abs(vel) > 3.0;
  safer abs(pos) + abs(vel) < 1.0;
  verify { grid pos in [-9.0, 9.0] / 90, vel in [-9.0, 9.0] / 90; }
}
system S { p: P; module M; }
"""
SILENT = ("verify {", "verify { dropout 30ms;")
WHEELS = """
topic raw: float in [-9.0, 9.0] max_age 60ms;
topic fast: float in [-9.0, 9.0] max_age 60ms;
plant Q period 10ms {
  reads u; drives raw = x; drives fast = v;
  state x: float; state v: float;
  der x = v; der v = u;
}
"""
FLYING = (
    ("node Fast", f"{WHEELS}node Fast"),
    ("verify {", "verify { abstracts q by p: P = { x: q.truth.x, v: q.truth.v };"),
    ("{ p: P; module M; }", "{ q: Q; NODES module M; }"),
)
RELAY = """node Relay period 10ms phase 1ms {
  subscribes raw; publishes pos; step { publish pos = raw; }
}
node"""
OTHER = """node Other period 10ms phase 1ms {
  subscribes fast; publishes vel; step { publish vel = fast; }
}
node"""
BOTH = """node Both period 10ms phase 1ms {
  subscribes raw, fast; publishes pos, vel;
  step { publish pos = raw; publish vel = fast; }
}
node"""
DIRECTLY = ("drives fast = v;", "drives vel = v;")
STILL = "period 10ms { drives vel = w; state w: float in [-1.0, 1.0]; der w = -w; }"
TWO_PLANTS = (
    ("drives pos = x; drives vel = v;", "drives pos = x;"),
    (
        "state x: float; state v: float;\n  let w = x;\n  der x = v; der v = u;",
        "state x: float; der x = u;",
    ),
    ("{ x: q.truth.x, v: q.truth.v }", "{ x: q.truth.x }"),
    ("node Fast", f"plant W {STILL}\nplant R {STILL}\nnode Fast"),
    ("drives raw = x; drives fast = v;", "drives pos = x;"),
    ("plant R period 10ms", "plant R period 20ms"),
    ("verify { abstracts q", "verify { abstracts r by w: W = { w: r.truth.w }; abstracts q"),
    ("{ q: Q; NODES", "{ q: Q; r: R;"),
)
DM_OF_ONE = (
    ("ttf abs(pos) + abs(vel) > 3.0", "ttf abs(pos) > 3.0"),
    ("safer abs(pos) + abs(vel) < 1.0", "safer abs(pos) < 1.0"),
)
TWICE = (
    ("topic u:", "topic sum: float max_age 60ms;\ntopic u:"),
    ("drives vel = v;", "drives vel = v; drives sum = v + w;"),
    ("subscribes pos, vel;", "subscribes pos, vel, sum;"),
    ("-pos - vel,", "-pos - vel - sum,"),
)
RECORD = """
topic raw: float in [-9.0, 9.0] max_age 60ms;
topic old: float in [-9.0, 9.0] max_age 60ms;
topic both: { a: float, b: float } in { a in [-9.0, 9.0], b in [-9.0, 9.0] } max_age 60ms;
plant Q period 10ms {
  reads u; drives pos = x; drives vel = v; drives raw = x;
  state x: float; state v: float;
  der x = v; der v = u;
}
node Relay period 10ms phase 1ms { subscribes raw; publishes old; step { publish old = raw; } }
node Made period 10ms phase 2ms {
  subscribes raw, old; publishes both; step { publish both = { a: raw, b: old }; }
}
"""
MADE_OF_TWO = (
    ("node Fast", f"{RECORD}node Fast"),
    *FLYING[1:],
    ("NODES", "node Relay; node Made;"),
    ("drives vel = v;", "drives vel = v; drives both = { a: x, b: SECOND };"),
    ("subscribes pos, vel;", "subscribes both;"),
    ("-pos - vel,", "-both.a - both.b,"),
)
TWO_WAYS = (  # one topic of a sensor, which SC reads as it is and by a node
    *FLYING,
    DIRECTLY,
    ("node", OTHER.replace("fast", "pos").replace("vel", "sum")),
    ("NODES", "node Other;"),
    *DM_OF_ONE,
    ("drives raw = x;", "drives pos = x;"),
    *TWICE[:2],
    ("subscribes pos, vel;", "subscribes pos, sum;"),
    ("-pos - vel,", "-pos - sum,"),
)

CASES: dict[str, tuple[str, tuple[tuple[str, str], ...]]] = {
    "two topics of a plant": ("", ()),
    "which may fall silent: each has an age of its own": ("", (SILENT,)),
    "a state in both": ("", TWICE),
    "a state in both, which may fall silent": ("SC", (*TWICE, SILENT)),
    "one by a node": (
        "the DM",
        (*FLYING, DIRECTLY, ("node", RELAY), ("NODES", "node Relay;")),
    ),
    "one by a node, the other not read by the DM": (
        "",
        (*FLYING, DIRECTLY, ("node", RELAY), ("NODES", "node Relay;"), *DM_OF_ONE),
    ),
    "by two plants with periods of their own": ("the DM", (*FLYING, *TWO_PLANTS)),
    "each by a node of its own": (
        "the DM",
        (*FLYING, ("node", RELAY), ("node", OTHER), ("NODES", "node Relay; node Other;")),
    ),
    "one topic made of two reads": ("", (*MADE_OF_TWO, ("SECOND", "v"))),
    "one topic made of two reads, a state in both of its numbers": (
        "SC",
        (*MADE_OF_TWO, ("SECOND", "x")),
    ),
    "and by way of a `let`": ("SC", (*MADE_OF_TWO, ("SECOND", "w"))),
    "one topic in two ways": ("SC", TWO_WAYS),
    "one topic in two ways, which may fall silent": ("SC", (*TWO_WAYS, SILENT)),
    "both by one node": ("", (*FLYING, ("node", BOTH), ("NODES", "node Both;"))),
    "both by one node, may fall silent": (
        "the DM",
        (*FLYING, ("node", BOTH), ("NODES", "node Both;"), SILENT),
    ),
}


def text_of(pairs: tuple[tuple[str, str], ...]) -> str:
    text = DIRECT
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


@all_rows("name", CASES)
def test_reads_of_several_instants_are_refused_where_nothing_would_tell(name: str) -> None:
    who, pairs = CASES[name]
    checked = check_file("test.soter", text_of(pairs))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_to_prove(checked, "S")
    if not who:
        extract(flat, flat.modules[0])
        return
    with pytest.raises(SoterError) as raised:
        extract(flat, flat.modules[0])
    assert [(d.code, d.message.split(" reads")[0]) for d in raised.value.diagnostics] == [
        ("R016", f"what {who}")
    ]


@all_rows("name", CASES)
def test_the_re_checker_refuses_the_same_by_itself(name: str, tmp_path: Path) -> None:
    who, pairs = CASES[name]
    path = tmp_path / "small.soter"
    path.write_text(text_of(pairs))
    if not who:
        small_proofs.facts_of(path, "S", "M")
        return
    with pytest.raises(DiffersError, match=f"what {who} reads"):
        small_proofs.facts_of(path, "S", "M")
