"""`{ nearest = "distance", most = 0.45, unseen = 2 }`: a leaf that is what is nearest in a scan.

Purpose: the one reduction of a mapping, because no topic can hold what a LaserScan is: rays in any
number, of which NaN, infinity and 0 each mean something.
Non-goals: the reduction itself (`runtime/bridge/soter_scan.hpp`), other leaves
(`leaf_mapping_parser.py`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.language.model.types import FloatType
from soter.mapping.mapping_errors import is_number
from soter.mapping.topic_mapping import NearestSource

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.language.model.types import Type
    from soter.mapping.mapping_errors import MappingProblems
    from soter.mapping.message_types import MessageType

NEAREST_KEYS = ("nearest", "most", "unseen")
SCAN = "sensor_msgs/LaserScan"
UNSEEN_MAX = 1000


def nearest_source(
    name: str,
    t: Type,
    what: Mapping[str, Any],
    message: MessageType | None,
    problems: MappingProblems,
) -> NearestSource | None:
    """The leaf `name`; None, and told, where it is none."""
    before = len(problems.told)
    problems.only(what, NEAREST_KEYS, f"`{name}`")
    kind, most, unseen = what["nearest"], what.get("most", 0), what.get("unseen", 0)
    if kind not in ("distance", "bearing"):
        problems.add(f"`nearest` of `{name}` is distance or bearing, not {kind!r}")
    if not is_number(most) or most <= 0:
        problems.add(f"`{name}` needs `most`, in m: what is farther counts as so far")
    if not isinstance(unseen, int) or isinstance(unseen, bool) or not 0 <= unseen <= UNSEEN_MAX:
        problems.add(
            f"`unseen` of `{name}` is no number of rays from 0 to {UNSEEN_MAX}: {unseen!r}"
        )
    if not isinstance(t, FloatType):
        problems.add(f"`{name}` is `{t}`, and what is nearest in a scan a float")
    if message is None or message.ros1 != SCAN:
        problems.add(f"`{name}` is what is nearest in a scan, so its `type` is {SCAN}")
    if len(problems.told) > before:
        return None
    return NearestSource(kind, float(most), unseen)
