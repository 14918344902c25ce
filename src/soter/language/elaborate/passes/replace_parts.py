"""Puts a node, plant or contract in the place of a part, as `replace` of a system or a test says.

Purpose: finds the part that a path names, replaces it, and reports a replacement that does not fit
into its place (M002, M013, M014).
Non-goals: what a stand-in by contract does (`stand_ins.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.language.check.dots_and_brackets import quoted
from soter.language.elaborate.passes.flattening import PlacedInstance, ReplacedModule
from soter.language.elaborate.passes.stand_ins import ContractStandIn
from soter.language.elaborate.wellformed import refuse_bursts
from soter.language.model import typed
from soter.language.model.tree_walk import nodes

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Span
    from soter.language.elaborate.passes.flattening import Flattening, SubSystem

Replacement = typed.NodeSymbol | typed.PlantSymbol | typed.ByContract
ROLES = ("ac", "sc")


def replace_part(flat: Flattening, prefix: str, path: str, by: Replacement, span: Span) -> None:
    """Replaces the part that `path` names below `prefix`; reports M013 if there is no such part."""
    flat.partial = flat.partial or by in flat.program.damaged
    replaced_any = False
    for placed in tuple(flat.placed):
        if placed.name.startswith(prefix):
            local = placed.name[len(prefix) :]
            replaced_any = _replace_where_named(flat, placed, local, path, by, span) or replaced_any
    if not replaced_any and not flat.partial:
        _report_nothing_replaced(flat, prefix, path, by, span)


def _replace_where_named(
    flat: Flattening, placed: PlacedInstance, local: str, path: str, by: Replacement, span: Span
) -> bool:
    """Replaces the instance at `path`, or a part of it; returns False if `path` names neither."""
    symbol = placed.symbol
    if isinstance(symbol, typed.ModuleSymbol):
        if flat.test is not None and path in {local, symbol.name}:
            return _replace_module(flat, placed, by, span)
        return _replace_controllers(flat, placed, local, path, by, span)
    if placed.by_contract or path not in {local, symbol.name}:
        return False
    if isinstance(by, typed.ByContract) and isinstance(symbol, typed.NodeSymbol):
        placed.by_contract[symbol.name] = ContractStandIn(placed.name, "node", "node", (), span)
        return True
    if isinstance(by, (typed.NodeSymbol, typed.PlantSymbol)) and type(symbol) is type(by):
        _require_same_outputs(flat, symbol, by, span)
        _require_same_states(flat, placed, by, span)
        placed.symbol = by
        flat.put_in[placed.name] = span
        return True
    return False


def _report_nothing_replaced(
    flat: Flattening, prefix: str, path: str, by: Replacement, span: Span
) -> None:
    plant = isinstance(by, typed.PlantSymbol)
    kind = "plant" if plant else "node or module" if flat.test is not None else "node"
    names = _names_of_replaceable(flat, typed.PlantSymbol if plant else typed.NodeSymbol)
    if flat.test is not None and not plant:
        names += [p.name for p in flat.placed if isinstance(p.symbol, typed.ModuleSymbol)]
    known = [n[len(prefix) :] for n in names if n.startswith(prefix)]
    kinds = "nodes and modules" if kind == "node or module" else f"{kind}s"
    flat.diagnostics.error(
        "M013",
        f"this system has no {kind} `{path}` to replace",
        span,
        notes=(f"its {kinds} are {quoted(known)}",) if known else (),
        helps=flat.diagnostics.did_you_mean(path, known, span),
    )


def _replace_controllers(
    flat: Flattening, placed: PlacedInstance, local: str, path: str, by: Replacement, span: Span
) -> bool:
    """Replaces the module's controllers that `path` names; returns False if it names none."""
    module = placed.symbol
    assert isinstance(module, typed.ModuleSymbol)
    hit = False
    for node in module.controllers:
        short = node.name.rsplit(".", 1)[-1]
        if path not in {node.name, short, f"{local}.{short}"}:
            continue
        hit = hit or isinstance(by, (typed.ByContract, typed.NodeSymbol))
        if isinstance(by, typed.ByContract):
            name = f"{placed.name}.{short}"
            placed.by_contract[node.name] = ContractStandIn(name, "node", "node", (), span)
        elif isinstance(by, typed.NodeSymbol):
            _require_same_outputs(flat, node, by, span)
            placed.replaced[node.name] = by
            refuse_bursts(module, by, span, flat.diagnostics)
    if isinstance(by, typed.NodeSymbol):
        _require_two_controllers(flat, placed, span)
    return hit


def _replace_module(flat: Flattening, placed: PlacedInstance, by: Replacement, span: Span) -> bool:
    module, p = placed.symbol, placed
    assert isinstance(module, typed.ModuleSymbol)
    if isinstance(by, typed.PlantSymbol):
        return False
    flat.gone[p.name] = ReplacedModule(module, span)
    if isinstance(by, typed.NodeSymbol):
        _require_same_outputs(flat, module, by, span)
        flat.put_in[p.name] = span
        made = [PlacedInstance(p.name, by, p.prefix, p.wires, p.span, p.params)]
    else:
        made = []
        names = controller_names(p.name, *p.controllers())
        for node, name, role in zip(p.controllers(), names, ROLES, strict=True):
            stand_in = PlacedInstance(name, node, p.prefix, p.wires, p.span, p.params)
            stand_in.by_contract[node.name] = ContractStandIn(
                p.name, "module", role, module.contract, span
            )
            made.append(stand_in)
    at = flat.placed.index(p)
    flat.placed[at : at + 1] = made
    return True


def _names_of_replaceable(flat: Flattening, kind: type) -> list[str]:
    """Gives the full names of all plants, or of all nodes including controllers of modules."""
    names = []
    for placed in flat.placed:
        if isinstance(placed.symbol, kind):
            names.append(placed.name)
        elif kind is typed.NodeSymbol and isinstance(placed.symbol, typed.ModuleSymbol):
            short = (n.name.rpartition(".")[2] for n in placed.symbol.controllers)
            names += [f"{placed.name}.{name}" for name in short]
    return names


def _require_same_outputs(flat: Flattening, old: object, new: object, span: Span) -> None:
    def published_topics(s: object) -> set[typed.TopicSymbol]:
        if isinstance(s, (typed.NodeSymbol, typed.ModuleSymbol)):
            return set(s.publishes if isinstance(s, typed.NodeSymbol) else s.sc.publishes)
        return {t for t, _ in s.drives} if isinstance(s, typed.PlantSymbol) else set()

    if published_topics(old) == published_topics(new) or {old, new} & flat.program.damaged:
        return
    assert isinstance(old, typed.Symbol)
    assert isinstance(new, typed.Symbol)
    flat.partial = True  # topics without a driver now were driven by the old part
    flat.diagnostics.error(
        "M014",
        f"`{new.name}` does not publish what `{old.name}` publishes",
        span,
        also=(
            (old.span, f"publishes {_quoted_names(published_topics(old))}"),
            (new.span, f"publishes {_quoted_names(published_topics(new))}"),
        ),
        helps=("a replacement offers the same topics",),
    )


def _require_same_states(flat: Flattening, placed: PlacedInstance, by: object, span: Span) -> None:
    """Reports M014 if a property reads a plant's state that the replacement does not have."""
    if not isinstance(by, typed.PlantSymbol):
        return
    read = (
        node
        for part in flat.parts
        for node in nodes(_expressions_of_properties(flat, part))
        if isinstance(node, typed.TruthRead) and part.prefix + node.instance == placed.name
    )
    for node in read:
        if node.type != by.truth:
            flat.diagnostics.error(
                "M014",
                f"`{by.name}` has other states than `{placed.symbol.name}`",
                span,
                also=((node.span, "but a property reads them here"),),
                helps=("declare the same states, in the same order",),
            )
            return


def _require_two_controllers(flat: Flattening, placed: PlacedInstance, span: Span) -> None:
    """Reports M002 if a replacement makes the same node AC and SC."""
    ac, sc = placed.controllers()
    module = placed.symbol
    assert isinstance(module, typed.ModuleSymbol)
    if ac is sc and module.ac is not module.sc:
        flat.diagnostics.error(
            "M002",
            f"with this, `{ac.name}` is both AC and SC of module `{module.name}`",
            span,
            also=((module.span, "the module"),),
            helps=("to run one controller alone, write `force M ac;` or `force M sc;`",),
        )


def controller_names(module: str, ac: typed.NodeSymbol, sc: typed.NodeSymbol) -> tuple[str, str]:
    """Gives full names of AC and SC: `M.Fast`, or `M.ac.Fast` if `M.Fast` is taken."""
    short = [n.name.rpartition(".")[2] for n in (ac, sc)]
    roles = [
        f"{role}.{name}" if short[0] == short[1] or name == "dm" else name
        for role, name in zip(ROLES, short, strict=True)
    ]
    return f"{module}.{roles[0]}", f"{module}.{roles[1]}"


def _expressions_of_properties(flat: Flattening, part: SubSystem) -> list[typed.TypedExpr | None]:
    """Gives the expressions of a part's properties; the outermost part includes the test's."""
    tested = flat.test.properties if flat.test is not None and not part.prefix else ()
    return [e for p in (*part.system.properties, *tested) for e in (p.premise, p.condition)]


def _quoted_names(topics: set[typed.TopicSymbol]) -> str:
    return ", ".join(sorted(f"`{t.name}`" for t in topics)) or "nothing"
