"""Towers, checked again: who has control through whom, and what the module above gives.

Purpose: `refuse_unproved_towers`: which module of a tower is followed here, and that all of its
controllers publish what it publishes; `slowest_below`: as often as P1a asks. `read_above`: the
parts of the `safer` above which speak of the plants of this proof, what a hand-back asks of H, and
assumptions that follow (proof-modules.md, Towers). `handed_back`: from the state on which the
module above gives control back to the instant from which all that acts is SC's, on states that are
no older.
Non-goals: that the state lies in R(H) there (`handover.py`); sharing code with
`verify/problem/module_above.py` and `verify/problem/extract.py`, which the prover goes by.

To the theorem an AC is anything that publishes values of the declared sets, and what it publishes
once the DM says SC is dropped. A module in the place of AC is that: a controller of it has control
only while the mode of every module above it is AC (docs/semantics.md, Modules above modules), and
each of its steps checks its values.

The module above said "SC" before: what SC publishes is dropped until the verdict is in force. It is
released at r, on a state of r - A or later, and in force `slow` later at most; in one instant SC
may come first. Of the states before that one nothing is known, and a command of SC answers a state
that is d old: so SC's run begins with the first output that acts d or more after that state.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.certificate.reading.module_facts import ModuleAbove, read_by
from soter.certificate.reading.problem import read_facts
from soter.certificate.reading.view_predicates import said_of
from soter.certificate.terms.terms import NotRecheckedError
from soter.certificate.time.derived_times import Clock, releases
from soter.language.model.system import modules_above
from soter.language.model.types import show_ns

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.certificate.reading.module_facts import Facts
    from soter.certificate.report import Said
    from soter.certificate.time.derived_times import DerivedTimes, TimingSetting
    from soter.language.model import typed
    from soter.language.model.system import Module, System


def refuse_unproved_towers(facts: Facts) -> None:
    """`NotRecheckedError` for a module of a tower that no theorem here is about."""
    system, module, symbol = facts.flying, facts.flying_module, facts.flying_module.symbol
    name = module.name
    for c in facts.commanding:
        assert c.node is not None
        if {*c.writes} != set(module.outputs):
            raise NotRecheckedError(f"`{c.name}` does not publish what `{name}` does")
    uppers = modules_above(system, module.index)
    if len(uppers) > 1:
        raise NotRecheckedError(f"`{name}` stands below two other modules")
    for above in uppers:
        if above.forced is not None:
            raise NotRecheckedError(f"`{above.name}`, above `{name}`, is forced to {above.forced}")
        if symbol.verify.views or symbol.shield is not None or symbol.verify.enters is not None:
            raise NotRecheckedError(
                f"`{name}` stands below another module, and has views or a shield"
            )


def slowest_below(system: System, module: Module) -> int:
    """The longest period in ns of its SC and of all that stands in the place of its AC."""
    parts = {system.components[module.sc].period_ns, system.components[module.ac].period_ns}
    below = module.over
    while below is not None:
        m = system.modules[below]
        parts |= {system.components[i].period_ns for i in (m.dm, m.sc, m.ac)}
        below = m.over
    return max(parts)


def handed_back(setting: TimingSetting, own: DerivedTimes, above: Clock, age: int) -> int:
    """In ns, the greatest over all schedules.

    `above`: the DM of the module above; `age`: A of it, in ns. NotRecheckedError where there are
    too many releases to go through.
    """
    worst = own.start
    settled = setting.settled + above.phase + 2 * above.period
    for r in releases(above, setting.periods, after=settled):
        passes = setting.sc.next_at(r + above.slow + 1)
        worst = max(worst, age + setting.acts_by(passes) - r)
    for t in setting.steady():
        before = min(effect.first(t) for effect in setting.effects)
        worst = max(worst, own.delay + setting.acts_by(t + setting.sc.period) - before)
    return worst


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
    mine, its = (sorted((p.name, repr(v)) for p, v in s.params.items()) for s in (here, there))
    if mine != its:
        raise NotRecheckedError(f"`{module.name}` has other parameters than the module below it")
    shown = _seen_by_both(facts, there.topics)
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


def _seen_by_both(facts: Facts, above: Mapping[typed.TopicSymbol, int]) -> set[typed.TopicSymbol]:
    """The topics that the module reads, and that are the same where they run."""
    known, topics = {i for of in read_by(facts) for i in of}, facts.module.scope.topics
    same = {t for t, i in topics.items() if above.get(t) == facts.running.get(i, -1)}
    return {t for t in same if topics[t] in known}


def _problems(facts: Facts, module: Module) -> list[Facts]:
    """Of the module above, in each of its views: its times are the longest of them."""
    views = [v.name for v in module.symbol.verify.views] or [""]
    return [read_facts(facts.flying, module.name, view) for view in views]
