"""All modules together: who keeps what each takes for granted (docs/proof-modules.md, Composition).

Purpose: `rows_of`: lines of a table, the same for the terminal and the page.
Non-goals: verdicts (`claims/results.py`), finding out (`scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.verify.claims.results import VerifyReport
    from soter.verify.problem.assumption import ScopeGuarantee


@dataclass(frozen=True)
class ComposedAssumption:
    """`module` takes `what` for granted; `why` it may, and whether that is `open`.

    `promised`: another module should guarantee it.
    """

    module: str
    what: str
    why: str
    open: bool
    promised: bool = False


def rows_of(report: VerifyReport) -> list[ComposedAssumption]:
    """Who keeps what; a module that is proved in views stands there once."""
    views = {m.name: m.problem.view for m in report.modules}
    verdicts = {m.name.removesuffix(f" as {views[m.name]}"): m.verdict for m in report.modules}
    rows = []
    for g in report.coverage.guarantees:
        module = g.module.removesuffix(f" as {views.get(g.module, '')}")
        rows.append(ComposedAssumption(module, g.what, *_why(g, verdicts)))
    return list(dict.fromkeys(rows))


def _why(g: ScopeGuarantee, verdicts: dict[str, str]) -> tuple[str, bool, bool]:
    if g.how == "guaranteed":
        verdict = verdicts.get(g.by, "not verified here")
        return f"`safe` of {g.by}: {verdict}", verdict != "proved", True
    if g.how == "published":
        verdict = verdicts.get(g.by, "not verified here")
        return f"its plant can publish no more, by {g.by}: {verdict}", verdict != "proved", True
    if g.how == "assumed":
        return f"assumed of {g.by}", True, False
    return f"{g.how}: {g.by}", False, False
