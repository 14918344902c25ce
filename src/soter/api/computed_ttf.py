"""Computes the predicates that modules of a system leave out.

Purpose: `compute_ttf` computes `ttf` and `safer` of modules that have neither, when the files of
externs are there.
Non-goals: how they are computed (`verify/deploy/missing_predicates.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.system import System
    from soter.verify.deploy.missing_predicates import Known


def compute_ttf(
    system: System, known: Known | None = None, bound: Mapping[str, object] | None = None
) -> list[str]:
    """Computes `ttf` and `safer` for modules that lack both; returns a note on each.

    `known`: as `soter.verify.deploy.missing_predicates.complete` takes it. `bound`: targets of the
    externs, if all of them will be called; missing files are reported before the computation.
    """
    if all(m.symbol.ttf is not None for m in system.modules):
        return []
    if bound is not None:
        from soter.native.extern_bindings import bind  # noqa: PLC0415 - see `soter.api`
        from soter.simulate.externs.callables import require_files  # noqa: PLC0415 - the same

        require_files(bind(system, bound))
    from soter.verify.deploy.missing_predicates import complete as compute  # noqa: PLC0415 - needs NumPy

    return compute(system, known)
