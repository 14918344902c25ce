"""A module in a tower: another module has it in the place of its AC, or it has one as its own AC.

Purpose: `check_tower` refuses (R020) a tower that no proof covers. `with_module_above` finds where
the module above gives control back, as a predicate over what the plants of the proof drive, and how
old the state behind that verdict may be once it is in force (docs/proof-modules.md, "Towers");
`with_hand_back` adds that age to the times of the module below.
Non-goals: that the state is then in R(H) (`claims/start.py`); what H has to be (`schedule.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING

from soter.language.elaborate.derived_systems import with_module
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.model import typed
from soter.language.model.system import claims_nothing, modules_above, tower_of
from soter.language.model.tree_walk import conjuncts, nodes, topic_reads
from soter.language.model.types import show_ns
from soter.verify.problem.problem import Assumption
from soter.verify.problem.problem_times import times_of
from soter.verify.problem.supported_constructs import UNKNOWN_FACTS
from soter.verify.problem.verification_system import (
    modes_as_topics,
    read_by_dm,
    read_by_sc,
    verification_system_of,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Module, System
    from soter.verify.problem.problem import ProblemKind, Times
    from soter.verify.problem.verification_system import VerificationSystem


HAND_BACK_TIMES = {"late_dm", "response_dm", "nodes"}
"""The times of the module above that a hand-back depends on."""


@dataclass(frozen=True)
class ModuleAbove:
    """The module above; `safer`: the parts of its `safer` that the plants of the proof show.

    `back_ns`: the longest time in ns from the state behind a verdict that gives control back until
    that is in force; `declared`: whether all times in it are declared.
    """

    name: str
    safer: typed.TypedExpr
    back_ns: int
    declared: bool

    @property
    def assumptions(self) -> list[Assumption]:
        """The assumptions about when the claim holds, and about the module above."""
        only_while = (
            f"`safe` is claimed while {self.name} is in AC, from each time on at which it gives "
            "control back; not before the first, and not while it is in SC"
        )
        verdict_age = (
            f"a verdict of {self.name} by which it gives control back is in force at most "
            f"{show_ns(self.back_ns)} after the state that it is about"
        )
        stay_in_sets = (
            f"while {self.name} is in SC, too, what plants publish lies in the declared sets (else "
            "they stop)"
        )
        return [
            Assumption(f"while {self.name}", only_while),
            Assumption(f"verdict of {self.name}", verdict_age),
            Assumption(f"sets while {self.name}", stay_in_sets),
        ]


def with_module_above(
    flat: System, at: VerificationSystem, kind: ProblemKind, diagnostics: Diagnostics
) -> tuple[VerificationSystem, ModuleAbove | None]:
    """The verification system with hand-backs of the module above as `enters`, and that module.

    None where there is none above, or, with a diagnostic R020, where no proof covers it.
    """
    modules = modules_above(flat, at.home.index)
    if not modules:
        return at, None
    above = _module_above(flat, at, modules[0], kind, diagnostics)
    if above is None:
        return at, None
    symbol = at.module.symbol
    verify = replace(symbol.verify, enters=above.safer)
    module = replace(at.module, symbol=replace(symbol, verify=verify))
    return replace(at, system=with_module(at.system, module), module=module), above


def with_hand_back(times: Times, above: ModuleAbove | None) -> Times:
    """The times with the H that a hand-back needs, and with the times that it depends on."""
    if above is None:
        return times
    return replace(
        times,
        schedule=replace(times.schedule, back=above.back_ns),
        declared=times.declared if above.declared else times.declared - {"nodes"},
    )


def _module_above(
    flat: System,
    at: VerificationSystem,
    module: Module,
    kind: ProblemKind,
    diagnostics: Diagnostics,
) -> ModuleAbove | None:
    """The module above, or None, with a diagnostic, where no proof covers its hand-backs."""
    params = [{p: repr(v) for p, v in m.scope.params.items()} for m in (module, at.module)]
    parts = [e for e in conjuncts(_safer_with_modes(module)) if _is_about_plants(e, module, at)]
    wrong = {
        "its plants move in steps (`next`): two DMs and two SCs share an instant": kind != "flow",
        f"`{module.name}` has other values of its parameters": params[0] != params[1],
        f"`safer` of `{module.name}` says nothing of its plants": not parts,
    }
    why = next((why for why, is_so in wrong.items() if is_so), "")
    if why:
        _refuse_below(at, module, why, diagnostics)
        return None
    times = _times_of_views(flat, module, diagnostics)
    if not times:
        return None
    return ModuleAbove(
        module.name,
        reduce(lambda a, b: typed.TypedBinary(a.type, a.span, "&&", a, b), parts),
        max(t.age_dm + t.late_dm + t.response_dm for t in times),
        all(t.declared >= HAND_BACK_TIMES for t in times),
    )


def _safer_with_modes(module: Module) -> typed.TypedExpr:
    symbol = module.whole or module.symbol
    assert symbol.safer is not None, "M019"
    return symbol.safer


def _is_about_plants(part: typed.TypedExpr, module: Module, at: VerificationSystem) -> bool:
    """Whether a part of the `safer` above means the same of the proof's plants.

    It does if it reads only topics that DM or SC below also read, as their errors are known.
    """
    known = {*read_by_dm(at), *read_by_sc(at)}
    if any(type(n) in UNKNOWN_FACTS for n in nodes([part])):
        return False
    for topic in topic_reads(part):
        own_topic = module.scope.topics[topic]
        if at.flying(topic) != own_topic or at.module.scope.topics.get(topic) not in known:
            return False
    return bool(topic_reads(part))


def _times_of_views(flat: System, module: Module, diagnostics: Diagnostics) -> list[Times]:
    """The times of the module above in each of its views; empty, with diagnostics, if none."""
    times = []
    for seen in systems_by_view(flat, module):
        system, one, _ = modes_as_topics(*seen)
        there = verification_system_of(system, one)
        times.append(times_of(there, "flow", diagnostics)[0])
    return [] if diagnostics.has_errors else times


def _refuse_below(
    at: VerificationSystem, module: Module, why: str, diagnostics: Diagnostics
) -> None:
    diagnostics.error(
        "R020",
        f"module `{at.home.name}` stands below module `{module.name}`, and is not proved there",
        at.home.symbol.span,
        also=((module.symbol.span, f"`{module.symbol.name}`"),),
        notes=(why,),
        helps=(
            f"let `safer` of `{module.symbol.name}` say where it gives control back",
            "or leave `verify` out: then nothing is claimed of it",
        ),
    )


def modules_below(flat: System, module: Module) -> tuple[str, ...]:
    """The module in the place of AC, the one in the place of its AC, and so on."""
    names = [m.name for m in tower_of(flat, module.index)]
    return tuple(names[names.index(module.name) + 1 :])


def check_tower(flat: System, module: Module, diagnostics: Diagnostics) -> None:
    """R020 for a tower (modules above each other) that no proof covers."""
    tower = tower_of(flat, module.index)
    if len(tower) == 1:
        return
    position = tower.index(flat.modules[module.index])
    other = tower[position - 1 if position else 1]
    why = _why_tower_unproved(flat, module, tower[:position])
    if not why:
        return
    diagnostics.error(
        "R020",
        f"module `{module.name}` stands {'below' if position else 'above'} module `{other.name}`, "
        "and is not proved there",
        module.symbol.span,
        also=((other.symbol.span, f"`{other.symbol.name}`"),),
        notes=(why,),
        helps=("verify it in a system of its own, with nodes as its controllers", "or test it"),
    )


def _why_tower_unproved(flat: System, module: Module, above: Sequence[Module]) -> str:
    """What keeps a module of a tower from being proved, in words; "": nothing."""
    symbol, verify = module.symbol, module.symbol.verify
    if verify.induction is not None:
        return "an induction follows an AC that is one node, and an SC whose DM alone gives control"
    if not above:
        return ""
    module_above = above[-1].name
    if claims_nothing(flat, module):
        return (
            f"it has no `verify` block: nothing is claimed, and `{module_above}` is proved anyhow"
        )
    sc = flat.components[module.sc].node
    assert sc is not None
    reasons = {
        "two modules are above it, and both give control back": len(above) > 1,
        f"`{module_above}` is forced to a mode, and never gives control back": above[-1].forced
        is not None,
        "it has views: where control is given back is asked of one set of plants": bool(
            verify.views or module.view
        ),
        "it has a `shield`, which counts commands that its own controllers gave": symbol.shield
        is not None,
        f"`{sc.name}` has `on takeover`, which runs whenever `{module_above}` gives control back": (
            sc.takeover is not None
        ),
        "its SC is still to be found": symbol.synthesized,
        "`enters` is what the module above says here": verify.enters is not None,
    }
    return next((why for why, is_so in reasons.items() if is_so), "")
