"""The forms that a chain hands from hold to hold, taken apart and put together again.

Purpose: a *form* is a flat tuple of numbers that describes a set of states and the commands that
still act (`terms/compile_terms.py`). `FormLayout.take_apart` makes of it the rows z of a hold (the
head of `flow_chains.py` says what z is), `FormLayout.put_together` the form at the end of that
hold. Between the two `StateRows` and `CommandRows` are states and commands as rows over z.
Non-goals: what happens in a hold (`flow_chains.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from soter.certificate.terms.linear_enclosures import HALF, ONE, ZERO
from soter.certificate.terms.straight_line import (
    apply_operation,
    bound_of_dot,
    dot,
    product,
    total,
    unit_rows,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from soter.certificate.grid.flow_enclosures import Interval
    from soter.certificate.terms.straight_line import Rows

    Form = tuple[Any, ...]


@dataclass(eq=False)
class OpenedForm:
    """A form in parts. `ranges` are of the states, then of old commands, the latest first."""

    ranges: list[Interval]
    z: Rows
    memories: Rows
    """For each old command its coefficients on the betas of the states."""

    def rows(self, first: int, count: int) -> Rows:
        """Rows over z that pick `count` entries of z, starting at `first`."""
        return unit_rows(count, width=len(self.z), first=first)


@dataclass(eq=False)
class StateRows:
    """States at one instant: rows over z, how far states may be off them (`rest`), and ranges."""

    rows: Rows
    rest: list[Any]
    box: list[Interval]


@dataclass(eq=False)
class CommandRows:
    """Commands: rows over z, their ranges, and how far each command may ever be off its row."""

    rows: Rows
    ranges: list[Interval]
    radii: Sequence[Any] = ()


@dataclass(frozen=True)
class FormLayout:
    """The layout of a form's numbers: `n` states and the `depth` latest of `q` commands."""

    n: int
    q: int
    depth: int

    def form_length(self, *, fresh: bool) -> int:
        """How many numbers a form has; `fresh`: a form of states alone, without commands."""
        n, memories = self.n, 0 if fresh else self.depth * self.q
        return (4 + n) * (n + memories) + n * memories

    def take_apart(self, form: Form, before: list[Interval] | None) -> OpenedForm:
        """Takes a form apart; `before`: ranges of old commands if the form has no commands."""
        n, q = self.n, self.q
        count = n + self.depth * q
        boxes = n if before is not None else count
        ranges = [(form[2 * i], form[2 * i + 1]) for i in range(boxes)]
        centres, rests = form[2 * boxes :], form[(3 + n) * boxes :]
        symbols = [form[3 * boxes + i * n : 3 * boxes + (i + 1) * n] for i in range(boxes)]
        common = [form[(4 + n) * boxes + k * n :][:n] for k in range(boxes - n)]
        z = [[ZERO] * (1 + n + count + q) for _ in range(count + q)]
        z.append([ONE, *[ZERO] * (n + count + q)])
        for i in range(boxes):
            z[i][: 1 + n] = centres[i], *symbols[i]
            z[i][1 + n + i] = rests[i]
            if i >= n:
                z[i][1 + n : 1 + 2 * n] = (a * rests[j] for j, a in enumerate(common[i - n]))
        for k, (low, high) in enumerate(before or ()):
            z[n + k][0], z[n + k][1 + 2 * n + k] = (low + high) * HALF, (high - low) * HALF
            common.append((ZERO,) * n)
        return OpenedForm([*ranges, *(before or ())], z, list(map(list, common)))

    def states_at_begin(self, start: OpenedForm) -> StateRows:
        """The states at the beginning of a hold, as entries of z."""
        return StateRows(start.rows(0, self.n), [ZERO] * self.n, list(start.ranges[: self.n]))

    def put_together(self, start: OpenedForm, way: StateRows, new: CommandRows) -> Form:
        """Makes the form at the end of a hold from the states `way` there and the command `new`."""
        n, old = self.n, (self.depth - 1) * self.q
        spread, turned = (
            product(way.rows, start.z),
            self._coefficients_on_old_betas(start, way.rows),
        )
        lines = [
            [*row[: 1 + n], absolute_sum(row[1 + n :]) + rest]
            for row, rest in zip(spread, way.rest, strict=True)
        ]
        ranges, common = list(way.box), []
        if self.depth:
            ranges += [*new.ranges, *start.ranges[n : n + old]]
            answers = self._coefficients_on_old_betas(start, new.rows)
            commands = zip(product(new.rows, start.z), answers, strict=True)
            kept = zip(start.z[n : n + old], start.memories[:old], strict=True)
            for values, betas in (*commands, *kept):
                line, a = self._command_on_new_betas(values, betas, turned, spread, way)
                lines.append(line)
                common.append(a)
        return (
            *(end for interval in ranges for end in interval),
            *(line[0] for line in lines),
            *(x for line in lines for x in line[1 : 1 + n]),
            *(apply_operation("magnitude", line[-1]) for line in lines),
            *(x for a in common for x in a),
        )

    def _coefficients_on_old_betas(self, start: OpenedForm, rows: Rows) -> Rows:
        """The coefficients of rows on the states' old betas, directly and through old commands.

        No claim rests on them: they only make `a` in `_command_on_new_betas` a good choice.
        """
        shared = [*unit_rows(self.n), *start.memories]
        return product([row[: len(shared)] for row in rows], shared)

    def _command_on_new_betas(
        self, values: Sequence[Any], old: Sequence[Any], turned: Rows, spread: Rows, way: StateRows
    ) -> tuple[list[Any], list[Any]]:
        """The line of a command over the betas of the new states, and its coefficients on them.

        With old betas B beta: states R B beta + noise, command S B beta + rest; S in `old`, R in
        `turned`. For any row a the command is a (states) + (S - a R) B beta - a noise + rest. The
        row that is used here, a = S (2 - R), is nearly S R^-1.
        """
        n = self.n
        a = [
            apply_operation("mid", 2 * old[i] - dot(old, [row[i] for row in turned]))
            for i in range(n)
        ]
        rest = bound_of_dot(a, way.rest)
        left = (x - dot(a, column) for x, *column in zip(values, *spread, strict=True))
        return [*values[: 1 + n], rest + absolute_sum(list(left)[1 + n :])], a


# ---------------------------------------------------------------- helpers


def absolute_sum(row: Sequence[Any]) -> Any:  # noqa: ANN401  a ball or a value
    """The sum of the absolute values of a row."""
    return total(map(abs, row))


def interval_hull(intervals: Sequence[Interval]) -> Interval:
    """The smallest interval around all intervals."""
    low, high = intervals[0]
    for a, b in intervals[1:]:
        low, high = apply_operation("min", low, a), apply_operation("max", high, b)
    return low, high
