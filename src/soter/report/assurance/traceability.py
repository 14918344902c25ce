"""What stands behind a safety case, and what is still open, as plain data.

Purpose: `Traceability`: hazards and requirements with the properties that they lead to, and what is
open (`OpenItem`).
Non-goals: reading and following the rows (`api/assurance/hazard_traceability.py`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class TracedProperty:
    """A property that a hazard may trace to.

    `how`: "proof", "exploration" or "flights". `status`: "supported" or "undeveloped" as the `goal`
    of the case, if it has one; of flights that did not violate it "sampled", as they show nothing
    of others, and "not flown" without flights. `wanted`: somebody has to have a hazard for it.
    `hazards`: those that trace to it.
    """

    name: str
    how: str
    status: str
    goal: str = ""
    wanted: bool = True
    hazards: tuple[str, ...] = ()


@dataclass(frozen=True)
class TracedItem:
    """A hazard or a requirement; `properties`: what it leads to, over requirements, too.

    It is "supported" where all of these are that are no flights, and there is one, and all the
    requirements that it traces to; else "open".
    """

    kind: str
    id: str
    text: str
    traces_to: tuple[str, ...]
    properties: tuple[str, ...]
    status: str


@dataclass(frozen=True)
class OpenItem:
    """What nobody has closed: of a "hazard", "requirement", "property" or "assumption"."""

    kind: str
    id: str
    why: str


@dataclass(frozen=True)
class Traceability:
    """`path`, `sha256`: of the file that was given, or "". `open`: all that is open."""

    path: str = ""
    sha256: str = ""
    items: tuple[TracedItem, ...] = ()
    properties: tuple[TracedProperty, ...] = ()
    open: tuple[OpenItem, ...] = ()

    @property
    def covered(self) -> bool:
        """Whether every hazard and every requirement is supported."""
        return all(item.status == "supported" for item in self.items)

    def to_json(self) -> dict[str, object]:
        """As in docs/json.md."""
        return asdict(self) | {"path": self.path or None, "sha256": self.sha256 or None}
