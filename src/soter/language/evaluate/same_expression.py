"""Whether two expressions are written alike.

Purpose: `x - 1 < x - 1`: both sides have one value, whatever that is.
Non-goals: expressions that are equal and written otherwise.
"""

from __future__ import annotations

from typing import Any

from soter.language.model import typed as t
from soter.language.model.tree_walk import children, nodes


def same_expression(a: t.TypedExpr, b: t.TypedExpr) -> bool:
    """Whether two expressions are written alike, and so have one value where they are judged."""
    return _form(a) == _form(b)


def _form(e: Any) -> object:  # noqa: ANN401 - any part of an expression
    """What an expression is made of, but for where it stands.

    A choice, and what an extern answers, is alike to nothing.
    """
    if isinstance(e, t.TypedChoose) or (isinstance(e, t.TypedCall) and _may_differ(e.fun)):
        return object()
    own: list[object] = [type(e).__name__]
    for name in ("op", "name", "index", "instance"):
        value = getattr(e, name, None)
        own += [name, value] if isinstance(value, (str, int)) else []
    for name in ("variable", "topic", "param", "module", "fun"):
        value = getattr(e, name, None)
        own += [name, value if isinstance(value, str) else id(value)]
    if isinstance(e, t.Literal):
        own.append(repr(e.value))
    return (*own, *[_form(child) for child in children(e)])


def _may_differ(fun: t.FunSymbol) -> bool:
    """Whether two calls with equal arguments may differ: an extern may keep something."""
    todo, seen = [fun], {fun}
    while todo:
        body = todo.pop().body
        if body is None:
            return True
        for n in nodes(body):
            if isinstance(n, t.TypedChoose):
                return True
            if isinstance(n, t.TypedCall) and n.fun not in seen and not n.fun.prelude:
                seen.add(n.fun)
                todo.append(n.fun)
    return False
