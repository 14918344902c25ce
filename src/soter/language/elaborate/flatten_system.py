"""Flattens a system, pass by pass: instances get names, parameters values, numbers are computed.

Purpose: `flatten` makes the `System` of a `SystemSymbol`. It calls the passes, which fill one
record (`flattening.py`), in the order in which they need each other.
Non-goals: what a pass does (a file each); P1a and P1b (`wellformed.py`), behaviour, storage.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.elaborate.composition_check import Composition, hyperperiod
from soter.language.elaborate.explorable import refuse_systems_in_world
from soter.language.elaborate.faults import add_faults
from soter.language.elaborate.passes.make_components import make_components
from soter.language.elaborate.passes.make_modules import make_modules
from soter.language.elaborate.passes.memory_topics import make_memory_topics
from soter.language.elaborate.passes.outside_values import add_externals, add_inputs
from soter.language.elaborate.passes.place_instances import check_wired_sets, place_instances
from soter.language.elaborate.passes.properties import (
    add_measures,
    add_properties,
    add_properties_of_test,
    enter_modes_in_scopes,
)
from soter.language.elaborate.passes.stated_values import add_checks_of_stated_values
from soter.language.elaborate.passes.step_times import mark_inline_nodes
from soter.language.elaborate.passes.system_numbers import TooLargeError, warn_of_idle_settings
from soter.language.elaborate.passes.topics import topic_index_at
from soter.language.model import typed
from soter.language.model.system import System

if TYPE_CHECKING:
    from collections.abc import Iterable

    from soter.language.elaborate.passes.flattening import Flattening


def flatten(flat: Flattening) -> System | None:
    """Gives the flat system, incomplete after errors; None if it is too large.

    Topics are numbered in the order in which the passes first mention them.
    """
    try:
        return _run_passes(flat) if flat.sizes.has_few_instances() else None
    except TooLargeError:
        return None


def _run_passes(flat: Flattening) -> System:
    place_instances(flat)
    check_wired_sets(flat)
    make_components(flat, "node")
    make_modules(flat)
    mark_inline_nodes(flat)
    enter_modes_in_scopes(flat)
    add_properties(flat)
    if flat.test is not None:
        add_checks_of_stated_values(flat, flat.test)
        add_properties_of_test(flat, flat.test)
    add_inputs(flat)
    add_externals(flat)
    if flat.test is None:
        add_measures(flat)
    make_memory_topics(flat)
    system = _system_from_record(flat)
    Composition(
        system, flat.symbol, flat.diagnostics, partial=flat.partial, draft=flat.draft
    ).check_all_rules(flat.property_reads)
    if flat.test is None:
        add_faults(flat, system)
    else:
        refuse_systems_in_world(flat, flat.test, system)
    _warn_of_idle_settings(flat)
    if not flat.unknown:
        system.hyperperiod_ns = hyperperiod(system, flat.symbol, flat.diagnostics)
    return system


def flatten_loose(flat: Flattening, topics: Iterable[typed.TopicSymbol]) -> System | None:
    """Makes a system of declarations outside systems and of `topics`, checking numbers alone."""
    flat.partial = True
    try:
        place_instances(flat)
        make_components(flat, "sc")
        make_modules(flat)
        for topic in topics:
            topic_index_at(flat, flat.parts[0], topic)
    except TooLargeError:
        return None
    return _system_from_record(flat)


def _system_from_record(flat: Flattening) -> System:
    return System(
        name=flat.symbol.name,
        program=flat.program,
        topics=tuple(flat.topics),
        components=tuple(flat.components),
        modules=tuple(flat.modules),
        properties=tuple(flat.properties),
        inputs=tuple(flat.inputs),
        until_ns=flat.run_length_ns(flat.symbol.until, "`until`"),
        params=flat.parameters.named,
        hyperperiod_ns=1,
        externals=tuple(flat.externals),
        measures=tuple(flat.measures),
    )


def _warn_of_idle_settings(flat: Flattening) -> None:
    """Warns W010 of settings that nothing reads, unless a part that may read them is missing."""
    settings = flat.parameters.settings_of_instances()
    if not settings or flat.partial:
        return
    code: list[tuple[str, tuple[object, ...]]] = [
        (part.prefix[:-1], (part.system.properties, part.system.inputs)) for part in flat.parts
    ]
    code += [(p.name, (p.symbol, *p.replaced.values())) for p in flat.placed]
    code += [
        (
            t.name.removesuffix(t.symbol.name).rstrip("."),
            (t.symbol.values, t.symbol.default, t.symbol.max_age),
        )
        for t in flat.topics
    ]
    warn_of_idle_settings(settings, code, flat.diagnostics)


def implicit_system(program: typed.TypedProgram) -> typed.SystemSymbol | None:
    """Gives a system with one instance of everything in a file without a system; None if empty."""
    used = {n for m in program.modules.values() for n in m.named_nodes}
    whats: list[typed.PlantSymbol | typed.ModuleSymbol | typed.NodeSymbol] = [
        *program.plants.values(),
        *program.modules.values(),
        *(n for n in program.nodes.values() if n not in used),
    ]
    in_file = [w for w in whats if "." not in w.name]
    if not in_file:
        return None
    instances = tuple(typed.InstanceSymbol(w.name, w, {}, {}, w.span) for w in in_file)
    return typed.SystemSymbol(name="Main", span=in_file[0].span, default=True, instances=instances)
