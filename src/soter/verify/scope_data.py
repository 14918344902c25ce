"""What a verification is about, as plain data.

Purpose: `VerificationScope` and `ScopeGuarantee`, of which reports are made.
Non-goals: finding out (`scope.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from soter.language.model.types import Value


@dataclass(frozen=True)
class ScopeGuarantee:
    """What a module takes for granted of somebody else, and why it may.

    `how`: "enforced" (the language lets no other value arrive), "declared" (a range of the world,
    printed as an assumption), "guaranteed" (a part of the `safe` of the module `by`, if that is
    proved), "published" (the proof of the module `by` is about the plant that drives it, if that is
    proved) or "assumed".
    """

    module: str
    what: str
    by: str
    how: str


@dataclass(frozen=True)
class VerificationScope:
    """`also`: modules of other systems that pose the same problem; `rest`: what is not covered."""

    also: tuple[str, ...] = ()
    rest: tuple[str, ...] = ()
    params: tuple[tuple[str, Value], ...] = ()
    """Every parameter of the program with the value that this is about."""
    guarantees: tuple[ScopeGuarantee, ...] = ()
