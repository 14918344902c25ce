"""Several plans of SC: which one a DM writes down, and when, in both engines.

What is good for a plan is a topic here, so that every case can be said.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

from soter.codegen.unit import generate
from soter.core.layout import MODULE, state_dtype
from soter.core.steps import lower
from soter.language.front_end import check_file, system_of
from soter.language.model.tree_walk import joined, topic_reads
from soter.language.model.typed import TypedUnary
from soter.language.model.types import BOOL
from soter.semantics.configuration import AC, NEVER, SC
from soter.semantics.interpreter import Interpreter
from soter.semantics.rules import ac_or_sc_step, dm_step
from soter.verify.deploy.dm_check import CompiledDM
from soter.verify.deploy.dm_test_cases import ExpectedFacts

if TYPE_CHECKING:
    from soter.language.model.system import System

TEXT = """soter 1;
input topic up: bool max_age 50ms;
input topic down: bool max_age 50ms;
input topic one: int in [0, 1] = 1 max_age 50ms;
topic x: float in [-9.0, 9.0];
topic u: float in [-1.0, 1.0];
node Wild period 10ms { publishes u; step { publish u = 0.0; } }
node Up period 10ms { subscribes x; publishes u; step { publish u = 1.0; } }
node Down period 10ms { publishes u; step { publish u = -1.0; } }
rta M { ac Wild; sc Up, Down; period 10ms; safe x < 9.0; rest x < 1.0 within 1s; }
plant P period 10ms { reads u; drives x = p; state p: float = 0.0; der p = -p; }
system S default { p: P; module M; until 1s; always up && 1 / one > 0; always down; }
system Forced { p: P; module M; force M sc; until 1s; always up && 1 / one > 0; always down; }
"""
UP, DOWN, MS = 0, 1, 1_000_000


class Look(NamedTuple):
    """What a DM meets, and what comes of it: its mode, and the plan that SC follows then."""

    what: str
    mode: int
    plan: int
    up: bool
    down: bool
    after: int
    then: int
    one: int = 1
    age_ms: int = 0
    gate_fault: bool = False
    owed: int = 0
    system: str = "S"


LOOKS = [
    Look("the plan is good still", AC, UP, True, False, AC, UP),
    Look("another plan is good", AC, UP, False, True, AC, DOWN),
    Look("all are, so the last one stays", AC, DOWN, True, True, AC, DOWN),
    Look("none is", AC, DOWN, False, False, SC, DOWN),
    Look("another is good, after a gate fault", AC, UP, False, True, SC, UP, gate_fault=True),
    Look("another is good, and AC owes outputs", SC, UP, False, True, SC, UP, owed=1),
    Look("another is good on what is stale", AC, UP, False, True, SC, UP, age_ms=51),
    Look("another is good, and AC returns", SC, UP, False, True, AC, DOWN),
    Look("the check of the last one faults", AC, UP, True, True, AC, DOWN, one=0),
    Look("the check of one that is not needed faults", AC, DOWN, True, True, AC, DOWN, one=0),
    Look("a check faults, and no other is good", AC, UP, True, False, SC, UP, one=0),
    Look("another is good, and SC is forced", SC, UP, False, True, SC, UP, system="Forced"),
]  # fmt: skip


@lru_cache
def decided(name: str) -> System:
    """The system, with checks that are its properties."""
    system = system_of(check_file("plans.soter", TEXT), name)
    (module,) = system.modules
    goods = tuple(p.condition for p in system.properties)
    safer = joined("||", goods, module.symbol.span)
    ttf = TypedUnary(BOOL, safer.span, "!", safer)
    topics = {t.symbol: t.index for t in system.topics}
    read = tuple(topic_reads(safer))
    module.scope.topics.update({t: topics[t] for t in read})
    module.symbol = replace(module.symbol, ttf=ttf, safer=safer, topics_read=read)
    module.goods, module.computed = goods, True
    module.inputs = tuple(topics[t] for t in read)
    return system


def topics_of(system: System, look: Look) -> tuple[Any, ...]:
    said = {"up": look.up, "down": look.down, "one": look.one, "M.plan": look.plan}
    return tuple(said.get(t.name, t.default) for t in system.topics)


@pytest.mark.parametrize("look", LOOKS, ids=lambda x: x.what)
def test_the_interpreter_writes_a_plan_with_a_verdict_ac_alone(look: Look) -> None:
    system = decided(look.system)
    it, (module,) = Interpreter(system), system.modules
    now = 1000 * MS
    c = it.initial()
    locals_ = tuple(look.mode if i == module.dm else x for i, x in enumerate(c.L))
    c = replace(
        c,
        ct=now,
        FN=(module.dm,),
        L=locals_,
        Topics=topics_of(system, look),
        stamps=(now - look.age_ms * MS,) * len(system.topics),
        gate_fault=(look.gate_fault,),
        clean_needed=(look.owed,),
    )
    c, verdict = dm_step(it.machine, c, module.dm)
    assert (verdict.after, c.Topics[module.plan or 0]) == (look.after, look.then)


@pytest.mark.parametrize("look", [x for x in LOOKS if x.system == "S"], ids=lambda x: x.what)
def test_the_compiled_dm_writes_a_plan_with_a_verdict_ac_alone(look: Look) -> None:
    system = decided(look.system)
    (module,) = system.modules
    unit = generate(system, lower(system))
    c = CompiledDM(unit)
    state = ExpectedFacts(system, module).state_bytes(unit, topics_of(system, look))
    now, layout = 1000 * MS, unit.layout
    struct.pack_into("<q", state, 0, now)
    for i in range(len(system.topics)):
        struct.pack_into("<q", state, layout.stamp_offset + 8 * i, now - look.age_ms * MS)
    fields = state_dtype(layout)["modules"].base.fields
    assert fields is not None
    at = {
        n: layout.module_offset + module.index * MODULE.size + int(w[1]) for n, w in fields.items()
    }
    state[at["mode"]], state[at["gate_fault"]] = look.mode, look.gate_fault
    struct.pack_into("<I", state, at["clean_needed"], look.owed)
    after = c.decide(module.index, state)
    (then,) = struct.unpack_from("<q", state, layout.topic_offset(module.plan or 0))
    assert (after, then) == (look.after, look.then)


@pytest.mark.parametrize(("plan", "command"), [(UP, 1.0), (DOWN, -1.0)])
def test_sc_does_what_its_plan_does(plan: int, command: float) -> None:
    system = decided("S")
    it, (module,) = Interpreter(system), system.modules
    c = replace(it.initial(), ct=0, FN=(module.sc,))
    c = replace(c, Topics=tuple(plan if i == module.plan else x for i, x in enumerate(c.Topics)))
    c, outcome = ac_or_sc_step(it.machine, c, module.sc)
    assert outcome.published == {module.outputs[0]: command}
    assert c.stamps[module.outputs[0]] > NEVER


def test_the_first_plan_is_what_a_run_begins_with() -> None:
    system = decided("S")
    (module,) = system.modules
    assert system.topics[module.plan or 0].default == UP
    assert system.topics[module.plan or 0].driver == "M"
