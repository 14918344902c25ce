"""What is doubtful about the modules of a flat system that has no errors.

Purpose: W012 (AC and SC look exchanged), W014 (a state that nothing moves), W018 (`safe` speaks of
what the module publishes), and the doubts of the other files of this folder, in one call.
Non-goals: P1, P2, P3: nothing here is needed for a proof, and nothing here is one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.diagnostics.fix import exchange
from soter.language.check.parts.plant import unmoved
from soter.language.elaborate.lints.contradictory_predicates import doubt_predicates, tried
from soter.language.elaborate.lints.diverging_schemes import doubt_scheme
from soter.language.elaborate.lints.doubtful_times import (
    doubt_age_units,
    doubt_ageless,
    doubt_ages,
    doubt_holds,
    doubt_property_times,
)
from soter.language.elaborate.lints.refuted_at_once import (
    doubt_constants,
    doubt_first_publications,
    doubt_properties,
    doubt_readers,
    doubt_start,
    doubt_trials,
)
from soter.language.elaborate.lints.several_commands import doubt_shield
from soter.language.elaborate.lints.silent_sc import doubt_publications
from soter.language.elaborate.lints.step_ranges import doubt_steps
from soter.language.model.durations import show_ns
from soter.language.model.tree_walk import topic_reads
from soter.language.model.typed import PeriodRead, TypedBinary, Vector

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostics
    from soter.language.model.system import Component, Module, System
    from soter.language.model.typed import PlantSymbol, TopicSymbol


TRIED_MAX = 16
"""Of so many modules the predicates are tried: some milliseconds each."""
SLOWER = 5
"""An SC whose period is so many times that of AC is hardly the one that acts at once."""


def doubt(system: System, diagnostics: Diagnostics) -> None:
    """Warn of what is doubtful in each plant, and in each module as it is declared."""
    for component in system.components:
        if component.plant is not None:
            _unmoved(component.plant, diagnostics)
            _times_dt(component.plant, diagnostics)
            doubt_scheme(system, component, diagnostics)
            doubt_first_publications(system, component, diagnostics)
            doubt_holds(component, diagnostics)
        _hears_itself(component, diagnostics)
    doubt_steps(system, diagnostics)
    doubt_properties(system, diagnostics)
    doubt_property_times(system, diagnostics)
    for number, module in enumerate(system.modules):
        symbol = module.symbol
        sc, ac = system.components[module.sc], system.components[module.ac]
        if sc.node is not symbol.sc or (module.over is None and ac.node is not symbol.ac):
            continue  # replaced in this system
        if module.over is None:
            _exchanged(system, module, diagnostics)
        _speaks_of_outputs(module, diagnostics)
        doubt_publications(system, module, diagnostics)
        doubt_readers(system, module, diagnostics)
        doubt_ages(system, module, diagnostics)
        doubt_ageless(system, module, diagnostics)
        doubt_age_units(system, module, diagnostics)
        doubt_shield(system, module, diagnostics)
        if number < TRIED_MAX:
            doubt_start(system, module, diagnostics)
            trials = tried(system, module)
            if not (
                doubt_constants(system, module, trials, diagnostics)
                or doubt_predicates(system, module, trials, diagnostics)
            ):
                doubt_trials(system, module, trials, diagnostics)


def _exchanged(system: System, module: Module, diagnostics: Diagnostics) -> None:
    """W012: what is fast and written in Soter is AC, what is slow or foreign is SC.

    Of a module with `rest` a period says nothing: its DM follows each hold of SC, so there a slow
    SC acts in time, and costs less to follow.
    """
    symbol = module.symbol
    ac, sc = system.components[module.ac], system.components[module.sc]
    at_ac, at_sc = symbol.ac_span, symbol.sc_span
    if ac.extern or symbol.synthesized or at_ac is None or at_sc is None:
        return
    if sc.extern:
        label, of_ac = "an extern: no proof knows what it does", "written in Soter"
    elif symbol.rest is None and sc.period_ns >= SLOWER * ac.period_ns:
        label = f"steps every {show_ns(sc.period_ns)}"
        of_ac = f"steps every {show_ns(ac.period_ns)}"
    else:
        return
    diagnostics.warning(
        "W012",
        f"AC and SC of module `{symbol.name}` look exchanged",
        at_sc,
        label,
        also=((at_ac, of_ac),),
        notes=("the safe controller is the one that is trusted, and acts at once",),
        helps=(exchange(at_ac, at_sc, f"exchange them: `ac {at_sc.text};`, `sc {at_ac.text};`"),),
    )


def _unmoved(plant: PlantSymbol, diagnostics: Diagnostics) -> None:
    """W014: the rule was forgotten, or it is no state."""
    for state in unmoved(plant):
        diagnostics.warning(
            "W014",
            f"the state `{state.name}` of plant `{plant.name}` never changes",
            state.span,
            "no `der` and no `next`",
            notes=("what is constant is a `const`; a constant that is unknown has a set: `in`",),
            helps=(f"say how it moves: `der {state.name} = ...;` or `next {state.name} = ...;`",),
        )


def _hears_itself(component: Component, diagnostics: Diagnostics) -> None:
    """W036: one topic stands for what a plant or node reads, and for what it publishes."""
    topics, plant, node = component.scope.topics, component.plant, component.node
    reads: list[TopicSymbol] = []
    own: list[TopicSymbol] = []
    if plant is not None:
        reads, own = list(plant.reads), [t for t, _ in plant.drives]
    elif node is not None:
        reads, own = [s.topic for s in node.subscribes], list(node.publishes)
    else:
        return
    written = {topics[t]: t for t in own}
    for topic in reads:
        out = written.get(topics[topic])
        if out is None or out is topic:
            continue
        diagnostics.warning(
            "W036",
            f"`{component.name}` reads as `{topic.name}` what it publishes itself",
            component.span,
            f"`{topic.name}` and `{out.name}` are wired to one topic",
            also=((topic.span, "what it reads"), (out.span, "what it publishes")),
            notes=("nobody else says anything on that topic",),
            helps=(f"wire `{topic.name}` to what another one publishes",),
        )


def _times_dt(plant: PlantSymbol, diagnostics: Diagnostics) -> None:
    """W032: `der x = v * dt` integrates twice over: the plant multiplies by its step itself."""
    for state, slope in plant.der.items():
        factors = [slope]
        for e in factors:
            if isinstance(e, (TypedBinary, Vector)) and e.op == "*":
                factors += [e.left, e.right]
        for e in factors:
            if isinstance(e, PeriodRead):
                diagnostics.warning(
                    "W032",
                    f"the derivative of `{state.name}` is multiplied by `dt`",
                    e.span,
                    "a time",
                    also=((state.span, "this state"),),
                    notes=("`der` says how fast a state moves: the plant integrates by itself",),
                    helps=("leave `dt` out, or say what the state is after a step: `next`",),
                )
                return


def _speaks_of_outputs(module: Module, diagnostics: Diagnostics) -> None:
    """W018: AC may publish anything of the set, so it holds always or can be lost at once."""
    symbol = module.symbol
    outputs = {t for n in (symbol.ac, symbol.sc) for t in n.publishes}
    for topic, read in topic_reads(symbol.safe).items():
        if topic not in outputs:
            continue
        diagnostics.warning(
            "W018",
            f"`safe` of module `{symbol.name}` speaks of its own output `{topic.name}`",
            read.span,
            "AC may publish any value of its set",
            also=((topic.span, "declared here"),),
            notes=("no switch prevents a command that was given: the gate bounds it by its set",),
            helps=("say it with the set of the topic; `safe` speaks of the state of the plant",),
        )
