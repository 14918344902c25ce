"""A module below another one: what its proof takes from that one (docs/proof-modules.md, Towers).

Purpose: `under`: where the module above gives control back, as a predicate over what the plants of
the proof drive, and how old the state behind that verdict may be once it is in force;
`handed_back`: times that count it.
Non-goals: that the state is then in R(H) (`claims/handover_claims.py`), what H has to be
(`time/schedule.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING

from soter.language.elaborate.derived_systems import with_module
from soter.language.elaborate.views_for_proofs import systems_by_view
from soter.language.model import typed
from soter.language.model.system import modules_above
from soter.language.model.tree_walk import conjuncts, nodes, topic_reads
from soter.language.model.types import show_ns
from soter.verify.problem.assumption import Assumption
from soter.verify.problem.modes_of_other_modules import modes_as_topics
from soter.verify.problem.supported_constructs import UNKNOWN_FACTS
from soter.verify.problem.verification_system import place
from soter.verify.time.problem_times import read_by_dm, read_by_sc, times_of

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Module, System
    from soter.verify.problem.problem import ProblemKind, Times
    from soter.verify.problem.verification_system import VerificationSystem

DECLARED = {"late_dm", "response_dm", "nodes"}
"""Times of the module above that a hand-back rests on."""


@dataclass(frozen=True)
class Above:
    """The module above. `safer`: the parts of it that the plants of the proof show.

    `back_ns`: from the state behind a verdict by which it gives control back until that is in
    force, at most; `declared`: whether no time in that is taken for zero.
    """

    name: str
    safer: typed.TypedExpr
    back_ns: int
    declared: bool

    @property
    def assumptions(self) -> list[Assumption]:
        """What the claim is about, and what it rests on."""
        while_ = (
            f"`safe` is claimed while {self.name} is in AC, from each time on at which it gives "
            "control back; not before the first, and not while it is in SC"
        )
        counted = (
            f"a verdict of {self.name} by which it gives control back is in force at most "
            f"{show_ns(self.back_ns)} after the state that it is about"
        )
        stops = (
            f"while {self.name} is in SC, too, what plants publish lies in the declared sets (else "
            "they stop)"
        )
        return [
            Assumption(f"while {self.name}", while_),
            Assumption(f"verdict of {self.name}", counted),
            Assumption(f"sets while {self.name}", stops),
        ]


def under(
    flat: System, at: VerificationSystem, kind: ProblemKind, diagnostics: Diagnostics
) -> tuple[VerificationSystem, Above | None]:
    """The module above the one of a verification system, with its hand-backs as `enters`.

    None where there is none above, or, with a diagnostic R020, where it is not followed.
    """
    modules = modules_above(flat, at.home.index)
    if not modules:
        return at, None
    above = _above(flat, at, modules[0], kind, diagnostics)
    if above is None:
        return at, None
    symbol = at.module.symbol
    verify = replace(symbol.verify, enters=above.safer)
    module = replace(at.module, symbol=replace(symbol, verify=verify))
    return replace(at, system=with_module(at.system, module), module=module), above


def handed_back(times: Times, above: Above | None) -> Times:
    """With what a hand-back of the module above asks of H; P1c rests on its times, too."""
    if above is None:
        return times
    return replace(
        times,
        schedule=replace(times.schedule, back=above.back_ns),
        declared=times.declared if above.declared else times.declared - {"nodes"},
    )


def _above(
    flat: System,
    at: VerificationSystem,
    module: Module,
    kind: ProblemKind,
    diagnostics: Diagnostics,
) -> Above | None:
    params = [{p: repr(v) for p, v in m.scope.params.items()} for m in (module, at.module)]
    parts = [e for e in conjuncts(_safer(module)) if _shown(e, module, at)]
    wrong = {
        "its plants move in steps (`next`): two DMs and two SCs share an instant": kind != "flow",
        f"`{module.name}` has other values of its parameters": params[0] != params[1],
        f"`safer` of `{module.name}` says nothing of its plants": not parts,
    }
    why = next((why for why, is_so in wrong.items() if is_so), "")
    if why:
        _refuse(at, module, why, diagnostics)
        return None
    times = _times(flat, module, diagnostics)
    if not times:
        return None
    return Above(
        module.name,
        reduce(lambda a, b: typed.TypedBinary(a.type, a.span, "&&", a, b), parts),
        max(t.age_dm + t.late_dm + t.response_dm for t in times),
        all(t.declared >= DECLARED for t in times),
    )


def _safer(module: Module) -> typed.TypedExpr:
    symbol = module.whole or module.symbol
    assert symbol.safer is not None, "M019"
    return symbol.safer


def _shown(part: typed.TypedExpr, module: Module, at: VerificationSystem) -> bool:
    """Whether a part says of the proof's plants what it says where it stands.

    It reads topics that DM or SC below read, too: of these the errors are known.
    """
    known = {*read_by_dm(at), *read_by_sc(at)}
    if any(type(n) in UNKNOWN_FACTS for n in nodes([part])):
        return False
    for topic in topic_reads(part):
        own_topic = module.scope.topics[topic]
        if at.flying(topic) != own_topic or at.module.scope.topics.get(topic) not in known:
            return False
    return bool(topic_reads(part))


def _times(flat: System, module: Module, diagnostics: Diagnostics) -> list[Times]:
    """Of the module above, in each of its views; none, and its diagnostics, where it has none."""
    times = []
    for seen in systems_by_view(flat, module):
        system, one, _ = modes_as_topics(*seen)
        there = place(system, one)
        times.append(times_of(there, "flow", diagnostics)[0])
    return [] if diagnostics.has_errors else times


def _refuse(at: VerificationSystem, module: Module, why: str, diagnostics: Diagnostics) -> None:
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
