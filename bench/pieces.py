"""Long benchmarks in pieces: each is written down as it is done, and not done again.

Purpose: a run that is stopped loses no more than a piece, and says on the way how far it is.
Non-goals: what a piece is; whether the program is still the same (it is part of the key).
"""

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


class Pieces:
    """What is done already; `path` None: nothing is kept. `about` stands in every key."""

    def __init__(self, path: Path | None, about: str) -> None:
        self._path = path
        self._about = about
        self._done: dict[str, Any] = {}
        if path is not None and path.exists():
            for line in path.read_text(encoding="utf-8").splitlines():
                try:
                    record = json.loads(line)
                except ValueError:
                    continue  # the line at which it was stopped
                self._done[record["key"]] = record["value"]

    def piece(self, name: str, make: Callable[[], Any]) -> Any:  # noqa: ANN401 - as JSON has it
        """What `make` gives, now or when it was made; anything that JSON can hold."""
        key = f"{self._about} {name}"
        if key not in self._done:
            self._done[key] = json.loads(json.dumps(make()))
            if self._path is not None:
                with self._path.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps({"key": key, "value": self._done[key]}) + "\n")
            self.say(name)
        return self._done[key]

    def has(self, name: str) -> bool:
        """Whether a piece was made already."""
        return f"{self._about} {name}" in self._done

    @staticmethod
    def say(text: str) -> None:
        """Progress, beside the result."""
        print(f"  done: {text}", file=sys.stderr, flush=True)
