"""Makes the verification problem of a module from its program.

Purpose: `extract` makes the `Problem` of a module of a flat system. Where the program does not
determine a problem, a diagnostic says what to write (codes R...).
Non-goals: computing sets (`verify/grid/sets.py`), verdicts (`verify/verify_module.py`).
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

from soter.core.steps import lower
from soter.diagnostics.diagnostic import Diagnostics, SoterError
from soter.language.check.constants_and_types import Calculator
from soter.language.elaborate import derived_systems
from soter.language.elaborate.views_for_proofs import refuse_views
from soter.language.model.assumption_words import in_words
from soter.language.model.system import LEVELS_DEFAULT
from soter.language.model.types import leaves
from soter.language.syntax.schemes import SCHEMES
from soter.verify.induction.problem import extract_induction
from soter.verify.problem.assumptions import assumptions_of, jumps_of
from soter.verify.problem.axes import (
    Axes,
    far_turns_assumption,
    groups_that_wrap,
    law_with_same_wrapping,
    starts_on_axes,
    states_that_wrap,
)
from soter.verify.problem.cause_effect_chains import (
    has_outputs_in_proof_state,
    side_input_publishers,
)
from soter.verify.problem.inputs import Inputs, inputs_of
from soter.verify.problem.left_out_states import states_to_leave_out
from soter.verify.problem.problem import NS, ORDER, Assumption, Interval, Problem, Times
from soter.verify.problem.problem_times import times_of
from soter.verify.problem.supported_constructs import check_supported
from soter.verify.problem.verification_system import (
    VerificationSystem,
    system_under_law,
    system_with_all_predicates,
    system_with_mode_topics,
    verification_system_of,
    why_law_not_held,
)
from soter.verify.tubes.problem import problem_of_plans, tube_problem_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from soter.core.core import CoreSystem
    from soter.language.model.system import Module, System
    from soter.verify.problem.cause_effect_chains import DownstreamPath
    from soter.verify.problem.problem import Group, Modes, ProblemKind, Quantities

CASES_MAX = 4096


HELP_FOR_NODES = "it is on sets of states; that belongs to one of nodes, by induction: `induction;`"
HELP_FOR_VIEWS = "it says when the state of a view may jump, and there is no view"


def extract(flat: System, module: Module, *, synthesize: bool = False) -> Problem:
    """The problem of a module of a flat system; raises `SoterError` R... if it has none.

    It includes the problem of a declared fail-safe law, and the problems of all plans if SC has
    several.
    """
    if module.plan is not None:
        alone = derived_systems.systems_by_plan(flat, module)
        return problem_of_plans(module, [_problem_of(*system) for system in alone])
    problem = _problem_of(flat, module, synthesize=synthesize)
    if module.law and module.symbol.verify.induction is None:
        try:
            problem.law_unread = why_law_not_held(flat, module) or _why_law_uncovered(problem)
            if not problem.law_unread:
                law = _problem_of(*system_under_law(flat, module))
                problem.law = law_with_same_wrapping(law, problem.quantities.turning)
        except SoterError as error:
            problem.law_unread = error.diagnostics[0].message
    return problem


def _why_law_uncovered(problem: Problem) -> str:
    """Why nothing is claimed of this problem's fail-safe law; "" where a claim may be made.

    Other modules of the same trusted part keep nothing once that part has stopped. For a map it is
    not settled whether a command that ends at an instant moves the plant once more.
    """
    if problem.influences:
        named = ", ".join(i.name_in_proofs(problem.system) for i in problem.influences)
        return f"the plants are moved by {named}, which nobody keeps where all stops"
    if problem.kind != "flow":
        return "the plants move in steps (`next`): when a lease ends there is not settled"
    return ""


def _problem_of(flat: System, module: Module, *, synthesize: bool = False) -> Problem:
    """The problem of a module, without the problem of its fail-safe law."""
    diagnostics = Diagnostics()
    refuse_views(module)
    flat, module, modes = system_with_mode_topics(flat, module)
    if module.symbol.verify.induction is not None:
        return extract_induction(flat, module, modes)
    _refuse_clauses_of_other_proofs(module, diagnostics)
    at = verification_system_of(flat, module)
    kind = check_supported(at, diagnostics, synthesize=synthesize)
    diagnostics.raise_errors()
    inputs = inputs_of(at, diagnostics)
    diagnostics.raise_errors()
    core, rest_clause = lower(at.system), at.module.symbol.rest
    inputs, axes = _inputs_and_axes(at, core, inputs, kind, diagnostics)
    quantities, groups, turns_read = _quantities_and_groups(
        at, core, axes, kind, synthesize=synthesize
    )
    _refuse_unbounded_axes(at, groups, kind, diagnostics)
    times, chains = times_of(at, kind, diagnostics)
    _check_shield(at, groups, kind, times, chains.ways, diagnostics)
    _check_case_count(at, inputs, diagnostics)
    commands = _commands_to_try(at, inputs, diagnostics, synthesize=synthesize)
    diagnostics.raise_errors()
    calculator = Calculator(diagnostics, at.module.scope.params)
    symbol, jumps = at.module.symbol, jumps_of(at)
    levels, recover = symbol.verify.levels, symbol.verify.recover
    problem = Problem(
        system=at.system,
        core=core,
        module=at.module,
        quantities=quantities,
        kind=kind,
        plant_period_ns=at.plants[0].period_ns,
        states=_state_ranges(groups, axes),
        initial=starts_on_axes(groups, inputs.initial),
        controls=tuple(inputs.control_ranges),
        disturbances=tuple(inputs.disturbance_ranges),
        errors=tuple(inputs.error_ranges),
        others=tuple(inputs.other_ranges),
        parameters=tuple(inputs.parameters),
        groups=groups,
        times=times,
        levels=LEVELS_DEFAULT if levels is None else int(calculator.value(levels, "") or 0),
        levels_open=_is_level_count_to_choose(at.module) and not synthesize,
        has_core_hint=symbol.verify.core is not None,
        computed=symbol.ttf is None,
        synthesize=synthesize,
        topic_leaf_of_state={s: leaf for leaf, s in axes.topic_leaves.items()} | axes.shown,
        state_of_leaf=axes.topic_leaves,
        assumptions=(
            *assumptions_of(at, inputs, times, chains, kind, jumps),
            *_problem_assumptions(at, groups, modes),
        ),
        name=f"{module.name} as {module.view}" if module.view else module.name,
        beside=side_input_publishers(at),
        view=module.view,
        whole=system_with_all_predicates(at) if module.view else None,
        jumps=jumps,
        modes=modes if modes.topics or modes.margins else None,
        influences=at.influences,
        commands=commands,
        parameter_starts=tuple(inputs.parameter_starts),
        schemes=_schemes_of_states(at, inputs, quantities.turning) if kind == "flow" else (),
        still=frozenset(inputs.still),
        stays=bool(symbol.stay_clause),
        turns_read=turns_read,
        recover_ns=None if recover is None else int(calculator.value(recover, "") or 0),
    )
    return problem if rest_clause is None else tube_problem_of(problem, rest_clause, calculator)


def _is_level_count_to_choose(module: Module) -> bool:
    """Whether the number of levels is still to be chosen; a view has none, as AC has no control."""
    symbol = module.symbol
    computed = symbol.ttf is None and symbol.rest is None
    return computed and symbol.verify.levels is None and not module.view


def _inputs_and_axes(
    at: VerificationSystem,
    core: CoreSystem,
    inputs: Inputs,
    kind: ProblemKind,
    diagnostics: Diagnostics,
) -> tuple[Inputs, Axes]:
    """The inputs and axes without the unbounded states on which no claim depends."""
    axes = Axes(at, inputs, diagnostics)
    sets = at.module.symbol.rest is None and kind == "flow"
    if not (sets and (boundless := axes.boundless_states())):
        return inputs, axes
    out, readers = states_to_leave_out(at, core, inputs.quantities(), boundless)
    inputs = inputs.without_states(out)
    return inputs, Axes(at, inputs, diagnostics, readers)


def _quantities_and_groups(
    at: VerificationSystem, core: CoreSystem, axes: Axes, kind: ProblemKind, *, synthesize: bool
) -> tuple[Quantities, tuple[Group, ...], dict[str, str]]:
    """The quantities, the groups, and for each angle that does not wrap a reader of the turns."""
    quantities = axes.inputs.quantities()
    groups = axes.groups() if at.module.symbol.rest is None else ()
    if kind != "flow" or synthesize:
        return quantities, groups, {}
    states, readers = states_that_wrap(at, core, quantities, groups)
    return replace(quantities, turning=states), groups_that_wrap(groups, states), readers


def _problem_assumptions(
    at: VerificationSystem, groups: tuple[Group, ...], modes: Modes
) -> list[Assumption]:
    """The assumptions that only some problems have: on a forced module, on axes and on modes."""
    beside = [*_open_end_assumptions(groups), *far_turns_assumption(groups)]
    return [*_forced_assumptions(at.flat, at.home), *beside, *modes.assumptions]


def _forced_assumptions(flat: System, module: Module) -> list[Assumption]:
    """The assumption that the DM of a forced module switches, which it does not."""
    if module.forced is None:
        return []
    who = module.forced.upper()
    text = f"the DM switches: in system {flat.name} it does not, {module.name} is forced to {who}"
    return [Assumption("forced", text)]


def _open_end_assumptions(groups: tuple[Group, ...]) -> list[Assumption]:
    ends = [(a.name, a.edges[-1]) for g in groups for a in g.axes if a.open]
    return [Assumption(f"open {n} {end!r}", in_words("open", n, end)) for n, end in ends]


def _check_shield(
    at: VerificationSystem,
    groups: tuple[Group, ...],
    kind: ProblemKind,
    times: Times | None,
    ways: Sequence[DownstreamPath],
    diagnostics: Diagnostics,
) -> None:
    """Reports R007 for a shield that the proof does not cover.

    A node that runs behind SC in the same instant passes on a command of AC by SC's next release,
    which W covers. Other nodes may pass it on at any later time. The result of a node that also
    uses sensors or a memory has to be a state of the plants of the proof.
    """
    symbol = at.module.symbol
    if symbol.shield is None:
        return
    nodes_behind = times is not None and any(o.nodes for o in times.schedule.outputs)
    reads_more = times is not None and times.schedule.sc_reads_more
    wrong = {
        "an SC that is to be found": symbol.synthesized,
        "nodes between the module and its plants": nodes_behind or _may_delay_command(at, ways),
        "an SC that reads what the DM does not": reads_more,
        "views": bool(at.module.view),
        "an AC that runs between the steps of its plant": kind == "map"
        and _ac_runs_between_steps(at),
        "an axis without ends": any(a.unbounded for g in groups for a in g.axes),
    }
    for reason in (reason for reason, is_so in wrong.items() if is_so):
        diagnostics.error(
            "R007",
            f"a shield beside {reason}",
            symbol.shield.span,
            "is not proved",
            helps=("leave `shield` out: `ttf` looks at the state alone",),
        )


def _may_delay_command(at: VerificationSystem, ways: Sequence[DownstreamPath]) -> bool:
    """Whether a node on the way may pass on a command too late, or changes it by a memory."""
    late = any(w.inner and w.inner[0] not in w.in_step for w in ways)
    on_the_way = [n for w in ways for n in w.in_step]
    keeping = [n for n in on_the_way if n.node is not None and n.node.locals]
    followed = all(n.in_thread for n in on_the_way)
    return late or not followed or not all(has_outputs_in_proof_state(at, n) for n in keeping)


def _ac_runs_between_steps(at: VerificationSystem) -> bool:
    """Whether AC publishes between the steps of a plant that moves in steps."""
    ac, step = at.system.components[at.module.ac], at.plants[0].period_ns
    return ac.period_ns % step != 0 or ac.phase_ns % step != 0


def _refuse_unbounded_axes(
    at: VerificationSystem, groups: tuple[Group, ...], kind: ProblemKind, diagnostics: Diagnostics
) -> None:
    """Reports R007 for an axis without ends if no proof of this kind of problem covers it."""
    symbol = at.module.symbol
    wrong = {
        "an SC that is to be found": symbol.synthesized,
        "several groups of axes": len(groups) > 1,
        "a plant that moves in steps (`next`)": kind != "flow",
        "`enters`": symbol.verify.enters is not None,
    }
    for reason in (reason for reason, is_so in wrong.items() if is_so):
        for group in groups:
            for axis in (a for a in group.axes if a.unbounded):
                diagnostics.error(
                    "R007",
                    f"`{axis.name}` is `open`, which a proof does not follow with {reason}",
                    group.span or symbol.span,
                    helps=(f"`{axis.name} in [l, u] / n`, with an end on either side",),
                )


def problem_of_sets(flat: System, module: Module) -> Problem:
    """The problem of a module proved by sets; raises `SoterError` R031 for any other module."""
    problem = extract(flat, module)
    require_proof_by_sets(problem)
    return problem


def require_proof_by_sets(problem: Problem) -> None:
    """Raises `SoterError` R031 for a module that is proved by induction or by tubes."""
    symbol = problem.module.symbol
    asked = symbol.verify.induction if symbol.rest is None else symbol.rest.span
    if asked is not None:
        how = "followed by tubes" if symbol.rest is not None else "proved by induction"
        diagnostics = Diagnostics()
        diagnostics.error(
            "R031",
            f"module `{problem.name}` is {how}: there are no sets of states",
            asked,
            notes=("monitors and advice rest on sets",),
        )
        raise SoterError(diagnostics.items)


def _refuse_clauses_of_other_proofs(module: Module, diagnostics: Diagnostics) -> None:
    verify = module.symbol.verify
    enters = (verify.enters,) if verify.enters is not None and not module.view else ()
    for word, clauses in (
        ("lemma", verify.lemmas),
        ("progress", verify.progress),
        ("enters", enters),
    ):
        if not clauses:
            continue
        diagnostics.error(
            "R031",
            f"`{word}` says nothing to this proof",
            clauses[0].span,
            notes=(HELP_FOR_VIEWS if word == "enters" else HELP_FOR_NODES,),
            helps=(f"leave `{word}` out",),
        )
    diagnostics.raise_errors()


def _state_ranges(groups: tuple[Group, ...], axes: Axes) -> tuple[Interval, ...]:
    """The range of each state, from its axis, else from its topic's set, else (-inf, inf)."""
    interval_by_state = {a.state: Interval(a.edges[0], a.edges[-1]) for g in groups for a in g.axes}
    every = range(len(axes.inputs.states))
    return tuple(interval_by_state.get(s) or Interval(*axes.topic_range_of_state(s)) for s in every)


def parameter_cases(problem: Problem) -> Iterator[tuple[int, ...]]:
    """Every combination of parameter values; a single empty combination without parameters."""
    yield from product(*(p.values for p in problem.parameters))


def _schemes_of_states(
    at: VerificationSystem, inputs: Inputs, turning: frozenset[int]
) -> tuple[tuple[float, int, int], ...]:
    """For each state the step of the plant's scheme in s, the scheme's order, the plant's number.

    The step is 0, for not covered, if SC may publish between two steps of the plant: in the
    simulator a command then acts on the whole step. It is also 0 if the scheme's error is not known
    (`grid/scheme_error.py`), and for a state whose axis wraps around, because sums of a state many
    turns off have larger rounding errors.
    """
    schemes = []
    for state, leaf in enumerate(inputs.states):
        c = at.system.components[leaf.owner]
        assert c.plant is not None
        scheme = SCHEMES[c.plant.method]
        fits = at.sc.period_ns % c.period_ns == 0 == at.sc.phase_ns % c.period_ns
        covered = fits and scheme.order == scheme.stages <= ORDER and state not in turning
        schemes.append((c.period_ns / c.substeps * NS if covered else 0.0, scheme.order, c.index))
    return tuple(schemes)


def _check_case_count(at: VerificationSystem, inputs: Inputs, diagnostics: Diagnostics) -> None:
    count = 1
    for parameter in inputs.parameters:
        count *= len(parameter.values)
    if count > CASES_MAX:
        symbol = at.module.symbol
        diagnostics.error(
            "R014",
            f"the parameters of the plants have {count} combinations",
            symbol.span,
            notes=(f"everything is proved for each of at most {CASES_MAX}",),
            helps=("give them smaller ranges",),
        )


def _commands_to_try(
    at: VerificationSystem, inputs: Inputs, diagnostics: Diagnostics, *, synthesize: bool
) -> tuple[tuple[float, ...], ...]:
    """The commands to try for each control: the declared commands, or the ends and the middle."""
    symbol = at.module.symbol
    calculator = Calculator(diagnostics, at.module.scope.params)
    declared: dict[tuple[int, tuple[str, ...]], tuple[float, ...]] = {}
    for c in symbol.verify.commands:
        values = {float(calculator.value(v, "a command") or 0.0) for v in c.values}
        index = at.sc.scope.topics[c.topic]
        for path, _ in leaves(c.topic.type):
            if path[: len(c.path)] == c.path:
                declared[index, path] = tuple(sorted(values))
    if not synthesize and not declared:
        return ()
    commands = []
    for leaf, interval in zip(inputs.controls, inputs.control_ranges, strict=True):
        middle = (
            0.0 if interval.low < 0.0 < interval.high else 0.5 * interval.low + 0.5 * interval.high
        )
        ends = tuple(sorted({interval.low, middle, interval.high}))
        commands.append(declared.get((leaf.owner, leaf.path), ends))
    return tuple(commands)
