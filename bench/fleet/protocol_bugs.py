"""The leases of examples/fleet with a bug put in, each violated in `soter test`, or not.

Purpose: a table, a line a bug: which test of `reservation_test.soter` is violated, after how many
steps, at what time, and whether the explorer says that no shorter run violates it. Each bug is one
text of `reservation.soter` in the place of another one.
Non-goals: the right protocol (`soter test`; `tests/correct/test_fleet.py`).

    python bench/fleet/protocol_bugs.py
"""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import soter

FLEET = Path(__file__).parents[2] / "examples" / "fleet"
NO_LIMIT_S = 1e9
"""The most that `minimise` takes, 31 years."""


@dataclass(frozen=True)
class Bug:
    """`right` of reservation.soter is written `wrong`; `test` is about what that breaks."""

    name: str
    right: str
    wrong: str
    test: str = "Alike"


UNTIL = "granted == NEVER ? NEVER : granted + LEASE - E_CLOCK"
BUGS = (
    Bug("no age check: a grant lasts for ever", UNTIL, "granted == NEVER ? NEVER : 1000000000"),
    Bug(
        "aged from its arrival, not its sending", "{ granted = heard.sent; }", "{ granted = now; }"
    ),
    Bug("E_CLOCK forgotten", UNTIL, "granted == NEVER ? NEVER : granted + LEASE", "Behind"),
    Bug("an old grant accepted", "heard.to == ID && heard.number == number", "heard.to == ID"),
    Bug("a grant to somebody else taken", "heard.to == ID &&", "heard.to != NOBODY &&"),
    Bug("reordering not noticed", "heard.sent > newest", "heard.sent != newest"),
    Bug(
        "done before it is out",
        "publish request = { from: ID, number: number,",
        "publish request = { from: ID, number: min(through ? number + 1 : number, 1000000),",
    ),
    Bug("released by whoever asks no more", "known[held].number > number", "!known[held].wants"),
    Bug("a lease shorter than told", "now >= sent + LEASE", "now >= sent + LEASE / 2"),
    Bug("grants at once after a restart", "now >= begun + WAIT", "now >= begun", "Restarted"),
    Bug("two managers obeyed", "heard.from == MANAGER", "heard.from != NOBODY", "TwoManagers"),
    Bug("renewed, but counted from the first", "now >= sent + LEASE", "now >= first + LEASE"),
)


@dataclass(frozen=True)
class Counterexample:
    """The run that `soter test` shows for a bug: `test` is "" where none is violated."""

    test: str = ""
    steps: int = 0
    at_ms: int = 0
    minimal: bool = False
    broken: str = ""


def with_bug(bug: Bug, folder: Path) -> Path:
    """The tests beside a protocol with this bug, in a new folder; ValueError: not its text."""
    text = (FLEET / "reservation.soter").read_text(encoding="utf-8")
    if text.count(bug.right) != 1:
        raise ValueError(f"`{bug.right}` stands {text.count(bug.right)} times in the protocol")
    folder.mkdir(parents=True)
    (folder / "reservation.soter").write_text(text.replace(bug.right, bug.wrong), encoding="utf-8")
    return Path(shutil.copy(FLEET / "reservation_test.soter", folder))


def counterexample_of(bug: Bug, folder: Path) -> Counterexample:
    """What the test of `bug` shows in a new `folder`; ValueError as for `with_bug`.

    The search for a shorter run goes on until there is none: how fast the machine is decides how
    long that takes, and nothing else.
    """
    program = soter.load(with_bug(bug, folder))
    (result,) = program.explore(
        test=bug.test, memory="4G", minimise=NO_LIMIT_S, output=folder / "traces"
    ).tests
    if result.verdict == "violated":
        assert result.replayed is not None
        assert result.broken is not None
        steps = result.replayed.steps
        at = steps[-1].time_ns // 1_000_000
        return Counterexample(bug.test, len(steps), at, result.minimal, result.broken.text)
    return Counterexample()


def main() -> None:
    """Print the table."""
    print(f"{'bug':<40} {'test':<12} {'steps':>5} {'ms':>5}  shortest  violated")
    with tempfile.TemporaryDirectory() as place:
        for k, bug in enumerate(BUGS):
            c = counterexample_of(bug, Path(place) / str(k))
            sure = "yes" if c.minimal else "no"
            row = f"{c.test:<12} {c.steps:>5} {c.at_ms:>5}  {sure:<8}  {c.broken}"
            print(f"{bug.name:<40} {row if c.test else 'not violated'}", flush=True)


if __name__ == "__main__":
    main()
