"""Wrong safe controllers: what they do beside computing a law from a read.

Purpose: `CONTROLLERS`: queues, `on takeover`, modes and clocks, faults, contracts, locals, and SCs
that do not always publish. A node that is latched publishes no more: the plant keeps AC's last
command, and the run counts as violated.
Non-goals: laws that are too weak or too slow (`tests/generators/changed_modules.py`).
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from bench.wrong_modules.base import CART, LINE, MAP, RUN, Base, Edit, Shown, Wrong, under

if TYPE_CHECKING:
    from collections.abc import Callable

HEAD = "node Careful period 50ms {\n  subscribes pos;\n  publishes push;\n"
LAW = "step { publish push = clamp(-4.0 * pos, -1.0, 1.0); }"
STOP = HEAD + "  " + LAW
FAST = "node Fast period 50ms {"
GOES = "publish push = pos >= 0.0 ? 1.0 : -1.0;"
AT_REST: Edit = ("ac Fast;", "ac Idle;")


def careful(body: str, *more: str, reads: str = "pos") -> tuple[Edit, ...]:
    """SC with another step, and more lines before it."""
    head = HEAD.replace("subscribes pos", f"subscribes {reads}")
    lines = "".join(f"  {line}\n" for line in more)
    return ((STOP, f"{head}{lines}  step {{ {body} }}"),)


def stays(*more: str, reads: str = "pos") -> tuple[Edit, ...]:
    """SC with the same step, and more lines before it."""
    return careful("publish push = clamp(-4.0 * pos, -1.0, 1.0);", *more, reads=reads)


def declared(text: str) -> Edit:
    """One more declaration before AC."""
    return (FAST, f"{text}\n{FAST}")


def tick(period: str) -> tuple[Edit, ...]:
    """A topic `tick` that somebody publishes."""
    return (
        declared(
            "topic tick: int in [0, 9] = 0;\n"
            f"node Ticker period {period} {{ publishes tick; step {{ publish tick = 1; }} }}"
        ),
        ("{ p: Line; module Keep;", "{ p: Line; node Ticker; module Keep;"),
    )


def one(
    kind: str,
    name: str,
    why: str,
    edits: tuple[Edit, ...],
    shown: Shown | None = RUN,
    base: Base = LINE,
    **rest: tuple[str, ...],
) -> Wrong:
    """An entry."""
    return Wrong(kind, name, base, edits, why, shown, **rest)


def because(kind: str, why: str, **usual: tuple[str, ...]) -> Callable[..., Wrong]:
    """Entries of a kind that are all wrong for the same reason."""

    def entry(
        name: str,
        edits: tuple[Edit, ...],
        shown: Shown | None = RUN,
        base: Base = LINE,
        **rest: tuple[str, ...],
    ) -> Wrong:
        return one(kind, name, why, edits, shown, base, **{**usual, **rest})

    return entry


FULL = "the queue overflows between two steps: SC faults at its next one, and is latched"

of_queues = partial(one, "queues")
full = because("queues", FULL)
QUEUES = (
    full(
        "an unread `queue 1 fault` latches SC",
        (*tick("10ms"), *stays(reads="pos, tick queue 1 fault")),
    ),
    full(
        "an unread `queue 4 fault`, five ticks a period",
        (*tick("10ms"), *stays(reads="pos, tick queue 4 fault")),
    ),
    full(
        "an unread `queue 1 fault` of a slow, nearly equal period",
        (*tick("49ms"), *stays(reads="pos, tick queue 1 fault")),
    ),
    full(
        "the plant's own topic twice: read, and in a full queue",
        careful("publish push = clamp(-4.0 * pos[0], -1.0, 1.0);", reads="pos queue 1 fault"),
    ),
    of_queues(
        "a queue that is empty at the first step",
        "SC indexes an empty list at 0 s: the node SC follows publishes later",
        (
            *tick("100ms"),
            *careful(
                "assert tick[0] >= 0; publish push = clamp(-4.0 * pos, -1.0, 1.0);",
                reads="pos, tick queue 3",
            ),
        ),
    ),
    of_queues(
        "SC drives by how many values came",
        "more than three ticks in a period and it pushes the wrong way",
        (
            *tick("10ms"),
            *careful(
                "publish push = tick.len > 3 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                reads="pos, tick queue 5",
            ),
        ),
    ),
    full(
        "an input topic fills an unread `queue 1 fault`",
        (
            declared("input topic knob: float in [-1.0, 1.0];"),
            ("module Keep; until", "module Keep; input knob every 10ms; until"),
            *stays(reads="pos, knob queue 1 fault"),
        ),
    ),
    full(
        "a map: an unread `queue 1 fault`",
        (
            declared(
                "topic tick: int in [0, 9] = 0;\n"
                "node Ticker period 10ms { publishes tick; step { publish tick = 1; } }"
            ),
            ("{ p: Steps; module Keep;", "{ p: Steps; node Ticker; module Keep;"),
            *stays(reads="pos, tick queue 1 fault"),
        ),
        RUN,
        MAP,
    ),
)

TAKEN = "SC's first step after a take-over is a step fault: it is latched and publishes no more"

of_takeover = partial(one, "takeover")
taken = because("takeover", TAKEN)
TAKEOVER = (
    taken("`on takeover` asserts false", stays("on takeover { assert false; }")),
    taken(
        "`on takeover` divides by zero",
        stays("var n: int in [0, 9] = 3;", "on takeover { n = 3 / 0; }"),
    ),
    taken(
        "`on takeover` leaves the local's range",
        stays("var n: int in [0, 9] = 9;", "on takeover { n = n + 1; }"),
    ),
    of_takeover(
        "`on takeover` faults at the third time",
        "the third take-over latches SC",
        stays("var n: int in [0, 99] = 0;", "on takeover { n = n + 1; assert n < 3; }"),
    ),
    of_takeover(
        "`on takeover` faults at the hundredth time, by its range",
        "the hundredth take-over latches SC",
        stays("var n: int in [0, 99] = 0;", "on takeover { n = n + 1; }"),
        Shown(("run", "--until", "200s")),
    ),
    of_takeover(
        "`on takeover` sets a flag that turns the law round",
        "after the first take-over SC pushes to the wall",
        careful(
            "publish push = wrong ? clamp(4.0 * pos, -1.0, 1.0) : clamp(-4.0 * pos, -1.0, 1.0);",
            "var wrong: bool = false;",
            "on takeover { wrong = true; }",
        ),
    ),
    of_takeover(
        "`on takeover` remembers a side and SC holds it",
        "SC pushes to the side where it took over, whatever it reads since",
        careful(
            "publish push = right ? 1.0 : -1.0;",
            "var right: bool = false;",
            "on takeover { right = pos > 0.0; }",
        ),
    ),
    taken(
        "`on takeover` reads an element outside of an array",
        (
            declared("const TABLE: float[3] = [0.0, 0.0, 0.0];"),
            *stays("var n: int in [0, 9] = 5;", "on takeover { n = TABLE[n] > 0.0 ? 0 : 1; }"),
        ),
    ),
    taken(
        "`on takeover` faults where SC takes over on the right",
        stays("on takeover { assert pos < 0.3; }"),
    ),
    taken(
        "`on takeover` converts a large number",
        stays("var n: int in [0, 9] = 5;", "on takeover { n = int(1e300); }"),
    ),
    taken(
        "a cart: `on takeover` asserts false",
        (
            (
                "  publishes accel;\n  step {\n    let wanted",
                "  publishes accel;\n  on takeover { assert false; }\n  step {\n    let wanted",
            ),
        ),
        RUN,
        CART,
    ),
    taken(
        "a map: `on takeover` asserts false",
        stays("on takeover { assert false; }"),
        RUN,
        MAP,
    ),
)

of_modes = partial(one, "modes")
MODES = (
    of_modes(
        "SC does its duty only while it has no control",
        "`in_control` is true whenever its outputs count: then it pushes to the wall",
        careful("publish push = in_control ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
    ),
    of_modes(
        "SC pushes the other way while the mode is SC",
        "that is when it counts",
        careful("publish push = mode(Keep) == Mode.SC ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
    ),
    of_modes(
        "SC stops working after five seconds",
        "from then on it pushes right",
        careful("publish push = time > 5.0 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
    ),
    of_modes(
        "SC stops working when its read is 5 ms old",
        "the runtime may be late: an age above zero makes it push right",
        (
            *careful("publish push = age(pos) > 0.0 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
            (
                "period 50ms {\n  subscribes pos;\n  publishes push;\n  step { publish push = age",
                (
                    "period 50ms phase 5ms {\n  subscribes pos;\n  publishes push;\n  "
                    "step { publish push = age"
                ),
            ),
        ),
    ),
    of_modes(
        "SC publishes only while it is not in control",
        "it never publishes",
        careful("if !in_control { publish push = clamp(-4.0 * pos, -1.0, 1.0); }"),
    ),
    of_modes(
        "SC counts its steps while in control and then gives up",
        "after twenty steps in control its local says: push right",
        careful(
            "if in_control { n = min(n + 1, 99); }"
            " publish push = n > 20 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
            "var n: int in [0, 99] = 0;",
        ),
    ),
    of_modes(
        "`ttf` asks for the mode",
        "as long as AC has control it is never time",
        (("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 && mode(Keep) == Mode.SC"),),
    ),
    of_modes(
        "`ttf` asks how old the read is",
        "fresh reads are trusted anywhere",
        (("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 && age(pos) > 0.005"),),
    ),
    of_modes(
        "SC of one module reads the mode of another",
        "the other module is in mode SC",
        (
            *careful("publish push = mode(Two) == Mode.SC ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
            declared(
                "topic other: float in [-1.0, 1.0] = 0.0;\n"
                "node A2 period 50ms { publishes other; step { publish other = 0.0; } }\n"
                "node S2 period 50ms { publishes other; step { publish other = 0.1; } }\n"
                "rta Two { ac A2; sc S2; period 50ms; safe abs(pos) < 1.0; ttf true; safer false; }"
            ),
            ("module Keep; until", "module Two; module Keep; until"),
        ),
    ),
)

of_silent = partial(one, "silent")
SILENT = (
    of_silent(
        "SC publishes only on the right",
        "on the left AC's last command stays",
        careful("if pos > 0.0 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }"),
        under((GOES, "publish push = -1.0;")),
    ),
    of_silent(
        "SC publishes only where it is quiet",
        "beyond 0.6 AC's last command stays",
        careful("if abs(pos) < 0.6 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }"),
    ),
    of_silent(
        "SC never publishes",
        "AC's last command stays",
        careful("if pos > 2.0 { publish push = -1.0; }"),
    ),
    of_silent(
        "SC publishes every hundredth step",
        "AC acts for five seconds",
        careful(
            "n = n < 99 ? n + 1 : 0; if n == 0 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }",
            "var n: int in [0, 99] = 0;",
        ),
    ),
    of_silent(
        "SC publishes until it was once beyond 0.6",
        "then never again",
        careful(
            "if abs(pos) > 0.6 { done = true; }"
            " if !done { publish push = clamp(-4.0 * pos, -1.0, 1.0); }",
            "var done: bool = false;",
        ),
    ),
    of_silent(
        "SC publishes in a loop that may be empty",
        "the loop over what came is empty where nothing came: AC's command stays",
        (
            *tick("3s"),
            *careful(
                "for t in tick { publish push = clamp(-4.0 * pos, -1.0, 1.0); }",
                reads="pos, tick queue 3",
            ),
        ),
    ),
    of_silent(
        "SC publishes twice, and the last one counts",
        "the last one pushes right",
        careful(
            "publish push = clamp(-4.0 * pos, -1.0, 1.0); if pos > 0.6 { publish push = 1.0; }"
        ),
    ),
    of_silent(
        "SC publishes in a loop, and the last round counts",
        "the last round pushes right",
        careful("for i in 0..3 { publish push = clamp(float(i) - 1.0, -1.0, 1.0); }"),
    ),
    of_silent(
        "SC of a cart publishes only at speed",
        "at rest AC's last push stays",
        (
            (
                "    publish accel = clamp(4.0 * (wanted - motion.v), -2.0, 2.0);",
                (
                    "    if motion.v < 1.0 { publish accel = clamp(4.0 * (wanted -"
                    " motion.v), -2.0, 2.0); }"
                ),
            ),
        ),
        RUN,
        CART,
    ),
    of_silent(
        "SC of a map publishes only on the right",
        "on the left AC's command stays",
        careful("if pos > 0.0 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }"),
        under((GOES, "publish push = -1.0;")),
        MAP,
    ),
)

CONTROLLERS = (*QUEUES, *TAKEOVER, *MODES, *SILENT)
