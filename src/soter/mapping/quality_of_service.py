"""What a mapping says of how the messages of a topic go: the key `qos`.

Purpose: three policies that decide whether a reader and a writer of DDS meet, and what is kept.
Non-goals: what they mean to a middleware (`targets/dds/`); the other policies of DDS.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from soter.mapping.topic_mapping import QualityOfService

if TYPE_CHECKING:
    from collections.abc import Mapping

    from soter.mapping.mapping_errors import MappingProblems

KEYS = ("reliability", "durability", "depth")
RELIABILITY, DURABILITY = ("best_effort", "reliable"), ("volatile", "transient_local")
DEPTH_MAX = 1_000_000
ALL = "all"


def read_qos(given: Mapping[str, Any], problems: MappingProblems, where: str) -> QualityOfService:
    """The record; of no use where problems were added."""
    problems.only(given, KEYS, where)
    return QualityOfService(
        _one_of(given, "reliability", RELIABILITY, problems, where),
        _one_of(given, "durability", DURABILITY, problems, where),
        _depth(given.get("depth"), problems, where),
    )


def _one_of(
    given: Mapping[str, Any],
    key: str,
    known: tuple[str, ...],
    problems: MappingProblems,
    where: str,
) -> Any:  # noqa: ANN401 - one of the words, which mypy cannot see
    said = given.get(key)
    if said is not None and said not in known:
        problems.add(f"`{key}` in {where} is {' or '.join(known)}, not {said!r}")
        return None
    return said


def _depth(said: object, problems: MappingProblems, where: str) -> int | None:
    if said is None:
        return None
    if said == ALL:
        return 0
    if isinstance(said, int) and not isinstance(said, bool) and 1 <= said <= DEPTH_MAX:
        return said
    problems.add(f'`depth` in {where} is a number from 1 to {DEPTH_MAX}, or "{ALL}", not {said!r}')
    return None
