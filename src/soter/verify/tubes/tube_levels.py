"""The predicates of a DM that decides by tubes, which call the check.

Purpose: `TubeLevels` writes them: `safer` where an estimate is `good`, else `ttf`.
Non-goals: the check (`tube_check.py`), putting predicates into a module
(`deploy/missing_predicates.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from soter.language.model import typed as t
from soter.language.model.types import FLOAT, INT, leaves
from soter.verify.deploy.level_tables import LevelTable, estimate_leaves
from soter.verify.tubes.generated_functions import functions_of
from soter.verify.tubes.problem import TubeProblem

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from soter.language.model.system import Topic
    from soter.language.model.typed import FunSymbol
    from soter.verify.deploy.level_tables import Writer
    from soter.verify.deploy.shield_tables import ShieldWriter
    from soter.verify.problem.problem import Interval, Problem
    from soter.verify.tubes.tube_check import TubeCheck


IN_S0 = 2


@dataclass(frozen=True, eq=False)
class TubeLevels(LevelTable):
    """Levels of estimates: 2 if the check follows SC from the estimate to rest, otherwise 0."""

    states: tuple[int, ...]
    text: str
    maps: int = 0
    """The number of map values that the function takes after those of the estimate."""
    rest: object = None
    """The constants of the check, as a certificate has them (`rest_entry`)."""
    two_levels = True

    @classmethod
    def of_check(cls, check: TubeCheck, ways: Mapping[int, Interval], rest: object) -> TubeLevels:
        """The levels that a check gives; `ways` is Y, the range of each state as shown offline."""
        return cls(
            tuple(check.states), check.text_in_flight(ways), len(check.problem.map_leaves), rest
        )

    @cached_property
    def functions_by_name(self) -> Mapping[str, FunSymbol]:
        """The functions of the check in flight, by name."""
        return functions_of(self.text)

    def function(self, w: Writer, name: str) -> FunSymbol:
        """The function `fun level(x0: float, ...): int`."""
        good = self.functions_by_name["good"]
        pairs = (("x", len(self.states)), ("m", self.maps))
        inputs = [[w.variable(f"{a}{k}", "parameter", FLOAT) for k in range(n)] for a, n in pairs]
        found = w.call_of(good, *(w.floats([w.read(x) for x in of]) for of in inputs if of))
        answer = t.Conditional(INT, w.span, found, w.integer(IN_S0), w.integer(0))
        return w.function(name, tuple(x for of in inputs for x in of), [w.result(answer)])

    def more_arguments(self, w: Writer, problem: Problem) -> list[t.TypedExpr]:
        """An expression for each number of the maps that `safe` reads."""
        assert isinstance(problem, TubeProblem)
        at = {index: symbol for symbol, index in problem.module.scope.topics.items()}
        paths = {i: [p for p, _ in leaves(at[i].type)] for i, _ in problem.map_leaves}
        return [w.leaf_of(at[i], paths[i][k]) for i, k in problem.map_leaves]

    def judged_command(self, w: ShieldWriter) -> t.TypedExpr:
        """The expression that SC brings the plant to rest after all commands that may act."""
        held_numbers = [w.held_command(k) for k in range(len(w.problem.controls))]
        return self._call_about_commands(w, "judged", w.floats(held_numbers))

    def moved_command(self, w: ShieldWriter, proposed: Topic) -> t.TypedExpr:
        """The expression for `Shield.moved`; `proposed` is a topic with AC's and SC's commands."""
        wanted: t.TypedExpr = t.TopicRead(proposed.type, w.span, proposed.symbol)
        if (tried := w.problem.module.symbol.candidates) is not None:
            more = [w.leaf_of(tried, path) for path, _ in leaves(tried.type)]
            both = [w.element_at(wanted, w.integer(k)) for k in range(len(proposed.default))]
            wanted = w.floats([*both, *more])
        return self._call_about_commands(w, "toward", wanted)

    def _call_about_commands(
        self, w: ShieldWriter, name: str, commands: t.TypedExpr
    ) -> t.TypedExpr:
        """A call of `name` with commands, the estimate, and the times of earlier commands."""
        at, maps = w.floats(estimate_leaves(w, w.problem, self)), self.more_arguments(w, w.problem)
        arguments = [w.floats(maps)] if maps else []
        return w.call_of(
            self.functions_by_name[name], at, commands, w.end_times(), w.window_start(), *arguments
        )

    def entry(self, names: Sequence[str], stem: str, files: dict[str, bytes]) -> dict[str, object]:
        """The constants of the check for a certificate; the program determines the check itself."""
        del names, stem, files
        return {"rest": self.rest}
