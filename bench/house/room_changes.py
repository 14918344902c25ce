"""How often `soter verify --cert` of the cart changes rooms, and which rooms call each other.

    .venv/bin/python bench/house/room_changes.py [--calls]

Purpose: runs the command in this process without a cache, and watches every call of its main
thread. A room is a folder below src/soter, such as `verify/grid`. A file of Python is entered when
one of its functions is first called, also while a module is imported. A change of room is a file,
in the order in which they are entered, that lies in another room than the file before it. Two rooms
are called both ways if functions, lambdas or comprehensions of each call some of the other
directly. Who goes through a generator expression of another room calls it, too; the last figure
leaves that out. `--calls` lists the rarer direction of each pair. The judge of issue 77 did not
write down how 85 changes and 17 pairs were counted on 4ba1a17: this counts 83 and 16 there.
Non-goals: judging which calls are right; imports (`.importlinter`).
"""

from __future__ import annotations

import argparse
import contextlib
import inspect
import io
import os
import sys
import tempfile
from collections import Counter, defaultdict
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[2]
SRC = ROOT / "src" / "soter"
CART = ROOT / "examples" / "wall" / "cart.soter"

if TYPE_CHECKING:
    from types import CodeType, FrameType

    Place = tuple[str, str]  # a file below src/soter, and the qualified name of its function


@cache
def place_of(code: CodeType) -> Place | None:
    """Where a piece of code stands; None outside of the files of Python of Soter."""
    path = Path(code.co_filename)
    if path.suffix != ".py" or SRC not in path.parents:
        return None
    return path.relative_to(SRC).as_posix(), getattr(code, "co_qualname", code.co_name)


def room_of(place: Place) -> str:
    """The folder below src/soter in which a file lies."""
    return Path(place[0]).parent.as_posix()


def watched() -> tuple[list[Place], Counter[tuple[Place, Place]]]:
    """The first function called of each file, in this order, and all calls between rooms."""
    entered: dict[str, Place] = {}
    calls: Counter[tuple[Place, Place]] = Counter()

    def see(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or (called := place_of(code)) is None:
            return
        if code.co_flags & inspect.CO_OPTIMIZED and not code.co_name.startswith("<"):
            entered.setdefault(called[0], called)
        caller = place_of(frame.f_back.f_code) if frame.f_back else None
        if caller and room_of(caller) != room_of(called):
            calls[caller, called] += 1

    with tempfile.TemporaryDirectory() as at, contextlib.redirect_stdout(io.StringIO()):
        os.environ |= {"XDG_CACHE_HOME": at, "SOTER_CACHE": f"{at}/cache"}
        sys.setprofile(see)
        from soter.cli.main import main as soter  # noqa: PLC0415 - imports are watched, too

        code = soter(["verify", str(CART), "--cert", f"{at}/certificate"])
        sys.setprofile(None)
    assert code == 0, "the cart is proved"
    return list(entered.values()), calls


def called_both_ways(calls: Counter[tuple[Place, Place]]) -> dict[tuple[str, str], list[str]]:
    """Each pair of rooms that call each other -> the calls of the direction that has fewer."""
    between: dict[tuple[str, str], list[str]] = defaultdict(list)
    for (caller, called), n in calls.items():
        words = f"{':'.join(caller)} -> {':'.join(called)} ({n})"
        between[room_of(caller), room_of(called)].append(words)
    pairs = [(a, b) for a, b in between if a < b and (b, a) in between]
    return {(a, b): min(between[a, b], between[b, a], key=len) for a, b in sorted(pairs)}


def main() -> int:
    """Print the figures, and with `--calls` what is called both ways."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--calls", action="store_true", help="list what is called both ways")
    asked = parser.parse_args()
    entered, calls = watched()
    rooms = [room_of(place) for place in entered]
    named = Counter({c: n for c, n in calls.items() if not c[1][1].endswith("<genexpr>")})
    pairs = called_both_ways(calls)
    figures = {
        "files that `verify --cert` of the cart enters": len(rooms),
        "rooms that they lie in; changes of room": (
            f"{len(set(rooms))}; {sum(a != b for a, b in pairwise(rooms))}"
        ),
        "rooms called both ways; generators aside": (
            f"{len(pairs)}; {len(called_both_ways(named))}"
        ),
    }
    for what, figure in figures.items():
        print(f"{what:50} {figure}")
    for pair, words in pairs.items() if asked.calls else ():
        print(" and ".join(pair), *sorted(words), sep="\n    ")
    return 0


if __name__ == "__main__":
    sys.exit(main())
