"""Whether tests of one system, each with some of it replaced, say something of all of it.

Purpose: the theorem of docs/testing.md ("Contracts") applied by code: what has to be so of the
tests, that it is, and what it says of the system that nobody searched; or why it cannot be said.
A contract is judged as its owner steps, so contracts may rely on each other in a circle. What a
node or a plant stands for is assumed, and told, unless nobody hears it.
Non-goals: verdicts of single tests; systems whose tests have no contract in place of anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.explore import contract_use
from soter.explore.results import EXHAUSTED
from soter.explore.trace.allowed_steps import plan_of
from soter.language.check.expressions.field import listed
from soter.language.model.durations import show_ns

if TYPE_CHECKING:
    from collections.abc import Hashable, Iterable, Iterator

    from soter.explore.results import TestResult
    from soter.language.model.typed import TestSymbol


@dataclass(frozen=True)
class WholeByParts:
    """What tests of one system say of all of it.

    `horizon_ns`: up to then. `held`: what is replaced by its contract, and the tests in which it
    runs as it is. `assumed`: (test, what, by whom) that stands for something and is heard.
    `tried`: (test, values of a stand-in beside which nothing was tried). `missing`: why nothing is
    said of the whole; empty where it is.
    """

    system: str
    tests: tuple[str, ...]
    horizon_ns: int
    held: tuple[tuple[str, tuple[str, ...]], ...]
    assumed: tuple[tuple[str, str, str], ...]
    tried: tuple[tuple[str, str], ...]
    missing: tuple[str, ...]

    @property
    def text(self) -> str:
        """A sentence for people."""
        if self.missing:
            return f"{self.system} is not shown as a whole: {'; '.join(self.missing)}"
        until = show_ns(self.horizon_ns)
        said = (
            f"{self.system} holds as a whole, by parts, up to {until}: no execution of it breaks a "
            f"contract or a property of {listed(self.tests)}, as whatever a contract stands for "
            "there runs as it is in another of them"
        )
        by_test: dict[tuple[str, str], list[str]] = {}
        for test, what, by in self.assumed:
            by_test.setdefault((what, by), []).append(test)
        means = [
            f"{what} is what {by} may do ({', '.join(tests)})"
            for (what, by), tests in by_test.items()
        ]
        means += [f"values beside {text} do no harm in {test}" for test, text in self.tried]
        if not means:
            return f"{said}. Nothing is assumed of its parts"
        return f"{said}. Assumed: {'; '.join(means)}"


def wholes(results: Iterable[TestResult]) -> tuple[WholeByParts, ...]:
    """One for each system of which some test replaces something by its contract."""
    alike: dict[Hashable, list[TestResult]] = {}
    for result in results:
        symbol = result.system.program.tests.get(result.name)
        if symbol is not None:
            alike.setdefault(_circumstances(result, symbol), []).append(result)
    return tuple([_whole(group) for group in alike.values() if any(r.contracts for r in group)])


def _circumstances(result: TestResult, symbol: TestSymbol) -> Hashable:
    """What has to be the same in all parts: executions are compared step by step."""
    plan, system = plan_of(result.system), result.system
    names = [c.name for c in system.components]
    faults = {(names[f.component], f.kind, f.by_ns, f.at_most, f.least_ns) for f in plan.faults}
    inputs = {(system.topics[d.topic].name, d.every_ns, repr(d.values)) for d in system.inputs}
    return (
        system.program.sha256,
        symbol.system.name,
        frozenset((name, repr(value)) for name, value in system.params.items()),
        plan.skew_ns,
        plan.quantum_ns,
        plan.ordered,
        frozenset(faults),
        frozenset(inputs),
    )


def _whole(group: list[TestResult]) -> WholeByParts:
    names = {r.name for r in group}
    held: dict[str, set[str]] = {}
    for result in group:
        for of, tests in result.contracts.items():
            held.setdefault(of, set()).update(names.intersection(tests))
    as_it_is = {
        of: tuple(r.name for r in group if r.name in tests and of not in dict(r.stands_for))
        for of, tests in held.items()
    }
    return WholeByParts(
        system=group[0].system.name if group else "",
        tests=tuple(r.name for r in group),
        horizon_ns=min(plan_of(r.system).horizon_ns for r in group),
        held=tuple(sorted(as_it_is.items())),
        assumed=tuple((r.name, what, by) for r in group for what, by in r.stands_for),
        tried=tuple((r.name, text) for r in group for text in contract_use.tried(r.system)),
        missing=tuple(_missing(group, as_it_is)),
    )


def _missing(group: list[TestResult], as_it_is: dict[str, tuple[str, ...]]) -> Iterator[str]:
    """What is not so of the tests."""
    for result in group:
        if result.verdict != EXHAUSTED:
            yield f"{result.name} is not exhausted and clean"
    for of, tests in as_it_is.items():
        if not tests:
            yield f"{of} is replaced by its contract and runs as it is in no test that is asked"
