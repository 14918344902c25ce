"""A module below another one: what its claims take from that one (docs/proof.md, Towers).

Purpose: `read_above`: the parts of that one's `safer` which speak of the plants of this proof, and
what a hand-back asks of H; assumptions that follow.
Non-goals: that the state lies in R(H) there (`handover.py`); sharing code with
`verify/problem/module_above.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.module_facts import ModuleAbove, read_by
from soter.certificate.reading.problem import read_facts
from soter.certificate.reading.view_predicates import said_of
from soter.certificate.terms.terms import NotRecheckedError
from soter.certificate.time.hand_back import handed_back
from soter.language.model.durations import show_ns
from soter.language.model.system import modules_above

if TYPE_CHECKING:
    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import Said
    from soter.language.model.system import Module

OWN = ("late_dm", "response_dm")


def read_above(facts: Facts) -> None:
    """Enter the module above into the facts, and what it asks of H into the times.

    Nothing where there is none; `NotRecheckedError` where its hand-backs are not followed.
    """
    uppers = modules_above(facts.flying, facts.flying_module.index)
    if not uppers:
        return
    module = uppers[0]
    if facts.kind != "flow":
        raise NotRecheckedError("modules above each other over a plant that moves in steps")
    here, there = facts.module.scope, module.scope
    if repr(sorted((p.name, repr(v)) for p, v in here.params.items())) != repr(
        sorted((p.name, repr(v)) for p, v in there.params.items())
    ):
        raise NotRecheckedError(f"`{module.name}` has other parameters than the module below it")
    known = {i for of in read_by(facts) for i in of}
    shown = {
        topic
        for topic, index in here.topics.items()
        if index in known and there.topics.get(topic) == facts.running.get(index, -1)
    }
    assert module.symbol.safer is not None, "M019"
    safer = said_of(module.symbol.safer, shown)
    if safer is None:
        raise NotRecheckedError(f"`safer` of `{module.name}` says nothing of the plants here")
    seen = _problems(facts, module)
    setting, own = facts.setting, facts.own
    needs = max(handed_back(setting, own, u.setting.dm, u.own.age) for u in seen)
    facts.above = ModuleAbove(
        module.name,
        safer,
        max(u.own.age + u.setting.dm.slow for u in seen),
        declared=not any(u.ways.undeclared for u in seen)
        and all(getattr(u.symbol.verify, word) is not None for u in seen for word in OWN),
    )
    facts.times["H_star_ns"] = max(facts.times["H_star_ns"], needs)
    if facts.symbol.verify.horizon is None:
        facts.times["H_ns"] = max(facts.times["H_ns"], needs)


def assumed(above: ModuleAbove) -> Said:
    """What a claim of a module below another one is about, and what it rests on."""
    name = above.name
    text = f"`safe` is kept while {name} is in AC, from each time on at which it gives control back"
    yield f"while {name}", f"{text}; not before the first, and not while it is in SC"
    text = f"a verdict of {name} by which it gives control back is in force at most"
    yield f"verdict of {name}", f"{text} {show_ns(above.back_ns)} after the state that it is about"
    text = f"while {name} is in SC, too, what plants publish lies in the declared sets"
    yield f"sets while {name}", f"{text} (else they stop)"


def _problems(facts: Facts, module: Module) -> list[Facts]:
    """Of the module above, in each of its views: its times are the longest of them."""
    views = [v.name for v in module.symbol.verify.views] or [""]
    return [read_facts(facts.flying, module.name, view) for view in views]
