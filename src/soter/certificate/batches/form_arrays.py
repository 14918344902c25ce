"""The forms of many sets: those of boxes, and back.

Purpose: what `compile_terms.form_of_box` is for one box; the boxes of forms; some of many forms.
Non-goals: what steps make of forms.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from soter.certificate.batches.ball_arrays import BallArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from soter.certificate.batches.ball_arrays import Floats

Forms: TypeAlias = tuple[BallArray, ...]
"""One form of many sets: each of its numbers is an array."""


def of_boxes(box: Sequence[tuple[Floats, Floats]]) -> Forms:
    """The forms of boxes, (boxes,) by axis, each axis with a symbol of its own."""
    ends = [(BallArray(low), BallArray(high)) for low, high in box]
    half, none = BallArray.of(0.5), BallArray.of(0.0)
    radii = [(high - low) * half for low, high in ends]
    n = len(ends)
    form = [end for interval in ends for end in interval]
    form += [(low + high) * half for low, high in ends]
    form += [radii[i] if i == k else none for i in range(n) for k in range(n)]
    return (*form, *[none] * n)


def box_of(form: Forms, n: int) -> list[Floats]:
    """The boxes of the first n states of forms, their ends (boxes,)."""
    return [end for i in range(n) for end in (form[2 * i].lower(), form[2 * i + 1].upper())]


def taken(form: Forms, index: NDArray[np.intp]) -> Forms:
    """The forms of some boxes, (index,)."""
    count = max((x.centre.shape[-1] for x in form), default=1)
    if index.size == count and np.array_equal(index, np.arange(count)):
        return form
    return tuple(x.taken(index) for x in form)


def behind(forms: Sequence[Forms], counts: Sequence[int]) -> Forms:
    """The forms of so many sets each, one behind the other."""
    none = np.zeros(1)
    joined = []
    for parts in zip(*forms, strict=True):
        radii = [none if x.radius is None else x.radius for x in parts]
        joined.append(
            BallArray(
                np.concatenate(
                    [np.broadcast_to(x.centre, c) for x, c in zip(parts, counts, strict=True)]
                ),
                np.concatenate([np.broadcast_to(r, c) for r, c in zip(radii, counts, strict=True)]),
            )
        )
    return tuple(joined)
