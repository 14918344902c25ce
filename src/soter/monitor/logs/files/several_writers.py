"""Who wrote on each channel of one file of a log.

Purpose: where several nodes, or several channels of one name, give a topic its values, that is
told with how many each gave, as their values are read as one stream.
Non-goals: sources of a mapping, of which each has a channel (`typed_samples.py`).
"""

from __future__ import annotations

from collections import Counter

SHOWN = 8
"""So many writers of a channel are named."""


class Writers:
    """What was met so far, channel by channel."""

    def __init__(self) -> None:
        self._messages: dict[str, Counter[str]] = {}
        self._last: dict[str, str] = {}
        self._changes: Counter[str] = Counter()
        self._offered: dict[str, int] = {}

    def note(self, channel: str, writer: str) -> None:
        """A message; `writer`: a node, or what else tells its writers apart."""
        self._messages.setdefault(channel, Counter())[writer] += 1
        self._changes[channel] += self._last.setdefault(channel, writer) != writer
        self._last[channel] = writer

    def offer(self, channel: str, publishers: int) -> None:
        """How many publishers a bag of ROS 2 lists for a channel; it does not name them."""
        self._offered[channel] = max(publishers, self._offered.get(channel, 0))

    @property
    def notes(self) -> list[str]:
        """What is told of channels with several writers."""
        told = []
        for channel, messages in self._messages.items():
            if len(messages) < 2:
                continue
            first = [f"{name[:80]} ({n:,})" for name, n in messages.most_common(SHOWN)]
            more = f" and {len(messages) - SHOWN:,} more" if len(messages) > SHOWN else ""
            changes = self._changes[channel]
            turns = f"{changes:,} change{'s'[: changes > 1]} from one to another"
            told.append(
                f"`{channel}` has {len(messages):,} writers, which are read as one stream: "
                f"{', '.join(first)}{more}, {turns}; a `where` of the topic chooses messages"
            )
        told += [
            f"{n:,} publishers offered `{channel}`, which are read as one stream: the bag does not "
            "say whose each message is"
            for channel, n in self._offered.items()
            if n > 1 and len(self._messages.get(channel, ())) < 2
        ]
        return told
