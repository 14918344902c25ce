"""What a deployed system inherits of the one in which its modules were proved.

Purpose: which proofs are carried, and what is still assumed, module by module.
Non-goals: tables that were computed there (`missing_predicates.py`); that both are the same
program (`elaborate/deployment/deployed_systems.py`), what sensors have to give
(`deployed_sensors.py`, `verify/induction/inputs_from_outside.py`), certificates
(`api/deploying.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.elaborate.derived_systems import at_once, faultless
from soter.language.elaborate.views import systems_by_view
from soter.verify.module_methods import module_method
from soter.verify.problem.assumption import texts
from soter.verify.problem.extract import extract

if TYPE_CHECKING:
    from soter.language.model.system import Module, System
    from soter.verify.problem.problem import Problem

IN_TIME = "the loop runs every instant no later than `late` says (SOTER_LATE tells)"


@dataclass(eq=False)
class TransferredProof:
    """A module of a deployed system; `why_not`: why nothing of its proof holds here, or ""."""

    module: str
    why_not: str = ""
    covered: list[str] = field(default_factory=list)
    """What comes from outside, each with the bounds that the proof allows for."""
    assumptions: list[str] = field(default_factory=list)
    """What is assumed of the world and of the loop besides what the proof assumes."""


def inherited(here: System, there: System) -> tuple[TransferredProof, ...]:
    """Of every module what it inherits; `there` as it was declared, without computed predicates.

    `SoterError` D019 where something from outside is not covered.
    """
    diagnostics = Diagnostics()
    proved = faultless(at_once(there))
    _all_sensed(here, there, diagnostics)
    inheritances = [_of_module(here, m, proved, diagnostics) for m in here.modules]
    diagnostics.raise_errors()
    return tuple(inheritances)


def _all_sensed(here: System, there: System, diagnostics: Diagnostics) -> None:
    """D019 where a plant reads what nobody takes out of the deployed system."""
    said = {here.topics[e.topic].name for e in here.externals}
    for c in there.components:
        for topic in c.plant.reads if c.plant is not None else ():
            name = there.topics[c.scope.topics[topic]].name
            if name not in said and there.topics[c.scope.topics[topic]].driver != "input":
                diagnostics.error(
                    "D019",
                    f"plant `{c.name}` reads `{name}`, and nobody takes it out of `{here.name}`",
                    here.program.systems[here.name].span,
                    also=((topic.span, "the topic"),),
                    helps=(f"add `external topic {name};`",),
                )


def _of_module(
    here: System, m: Module, there: System, diagnostics: Diagnostics
) -> TransferredProof:
    inheritance = TransferredProof(m.name)
    proved = next(x for x in there.modules if x.name == m.name)
    try:
        problems = [extract(*seen) for seen in systems_by_view(there, proved)]
    except SoterError as error:
        inheritance.why_not = f"nothing can be proved of it: {error.diagnostics[0].message}"
        return inheritance
    for problem in problems:
        inheritance.why_not = inheritance.why_not or _beyond(problem, proved)
    if inheritance.why_not:
        return inheritance
    for problem in problems:
        inheritance.assumptions += [
            text for text in texts(problem.assumptions) if text not in inheritance.assumptions
        ]
    (problem,) = problems
    covers = module_method(problem).covers
    inheritance.covered, assumed = covers(here, there, problem, diagnostics)
    inheritance.assumptions += [*assumed, IN_TIME]
    return inheritance


def _beyond(problem: Problem, module: Module) -> str:
    """Why a proof of this kind is not carried into the world."""
    if module.symbol.verify.abstracts or problem.view:
        return (
            "it was proved on verification plants (`abstracts`), and how old a state is behind the "
            "nodes that show it is not carried over yet"
        )
    return ""
