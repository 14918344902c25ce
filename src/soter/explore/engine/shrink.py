"""Makes a violating execution smaller, greedily (docs/testing.md, "Shrinking").

Purpose: where the search for the least execution does not end, a `Shrinker` finds one that is
smaller than what was found: fewer steps, then fewer changes of actor, then fewer choices that are
not the default. It changes a part of the trace, and the engine follows that as far as possible
(`soter_explore_guided_execution.c`), many executions a second; one that violates the same property
and is smaller takes the trace's place.
Non-goals: the least one; that no smaller one exists is never claimed.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from soter.explore.engine.explorer_library import NOBODY, STEP, array_pointer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from soter.explore.engine.explorer_library import Engine, Steps
    from soter.explore.model.exploration_plan import PlannedActor

    Counts = npt.NDArray[np.uint32]
    Configurations = npt.NDArray[np.uint8]
    Change = Callable[[Steps], Steps]
    Cost = tuple[int, int, int, int, int]
    Numbers = npt.NDArray[np.int64]


STEPS, SKIPPED, BEGINS, EFFECT, BIRTH = range(5)
"""The kinds of steps, as in `soter_explore_internal.h`."""


@dataclass(frozen=True)
class GuidedRun:
    """An execution, and whether it ends in the wanted violation.

    `steps`: (n,); `unusual`: (n,), how many choices of each step are not the default (lateness and
    loss are choices); `configurations`: (n, configuration_size), each after its step.
    """

    steps: Steps
    unusual: Counts
    configurations: Configurations
    violates: bool


class Guided:
    """Runs the engine's system along a given trace, towards one violation."""

    def __init__(self, engine: Engine, seed: int, wanted: tuple[int, int]) -> None:
        self._engine = engine
        self._seed, self._wanted = seed & (2**64 - 1), wanted

    def execute_along(
        self, wish: Steps, limit: int, before: GuidedRun | None = None, begin: int = 0
    ) -> GuidedRun:
        """Executes up to `limit` steps along `wish`, (wishes,); the first `begin` from `before`."""
        begin = begin if before is not None else 0
        made = np.zeros(limit, dtype=STEP)
        unusual = np.zeros(limit, dtype=np.uint32)
        configurations = np.zeros((limit, self._engine.configuration_size), dtype=np.uint8)
        ffi, violates = self._engine.ffi, self._engine.ffi.new("bool *")
        start = ffi.NULL
        if before is not None and begin > 0:
            start = array_pointer(ffi, "void *", before.configurations[begin - 1])
        wish = np.ascontiguousarray(wish)
        guide = {
            "seed": self._seed,
            "wanted": {"what": self._wanted[0], "index": self._wanted[1]},
            "wish": array_pointer(ffi, "soter_trace_step *", wish),
            "length": len(wish),
            "begin": begin,
            "limit": limit,
            "from": start,
            "made": array_pointer(ffi, "soter_trace_step *", made),
            "unusual": array_pointer(ffi, "uint32_t *", unusual),
            "configurations": array_pointer(ffi, "void *", configurations),
        }
        lib, model = self._engine.lib, self._engine.model
        count = int(lib.soter_explore_guided(model, ffi.new("soter_guide *", guide), violates))
        if before is not None and begin > 0:
            made[:begin] = before.steps[:begin]
            unusual[:begin] = before.unusual[:begin]
            configurations[:begin] = before.configurations[:begin]
        return GuidedRun(made[:count], unusual[:count], configurations[:count], bool(violates[0]))


PARTS_MAX = (32, 2**32)
"""The most parts of a trace on which changes to choices are tried: in the first and last round."""
PICKS = 16
"""The most alternatives of a question that are tried."""


class ShrinkTimeoutError(Exception):
    """Raised when the time for shrinking is over."""


@dataclass(frozen=True)
class ShrinkResult:
    """The smallest of `tried` executions; `stopped`: "patience", "interrupted" or ""."""

    steps: Steps
    tried: int
    stopped: str


def execution_cost(made: GuidedRun) -> Cost:
    """The cost of an execution: steps, changes of actor, choices that are not the default, ties.

    Two numbers settle ties: how often the deployed order is left, and the sum of lateness in ns.
    """
    steps = made.steps[made.steps["actor"] != NOBODY]
    actor, time_ns = steps["actor"].astype(np.int64), steps["time"]
    changes = int(np.count_nonzero(np.diff(actor)))
    back = int(np.count_nonzero((np.diff(actor) < 0) & (np.diff(time_ns) == 0)))
    late = int((time_ns - steps["release"]).sum())
    return len(made.steps), changes, int(made.unusual.sum()), back, late


class Shrinker:
    """Shrinks one execution; `best` is the smallest one so far."""

    def __init__(
        self,
        guided: Guided,
        actors: Sequence[PlannedActor],
        *,
        deadline_s: float,
        look: Callable[[int, int], None] | None = None,
    ) -> None:
        """`deadline_s`: the time to end, on the clock `time.perf_counter`.

        `look` receives the number of executions tried, and the number of steps of the best one.
        """
        self._guided, self._look, self._deadline_s = guided, look, deadline_s
        self._period = np.array([a.period_ns for a in actors], dtype=np.int64)
        self._phase = np.array([a.phase_ns for a in actors], dtype=np.int64)
        self._window = np.array([a.window_ns for a in actors], dtype=np.int64)
        self._skips = np.array([a.skips > 0 for a in actors])
        self._overrun = np.array([a.overrun_ns for a in actors], dtype=np.int64)
        self._parts = PARTS_MAX[0]
        self.tried = 0

    def shrink(self, steps: Steps) -> ShrinkResult | None:
        """Shrinks `steps`, (n,), as long as that helps; None if they violate nothing."""
        self.best = self._guided.execute_along(steps, len(steps))
        self.cost = execution_cost(self.best)
        if not self.best.violates:
            return None
        stopped = ""
        try:
            for self._parts in PARTS_MAX:
                self._shrink_until_nothing_helps()
        except ShrinkTimeoutError:
            stopped = "patience"
        except KeyboardInterrupt:
            stopped = "interrupted"
        return ShrinkResult(self.best.steps, self.tried, stopped)

    def _shrink_until_nothing_helps(self) -> None:
        passes = (
            self._try_leaving_out,
            self._try_other_choices,
            self._try_orders,
            self._try_defaults,
            self._try_on_time,
        )
        before: Cost | None = None
        while before != self.cost:
            before = self.cost
            for try_changes in passes:
                try_changes()

    def _try_trace(self, wish: Steps, begin: int) -> bool:
        """Runs a trace that differs from step `begin` on; keeps it if it is the smallest so far."""
        if time.perf_counter() > self._deadline_s:
            raise ShrinkTimeoutError
        best = self.best
        begin = min(begin, len(best.steps) - 1)  # after the last step the execution is over
        made = self._guided.execute_along(wish, len(best.steps), best, begin)
        self.tried += 1
        if self._look is not None:
            self._look(self.tried, len(best.steps))
        if not made.violates:
            return False
        cost = execution_cost(made)
        if cost >= self.cost:
            return False
        self.best, self.cost = made, cost
        return True

    def _try_in_blocks(self, change: Change, finest: int = 1) -> None:
        """Tries a change on the trace, on its halves, and so on, down to parts of `finest` steps.

        `change` takes a part and returns it changed, with the same length.
        """
        size = len(self.best.steps)
        while size >= finest:
            begin = 0
            while begin < len(self.best.steps):
                part = self.best.steps[begin : begin + size]
                changed = change(part.copy())
                if changed.tobytes() != part.tobytes():
                    wish = self.best.steps.copy()
                    wish[begin : begin + size] = changed
                    self._try_trace(wish, begin)
                begin += size
            size = (size + 1) // 2 if size > 1 else 0

    # ------------------------------------------------------------ fewer steps

    def _try_leaving_out(self) -> None:
        """Tries to remove all releases in a span of time, and to move later releases forward."""
        least = int(self._period.min())
        span = max(self._end_ns() // 2, least)
        while span >= least:
            begin = 0
            while begin < self._end_ns():
                if not self._try_trace(*self._without_releases(begin, span)):
                    begin += span
            span = max(span // 2, least) if span > least else 0

    def _end_ns(self) -> int:
        return int(self.best.steps["time"].max(initial=0)) + 1

    def _without_releases(self, begin: int, span: int) -> tuple[Steps, int]:
        """The steps without releases in `span` ns from `begin`, and the first changed index."""
        steps = self.best.steps
        born = steps["actor"] == NOBODY
        actor = np.where(born, 0, steps["actor"])
        period, phase = self._period[actor], self._phase[actor]

        def releases(until: int) -> Numbers:
            before: Numbers = np.maximum(-((phase - until) // period), 0)
            return before

        first, last = releases(begin), releases(begin + span)
        number = (steps["release"] - phase) // period
        wish = steps.copy()
        shift = np.where(~born & (number >= last), (last - first) * period, 0)
        wish["release"] -= shift
        wish["time"] -= shift
        kept = born | (number < first) | (number >= last)
        changed = np.flatnonzero(~kept | (shift > 0))
        return wish[kept], int(changed[0]) if len(changed) else len(steps)

    def _try_other_choices(self) -> None:
        """Tries choices, losses and lateness that may reach the violation sooner."""
        finest = max(len(self.best.steps) // self._parts, 1)
        for change in self._choice_changes():
            self._try_in_blocks(change, finest)

    def _choice_changes(self) -> Iterator[Change]:
        """Yields changes: each answer to each question; each actor lost, late, first or last."""
        asked = self.best.steps["choice"][_choice_mask(self.best.steps)]
        kinds = zip(asked["stream"].tolist(), asked["count"].tolist(), strict=True)
        for stream, count in sorted(set(kinds)):
            for pick in range(min(count, PICKS)):
                yield _change_answers(stream, count, pick)
        for i in np.flatnonzero(self._skips).tolist():
            yield _change_to_lost(i)
        for i in np.flatnonzero((self._window > 0) | (self._overrun > 0)).tolist():
            yield self._change_to_late(i)
        for i in range(len(self._period)):
            yield _change_to_first(i)
            yield _change_to_last(i)

    def _change_to_late(self, actor: int) -> Change:
        """The change that makes every step of an actor as late and as long as is allowed."""
        window, overrun = self._window[actor], self._overrun[actor]

        def delay_steps(steps: Steps) -> Steps:
            of_actor = steps["actor"] == actor
            ends = of_actor & (steps["kind"] == EFFECT)
            steps["time"][of_actor] = steps["release"][of_actor] + window
            steps["time"][ends] += overrun
            return steps[np.argsort(steps["time"], kind="stable")]

        return delay_steps

    # ------------------------------------------------------------ fewer changes of actor

    def _try_orders(self) -> None:
        """Tries the deployed order, the order of releases, and orders with fewer actor changes."""
        self._try_in_blocks(_steps_in_deployed_order)
        self._try_in_blocks(_steps_by_release)
        self._try_in_blocks(_steps_by_continuing_actor, 2)
        i = 0
        while i < len(self.best.steps) - 2:
            self._try_side_by_side(i)
            i += 1

    def _try_side_by_side(self, first: int) -> None:
        """Tries to move step `first` and the next step of its actor side by side."""
        actor = self.best.steps["actor"]
        near = actor[first + 1 : first + 2 + 2 * len(self._period)]
        again = np.flatnonzero(near == actor[first])
        if len(again) == 0 or again[0] == 0:
            return
        again_at = first + 1 + int(again[0])
        if not self._try_trace(
            _steps_with_one_at_new_place(self.best.steps, again_at, first + 1), first
        ):
            self._try_trace(
                _steps_with_one_at_new_place(self.best.steps, first, again_at - 1), first
            )

    # ------------------------------------------------------------ fewer choices

    def _try_defaults(self) -> None:
        """Tries to set choices back to the default, block by block, then one by one."""
        self._try_in_blocks(_steps_with_default_picks)
        i = 0
        while i < len(self.best.steps):
            picks = self.best.steps["choice"]["pick"][i]
            places = np.flatnonzero(picks[: int(self.best.steps["choices"][i])])
            for place in places.tolist() if len(places) > 1 else ():
                if i < len(self.best.steps):
                    wish = self.best.steps.copy()
                    wish["choice"]["pick"][i, place] = 0
                    self._try_trace(wish, i)
            i += 1

    def _try_on_time(self) -> None:
        """Tries the trace without lost releases, and with every step at its release."""
        self._try_in_blocks(_steps_without_losses)
        self._try_in_blocks(_steps_at_releases)


def _choice_mask(steps: Steps) -> npt.NDArray[np.bool_]:
    """A mask of the entries of `choice` that each step uses: (n,) -> (n, CHOICES_MAX)."""
    room = steps["choice"].shape[1]
    mask: npt.NDArray[np.bool_] = np.arange(room)[None, :] < steps["choices"][:, None]
    return mask


# ---------------------------------------------------------------- changes of a part


def _change_answers(stream: int, count: int, pick: int) -> Change:
    """The change that picks the same alternative for every question of this stream."""

    def set_picks(steps: Steps) -> Steps:
        choice = steps["choice"]
        of_stream = (choice["stream"] == stream) & (choice["count"] == count) & _choice_mask(steps)
        choice["pick"][of_stream] = pick
        return steps

    return set_picks


def _change_to_lost(actor: int) -> Change:
    def lose_releases(steps: Steps) -> Steps:
        steps["kind"][(steps["actor"] == actor) & (steps["kind"] != EFFECT)] = SKIPPED
        return steps

    return lose_releases


def _steps_with_default_picks(steps: Steps) -> Steps:
    steps["choice"]["pick"] = 0
    return steps


def _steps_without_losses(steps: Steps) -> Steps:
    steps["kind"][steps["kind"] == SKIPPED] = STEPS
    return steps


def _steps_at_releases(steps: Steps) -> Steps:
    steps["time"] = steps["release"]
    return steps[np.argsort(steps["time"], kind="stable")]


def _change_to_first(actor: int) -> Change:
    """The change that makes an actor the first to step in every instant."""
    return lambda steps: steps[np.lexsort((steps["actor"] != actor, steps["time"]))]


def _change_to_last(actor: int) -> Change:
    return lambda steps: steps[np.lexsort((steps["actor"] == actor, steps["time"]))]


def _steps_in_deployed_order(steps: Steps) -> Steps:
    return steps[np.lexsort((steps["actor"], steps["time"]))]


def _steps_by_release(steps: Steps) -> Steps:
    return steps[np.lexsort((steps["actor"], steps["release"]))]


def _steps_by_continuing_actor(steps: Steps) -> Steps:
    """The steps, sorted in each instant so that actors continue into the next instant."""
    groups = np.split(np.arange(len(steps)), np.flatnonzero(np.diff(steps["time"])) + 1)
    actor = steps["actor"]
    order: list[int] = []
    for group, after in zip(groups, [*groups[1:], groups[0][:0]], strict=True):
        comes = set(actor[after].tolist())
        last = int(actor[order[-1]]) if order else -1
        sorted_steps = sorted(group.tolist(), key=lambda i: int(actor[i]))
        first = [i for i in sorted_steps if actor[i] == last]
        rest = [i for i in sorted_steps if actor[i] != last]
        goes_on = [i for i in rest if int(actor[i]) in comes][-1:]
        order += [*first, *(i for i in rest if i not in goes_on), *goes_on]
    return steps[order]


def _steps_with_one_at_new_place(steps: Steps, number: int, place: int) -> Steps:
    order = np.insert(np.delete(np.arange(len(steps)), number), place, number)
    return steps[order]
