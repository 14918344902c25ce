"""Wrong safe controllers: what they do beside computing a law from a read.

Purpose: `CONTROLLERS`: queues, `on takeover`, modes and clocks, faults, contracts, locals, and SCs
that do not always publish. A node that is latched publishes no more: the plant keeps AC's last
command, and the run counts as violated.
Non-goals: laws that are too weak or too slow (`mutant_models.py`).
"""

from __future__ import annotations

from bench.wrong_base import CART, LINE, MAP, RUN, SIGHT, Base, Edit, Shown, Wrong, under

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


FULL = "the queue overflows between two steps: SC faults at its next one, and is latched"

QUEUES = (
    one("queues", "an unread `queue 1 fault` latches SC", FULL,
        (*tick("10ms"), *stays(reads="pos, tick queue 1 fault"))),
    one("queues", "an unread `queue 4 fault`, five ticks a period", FULL,
        (*tick("10ms"), *stays(reads="pos, tick queue 4 fault"))),
    one("queues", "an unread `queue 1 fault` of a slow, nearly equal period", FULL,
        (*tick("49ms"), *stays(reads="pos, tick queue 1 fault"))),
    one("queues", "the plant's own topic twice: read, and in a full queue", FULL,
        careful("publish push = clamp(-4.0 * pos[0], -1.0, 1.0);", reads="pos queue 1 fault")),
    one("queues", "a queue that is empty at the first step",
        "SC indexes an empty list at 0 s: the node SC follows publishes later",
        (*tick("100ms"),
         *careful("assert tick[0] >= 0; publish push = clamp(-4.0 * pos, -1.0, 1.0);",
                  reads="pos, tick queue 3"))),
    one("queues", "SC drives by how many values came",
        "more than three ticks in a period and it pushes the wrong way",
        (*tick("10ms"),
         *careful("publish push = tick.len > 3 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                  reads="pos, tick queue 5"))),
    one("queues", "an input topic fills an unread `queue 1 fault`", FULL,
        (declared("input topic knob: float in [-1.0, 1.0];"),
         ("module Keep; until", "module Keep; input knob every 10ms; until"),
         *stays(reads="pos, knob queue 1 fault"))),
    one("queues", "a map: an unread `queue 1 fault`", FULL,
        (declared("topic tick: int in [0, 9] = 0;\n"
                  "node Ticker period 10ms { publishes tick; step { publish tick = 1; } }"),
         ("{ p: Steps; module Keep;", "{ p: Steps; node Ticker; module Keep;"),
         *stays(reads="pos, tick queue 1 fault")), RUN, MAP),
)

TAKEN = "SC's first step after a take-over is a step fault: it is latched and publishes no more"

TAKEOVER = (
    one("takeover", "`on takeover` asserts false", TAKEN,
        stays("on takeover { assert false; }")),
    one("takeover", "`on takeover` divides by zero", TAKEN,
        stays("var n: int in [0, 9] = 3;", "on takeover { n = 3 / 0; }")),
    one("takeover", "`on takeover` leaves the local's range", TAKEN,
        stays("var n: int in [0, 9] = 9;", "on takeover { n = n + 1; }")),
    one("takeover", "`on takeover` faults at the third time", "the third take-over latches SC",
        stays("var n: int in [0, 99] = 0;",
              "on takeover { n = n + 1; assert n < 3; }")),
    one("takeover", "`on takeover` faults at the hundredth time, by its range",
        "the hundredth take-over latches SC",
        stays("var n: int in [0, 99] = 0;", "on takeover { n = n + 1; }"),
        Shown(("run", "--until", "200s"))),
    one("takeover", "`on takeover` sets a flag that turns the law round",
        "after the first take-over SC pushes to the wall",
        careful("publish push = wrong ? clamp(4.0 * pos, -1.0, 1.0) "
                ": clamp(-4.0 * pos, -1.0, 1.0);",
                "var wrong: bool = false;", "on takeover { wrong = true; }")),
    one("takeover", "`on takeover` remembers a side and SC holds it",
        "SC pushes to the side where it took over, whatever it reads since",
        careful("publish push = right ? 1.0 : -1.0;", "var right: bool = false;",
                "on takeover { right = pos > 0.0; }")),
    one("takeover", "`on takeover` reads an element outside of an array", TAKEN,
        (declared("const TABLE: float[3] = [0.0, 0.0, 0.0];"),
         *stays("var n: int in [0, 9] = 5;", "on takeover { n = TABLE[n] > 0.0 ? 0 : 1; }"))),
    one("takeover", "`on takeover` faults where SC takes over on the right", TAKEN,
        stays("on takeover { assert pos < 0.3; }")),
    one("takeover", "`on takeover` converts a large number", TAKEN,
        stays("var n: int in [0, 9] = 5;", "on takeover { n = int(1e300); }")),
    one("takeover", "a cart: `on takeover` asserts false", TAKEN,
        (("  publishes accel;\n  step {\n    let wanted",
          "  publishes accel;\n  on takeover { assert false; }\n  step {\n    let wanted"),),
        RUN, CART),
    one("takeover", "a map: `on takeover` asserts false", TAKEN,
        stays("on takeover { assert false; }"), RUN, MAP),
)

MODES = (
    one("modes", "SC does its duty only while it has no control",
        "`in_control` is true whenever its outputs count: then it pushes to the wall",
        careful("publish push = in_control ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);")),
    one("modes", "SC pushes the other way while the mode is SC", "that is when it counts",
        careful("publish push = mode(Keep) == Mode.SC ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);")),
    one("modes", "SC stops working after five seconds", "from then on it pushes right",
        careful("publish push = time > 5.0 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);")),
    one("modes", "SC stops working when its read is 5 ms old",
        "the runtime may be late: an age above zero makes it push right", (
            *careful("publish push = age(pos) > 0.0 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
            ("period 50ms {\n  subscribes pos;\n  publishes push;\n  step { publish push = age",
             "period 50ms phase 5ms {\n  subscribes pos;\n  publishes push;\n  "
             "step { publish push = age"))),
    one("modes", "SC publishes only while it is not in control", "it never publishes",
        careful("if !in_control { publish push = clamp(-4.0 * pos, -1.0, 1.0); }")),
    one("modes", "SC counts its steps while in control and then gives up",
        "after twenty steps in control its local says: push right",
        careful("if in_control { n = min(n + 1, 99); }"
                " publish push = n > 20 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                "var n: int in [0, 99] = 0;")),
    one("modes", "`ttf` asks for the mode", "as long as AC has control it is never time",
        (("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 && mode(Keep) == Mode.SC"),)),
    one("modes", "`ttf` asks how old the read is", "fresh reads are trusted anywhere",
        (("ttf abs(pos) > 0.7", "ttf abs(pos) > 0.7 && age(pos) > 0.005"),)),
    one("modes", "SC of one module reads the mode of another", "the other module is in mode SC",
        (*careful("publish push = mode(Two) == Mode.SC ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"),
         declared(
             "topic other: float in [-1.0, 1.0] = 0.0;\n"
             "node A2 period 50ms { publishes other; step { publish other = 0.0; } }\n"
             "node S2 period 50ms { publishes other; step { publish other = 0.1; } }\n"
             "rta Two { ac A2; sc S2; period 50ms; safe abs(pos) < 1.0; ttf true; safer false; }"),
         ("module Keep; until", "module Two; module Keep; until"))),
)

SILENT = (
    one("silent", "SC publishes only on the right", "on the left AC's last command stays",
        careful("if pos > 0.0 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }"),
        under((GOES, "publish push = -1.0;"))),
    one("silent", "SC publishes only where it is quiet", "beyond 0.6 AC's last command stays",
        careful("if abs(pos) < 0.6 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }")),
    one("silent", "SC never publishes", "AC's last command stays",
        careful("if pos > 2.0 { publish push = -1.0; }")),
    one("silent", "SC publishes every hundredth step", "AC acts for five seconds",
        careful("n = n < 99 ? n + 1 : 0;"
                " if n == 0 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }",
                "var n: int in [0, 99] = 0;")),
    one("silent", "SC publishes until it was once beyond 0.6", "then never again",
        careful("if abs(pos) > 0.6 { done = true; }"
                " if !done { publish push = clamp(-4.0 * pos, -1.0, 1.0); }",
                "var done: bool = false;")),
    one("silent", "SC publishes in a loop that may be empty",
        "the loop over what came is empty where nothing came: AC's command stays",
        (*tick("3s"),
         *careful("for t in tick { publish push = clamp(-4.0 * pos, -1.0, 1.0); }",
                  reads="pos, tick queue 3"))),
    one("silent", "SC of a cart publishes only at speed", "at rest AC's last push stays",
        (("    publish accel = clamp(4.0 * (wanted - motion.v), -2.0, 2.0);",
          "    if motion.v < 1.0 { publish accel = clamp(4.0 * (wanted - motion.v), -2.0, 2.0); }"),),
        RUN, CART),
    one("silent", "SC of a map publishes only on the right", "on the left AC's command stays",
        careful("if pos > 0.0 { publish push = clamp(-4.0 * pos, -1.0, 1.0); }"),
        under((GOES, "publish push = -1.0;")), MAP),
)

LATCHED = "SC is latched by a step fault and publishes no more"

FAULTS = (
    one("faults", "SC publishes outside its set beyond 0.72", LATCHED,
        careful("publish push = -1.5 * clamp(pos, -1.0, 1.0);"), RUN),
    one("faults", "SC publishes outside its set in a narrow band", LATCHED,
        careful("publish push = abs(pos - 0.7) < 0.06 ? -1.01 : clamp(-4.0 * pos, -1.0, 1.0);")),
    one("faults", "SC asserts that the place is below 0.65", LATCHED,
        careful("assert pos < 0.65; publish push = clamp(-4.0 * pos, -1.0, 1.0);")),
    one("faults", "SC divides by a number that is zero beyond 0.7", LATCHED,
        careful("let n = pos > 0.7 ? 0 : 1;"
                " publish push = clamp(-4.0 * pos, -1.0, 1.0) * float(1 / n);")),
    one("faults", "SC divides by zero at one place exactly",
        "at 0.5 - pos == 0, reachable: AC may go and wait there", (
            *careful("publish push = clamp(-4.0 * pos + 0.0 / (0.5 - pos), -1.0, 1.0);"),), None),
    one("faults", "SC overflows an int", LATCHED,
        careful("let n = int(pos * 1e9) * 20000000000;"
                " publish push = n > 0 ? clamp(-4.0 * pos, -1.0, 1.0) : 0.0;")),
    one("faults", "SC leaves the range of an int local", LATCHED,
        careful("n = int(pos * 10.0); publish push = clamp(-4.0 * pos, -1.0, 1.0);",
                "var n: int in [-6, 6] = 0;")),
    one("faults", "SC converts what is too large", LATCHED,
        careful("let n = int(pos * 1.5e19);"
                " publish push = n > 0 ? clamp(-4.0 * pos, -1.0, 1.0) : 0.0;")),
    one("faults", "SC takes the root of a negative number: NaN", LATCHED,
        careful("publish push = clamp(-4.0 * pos, -1.0, 1.0) * (0.5 + 0.0 * sqrt(0.72 - pos));")),
    one("faults", "SC reads a table beyond its end", LATCHED,
        (declared("const LAW: float[8] = [0.0, -0.5, -0.9, -1.0, -1.0, -1.0, -1.0, -1.0];"),
         *careful("let s = pos < 0.0 ? -1.0 : 1.0;"
                  " publish push = s * LAW[int(abs(pos) * 12.0)];"))),
    one("faults", "SC fills a list that is full", LATCHED,
        careful("var xs: float[<=7] = []; for i in 0..10 {"
                " if abs(pos) > 0.1 * float(i) { push xs, pos; } }"
                " publish push = clamp(-4.0 * pos, -1.0, 1.0);")),
    one("faults", "a fail-safe value that pushes right", "SC faults, and its fail-safe acts",
        careful("assert pos < 0.65; publish push = clamp(-4.0 * pos, -1.0, 1.0);",
                "failsafe push = 1.0;")),
    one("faults", "SC faults after ten thousand steps by its counter", LATCHED,
        careful("n = n + 1; publish push = clamp(-4.0 * pos, -1.0, 1.0);",
                "var n: int in [0, 100] = 0;")),
    one("faults", "SC faults on its second step in a place", LATCHED,
        careful("if abs(pos) > 0.6 { n = n + 1; } else { n = 0; }"
                " publish push = clamp(-4.0 * pos, -1.0, 1.0);", "var n: int in [0, 1] = 0;"),
        ),
    one("faults", "SC faults only where an error of measurement puts it",
        "the read may be 0.9 beyond the border of C: no place in C is there",
        (("  der x = push;\n}", "  der x = push;\n  measured pos within 0.03;\n}"),
         *careful("assert pos < 0.77; publish push = clamp(-4.0 * pos, -1.0, 1.0);")),
        None),
    one("faults", "a map: SC publishes outside its set in a band", LATCHED,
        careful("publish push = abs(pos - 0.7) < 0.06 ? -1.01 : clamp(-4.0 * pos, -1.0, 1.0);"),
        RUN, MAP),
    one("faults", "an estimated place: SC divides by zero beyond 0.7", LATCHED,
        careful("let n = pos > 0.7 ? 0 : 1;"
                " publish push = clamp(-4.0 * pos, -1.0, 1.0) * float(1 / n);"), RUN, SIGHT),
)

BROKEN_PROMISE = "a contract that does not hold is a violation: the run counts as violated"

CONTRACTS = (
    one("contracts", "SC guarantees less force than it uses", BROKEN_PROMISE,
        stays("guarantees abs(push) < 0.9;"), named=(r"guarantee", r"contract")),
    one("contracts", "SC assumes that it is never far out", BROKEN_PROMISE,
        stays("assumes abs(pos) < 0.6;"), named=(r"\bassumes\b", r"contract")),
    one("contracts", "SC's guarantee faults", BROKEN_PROMISE,
        stays("guarantees 1.0 / max(0.0, 0.6 - pos) > 0.0;"), named=(r"guarantee", r"contract")),
    one("contracts", "SC's assumption divides by zero", BROKEN_PROMISE,
        stays("assumes 1 / (pos > 0.7 ? 0 : 1) == 1;"), named=(r"\bassumes\b", r"contract")),
    one("contracts", "SC guarantees to push only while time is short", BROKEN_PROMISE,
        stays("guarantees time < 5.0;"), named=(r"guarantee", r"contract")),
    one("contracts", "SC guarantees that the mode is AC", BROKEN_PROMISE,
        stays("guarantees mode(Keep) == Mode.AC;"), named=(r"guarantee", r"contract")),
    one("contracts", "SC guarantees what false means", BROKEN_PROMISE,
        stays("guarantees false;"), named=(r"guarantee", r"contract")),
    one("contracts", "SC of a map guarantees less force than it uses", BROKEN_PROMISE,
        stays("guarantees abs(push) < 0.9;"), RUN, MAP, named=(r"guarantee", r"contract")),
    one("contracts", "SC assumes something of an input that is free", BROKEN_PROMISE,
        (declared("input topic knob: float in [-1.0, 1.0];"),
         ("module Keep; until", "module Keep; input knob every 10ms; until"),
         *stays("assumes knob < 0.5;", reads="pos, knob")),
        named=(r"\bassumes\b", r"contract")),
)

KEPT = "what SC keeps may have any value when it takes over, and one of them is wrong"

LOCALS = (
    one("locals", "SC pushes the other way every fourth step", KEPT,
        (*careful("n = n < 3 ? n + 1 : 0; publish push = (n == 0 ? 4.0 : -1.0)"
                  " * clamp(4.0 * pos, -0.25, 0.25);", "var n: int in [0, 3] = 0;"),), None),
    one("locals", "SC waits ten steps before it acts", "half a second more for AC's last command",
        careful("n = in_c(pos) ? 0 : min(n + 1, 10);"
                " publish push = n < 10 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                "var n: int in [0, 10] = 0;")
        + (declared("fun in_c(p: float): bool { return abs(p) < 0.6; }"),),
        ),
    one("locals", "SC remembers a side from before it took over", KEPT,
        careful("if abs(pos) < 0.02 { right = pos > 0.0; } publish push = right ? -1.0 : 1.0;",
                "var right: bool = true;"),
        ),
    one("locals", "a counter wraps and the law with it", "at 90 of 100 it pushes right for half a s",
        careful("n = n < 99 ? n + 1 : 0;"
                " publish push = n >= 80 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                "var n: int in [0, 99] = 0;")),
    one("locals", "a state machine that ends in a phase without a law", "Done pushes right",
        (declared("type Phase = enum { Back, Hold, Done };"),
         *careful("if ph == Phase.Back && abs(pos) < 0.1 { ph = Phase.Hold; }"
                  " elseif ph == Phase.Hold && abs(pos) > 0.4 { ph = Phase.Done; }"
                  " publish push = ph == Phase.Done ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                  "var ph: Phase = Phase.Back;"))),
    one("locals", "a gain that is halved at every step", "after some steps SC pushes no more",
        careful("n = min(n + 1, 40); publish push = n > 20 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                "var n: int in [0, 40] = 0;")),
    one("locals", "SC answers what it read 1.5 s ago",
        "in that time AC went from one side to the other",
        careful("publish push = clamp(-4.0 * xs[n], -1.0, 1.0); xs[n] = pos;"
                " n = n < 29 ? n + 1 : 0;", "var xs: float[30];", "var n: int in [0, 29] = 0;"),
        under((GOES, "publish push = time < 0.6 ? -1.0 : 1.0;"))),
    one("locals", "SC answers the side on which it was 1.5 s ago",
        "in that time AC went from one side to the other",
        careful("publish push = right[n] ? -1.0 : 1.0; right[n] = pos > 0.0;"
                " n = n < 29 ? n + 1 : 0;", "var right: bool[30];", "var n: int in [0, 29] = 0;"),
        under((GOES, "publish push = time < 0.6 ? -1.0 : 1.0;"))),
    one("locals", "SC integrates its error without bound", "the integral of AC's time winds up",
        careful("sum = clamp(sum + pos * dt, -9.0, 9.0);"
                " publish push = clamp(-pos + 2.0 * sum, -1.0, 1.0);", "var sum: float = 0.0;")),
    one("locals", "a flag that a far place sets for ever", "beyond 0.65 once, and it pushes right",
        careful("if pos > 0.65 { bad = true; }"
                " publish push = bad ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                "var bad: bool = false;")),
    one("locals", "a map: SC pushes the other way every fourth step", KEPT,
        careful("n = n < 3 ? n + 1 : 0; publish push = n > 0 ? 1.0 : -1.0;",
                "var n: int in [0, 3] = 0;"), RUN, MAP),
)

CONTROLLERS = (
    *QUEUES, *TAKEOVER, *MODES, *SILENT, *FAULTS, *CONTRACTS, *LOCALS,
)
