"""Terms as rows over their inputs: the local linear models of what is not linear.

Purpose: `compile_lines`: a function from a form (`compile_terms.py`) to, for each output, a row of
coefficients over the inputs, a constant, a spread and a range, that hold all over the form.
Non-goals: what is done with them (`local_flow.py`, `local_chains.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from soter.recheck.compile_terms import Writer

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from flint import arb

    from soter.recheck.terms import Linear, Terms, Truth

    Lines = Callable[[tuple[arb, ...]], "tuple[arb, ...] | None"]

TAIL = 4
"""Behind the coefficients of a row: constant, spread, low, high."""


def compile_lines(
    terms: Terms,
    inputs: Sequence[int],
    symbols: int,
    outputs: Sequence[Linear],
    must: Sequence[Truth],
    boxes: Mapping[int, tuple[arb, arb]],
) -> Lines:
    """`form -> rows`, one after the other; None where something in `must` is not certain.

    For every point of the form: output = sum coefficient * input + constant +- spread, and the
    output lies in [low, high]. Inputs that the form does not describe range over `boxes`, or over
    their domains.
    """
    return _LineWriter(terms, inputs, symbols, boxes).lines_of(outputs, must)


class _LineWriter(Writer):
    """Writes the function."""

    def lines_of(self, outputs: Sequence[Linear], must: Sequence[Truth]) -> Lines:
        self._atoms([*outputs, *must])
        self._demand(must)
        found: list[str] = []
        for x in outputs:
            row, constant, spread = self._row(x)
            found += [self._code(row[a]) if a in row else "ZERO" for a in self.place]
            found += [constant or "ZERO", spread or "ZERO", *self._both_ranges(x)]
        self.lines.append(f"return ({', '.join(found)},)" if found else "return ()")
        compiled: Lines = self._function()
        return compiled

    def _both_ranges(self, x: Linear) -> tuple[str, str]:
        """The range by the row and that by the intervals of the atoms, whichever is tighter."""
        low, high = self._range(x)
        natural = self._natural(x, *self._parts(x))
        return (
            self._new(f"larger({low}, {natural[0]})"),
            self._new(f"smaller({high}, {natural[1]})"),
        )
