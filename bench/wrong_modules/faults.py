"""Wrong safe controllers: step faults, contracts that do not hold, and what they keep.

Purpose: `FAULTY`: SCs that are latched, that promise what they do not keep, and whose locals
matter.
Non-goals: when they publish (`controllers.py`).
"""

from __future__ import annotations

from functools import partial

from bench.wrong_modules.base import MAP, RUN, SIGHT, under
from bench.wrong_modules.controllers import GOES, because, careful, declared, one, stays

LATCHED = "SC is latched by a step fault and publishes no more"

of_faults = partial(one, "faults")
latched = because("faults", LATCHED)
FAULTS = (
    latched(
        "SC publishes outside its set beyond 0.72",
        careful("publish push = -1.5 * clamp(pos, -1.0, 1.0);"),
        RUN,
    ),
    latched(
        "SC publishes outside its set in a narrow band",
        careful("publish push = abs(pos - 0.7) < 0.06 ? -1.01 : clamp(-4.0 * pos, -1.0, 1.0);"),
    ),
    latched(
        "SC asserts that the place is below 0.65",
        careful("assert pos < 0.65; publish push = clamp(-4.0 * pos, -1.0, 1.0);"),
    ),
    latched(
        "SC divides by a number that is zero beyond 0.7",
        careful(
            "let n = pos > 0.7 ? 0 : 1; publish push = clamp(-4.0 * pos, -1.0, 1.0) * float(1 / n);"
        ),
    ),
    of_faults(
        "SC divides by zero at one place exactly",
        "at 0.5 - pos == 0, reachable: AC may go and wait there",
        (*careful("publish push = clamp(-4.0 * pos + 0.0 / (0.5 - pos), -1.0, 1.0);"),),
        None,
    ),
    latched(
        "SC overflows an int",
        careful(
            "let n = int(pos * 1e9) * 20000000000;"
            " publish push = n > 0 ? clamp(-4.0 * pos, -1.0, 1.0) : 0.0;"
        ),
    ),
    latched(
        "SC leaves the range of an int local",
        careful(
            "n = int(pos * 10.0); publish push = clamp(-4.0 * pos, -1.0, 1.0);",
            "var n: int in [-6, 6] = 0;",
        ),
    ),
    latched(
        "SC converts what is too large",
        careful(
            "let n = int(pos * 1.5e19); publish push = n > 0 ? clamp(-4.0 * pos, -1.0, 1.0) : 0.0;"
        ),
    ),
    latched(
        "SC takes the root of a negative number: NaN",
        careful("publish push = clamp(-4.0 * pos, -1.0, 1.0) * (0.5 + 0.0 * sqrt(0.72 - pos));"),
    ),
    latched(
        "SC reads a table beyond its end",
        (
            declared("const LAW: float[8] = [0.0, -0.5, -0.9, -1.0, -1.0, -1.0, -1.0, -1.0];"),
            *careful(
                "let s = pos < 0.0 ? -1.0 : 1.0; publish push = s * LAW[int(abs(pos) * 12.0)];"
            ),
        ),
    ),
    latched(
        "SC fills a list that is full",
        careful(
            "var xs: float[<=7] = []; for i in 0..10 {"
            " if abs(pos) > 0.1 * float(i) { push xs, pos; } }"
            " publish push = clamp(-4.0 * pos, -1.0, 1.0);"
        ),
    ),
    of_faults(
        "a fail-safe value that pushes right",
        "SC faults, and its fail-safe acts",
        careful(
            "assert pos < 0.65; publish push = clamp(-4.0 * pos, -1.0, 1.0);",
            "failsafe push = 1.0;",
        ),
    ),
    latched(
        "SC faults after ten thousand steps by its counter",
        careful(
            "n = n + 1; publish push = clamp(-4.0 * pos, -1.0, 1.0);", "var n: int in [0, 100] = 0;"
        ),
    ),
    latched(
        "SC faults on its second step in a place",
        careful(
            "if abs(pos) > 0.6 { n = n + 1; } else { n = 0; }"
            " publish push = clamp(-4.0 * pos, -1.0, 1.0);",
            "var n: int in [0, 1] = 0;",
        ),
    ),
    of_faults(
        "SC faults only where an error of measurement puts it",
        "the read may be 0.9 beyond the border of C: no place in C is there",
        (
            ("  der x = push;\n}", "  der x = push;\n  measured pos within 0.03;\n}"),
            *careful("assert pos < 0.77; publish push = clamp(-4.0 * pos, -1.0, 1.0);"),
        ),
        None,
    ),
    latched(
        "a fault behind `&&`",
        careful(
            "let n = pos > 0.65 ? 0 : 1;"
            " publish push = pos > 0.65 && 1 / n == 1 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);"
        ),
    ),
    latched(
        "a fault in a function that SC calls where it matters",
        (
            declared(
                "fun law(p: float): float { assert p < 0.65; return clamp(-4.0 * p, -1.0, 1.0); }"
            ),
            *careful("publish push = abs(pos) > 0.3 ? law(pos) : 0.0;"),
        ),
    ),
    latched(
        "a fault in a loop's last round",
        careful(
            "var s = 0.0; for i in 0..8 { assert pos < 1.0 - 0.05 * float(i); s = s - pos; }"
            " publish push = clamp(s, -1.0, 1.0);"
        ),
    ),
    latched(
        "a map: SC publishes outside its set in a band",
        careful("publish push = abs(pos - 0.7) < 0.06 ? -1.01 : clamp(-4.0 * pos, -1.0, 1.0);"),
        RUN,
        MAP,
    ),
    latched(
        "an estimated place: SC divides by zero beyond 0.7",
        careful(
            "let n = pos > 0.7 ? 0 : 1; publish push = clamp(-4.0 * pos, -1.0, 1.0) * float(1 / n);"
        ),
        RUN,
        SIGHT,
    ),
)

BROKEN_PROMISE = "a contract that does not hold is a violation: the run counts as violated"

broken = because("contracts", BROKEN_PROMISE, named=(r"guarantee", r"contract"))
CONTRACTS = (
    broken(
        "SC guarantees less force than it uses",
        stays("guarantees abs(push) < 0.9;"),
    ),
    broken(
        "SC assumes that it is never far out",
        stays("assumes abs(pos) < 0.6;"),
        named=(r"\bassumes\b", r"contract"),
    ),
    broken(
        "SC's guarantee faults",
        stays("guarantees 1.0 / max(0.0, 0.6 - pos) > 0.0;"),
    ),
    broken(
        "SC's assumption divides by zero",
        stays("assumes 1 / (pos > 0.7 ? 0 : 1) == 1;"),
        named=(r"\bassumes\b", r"contract"),
    ),
    broken(
        "SC guarantees to push only while time is short",
        stays("guarantees time < 5.0;"),
    ),
    broken(
        "SC guarantees that the mode is AC",
        stays("guarantees mode(Keep) == Mode.AC;"),
    ),
    broken(
        "SC guarantees what false means",
        stays("guarantees false;"),
    ),
    broken(
        "SC of a map guarantees less force than it uses",
        stays("guarantees abs(push) < 0.9;"),
        RUN,
        MAP,
    ),
    broken(
        "SC assumes something of an input that is free",
        (
            declared("input topic knob: float in [-1.0, 1.0];"),
            ("module Keep; until", "module Keep; input knob every 10ms; until"),
            *stays("assumes knob < 0.5;", reads="pos, knob"),
        ),
        named=(r"\bassumes\b", r"contract"),
    ),
)

KEPT = "what SC keeps may have any value when it takes over, and one of them is wrong"

of_locals = partial(one, "locals")
LOCALS = (
    of_locals(
        "SC pushes the other way every fourth step",
        KEPT,
        (
            *careful(
                "n = n < 3 ? n + 1 : 0; publish push = (n == 0 ? 4.0 : -1.0)"
                " * clamp(4.0 * pos, -0.25, 0.25);",
                "var n: int in [0, 3] = 0;",
            ),
        ),
        None,
    ),
    of_locals(
        "SC waits ten steps before it acts",
        "half a second more for AC's last command",
        (
            *careful(
                "n = in_c(pos) ? 0 : min(n + 1, 10);"
                " publish push = n < 10 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                "var n: int in [0, 10] = 0;",
            ),
            declared("fun in_c(p: float): bool { return abs(p) < 0.6; }"),
        ),
    ),
    of_locals(
        "SC remembers a side from before it took over",
        KEPT,
        careful(
            "if abs(pos) < 0.02 { right = pos > 0.0; } publish push = right ? -1.0 : 1.0;",
            "var right: bool = true;",
        ),
    ),
    of_locals(
        "a counter wraps and the law with it",
        "at 90 of 100 it pushes right for half a s",
        careful(
            "n = n < 99 ? n + 1 : 0; publish push = n >= 80 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
            "var n: int in [0, 99] = 0;",
        ),
    ),
    of_locals(
        "a state machine that ends in a phase without a law",
        "Done pushes right",
        (
            declared("type Phase = enum { Back, Hold, Done };"),
            *careful(
                "if ph == Phase.Back && abs(pos) < 0.1 { ph = Phase.Hold; }"
                " elseif ph == Phase.Hold && abs(pos) > 0.4 { ph = Phase.Done; }"
                " publish push = ph == Phase.Done ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
                "var ph: Phase = Phase.Back;",
            ),
        ),
    ),
    of_locals(
        "a gain that is halved at every step",
        "after some steps SC pushes no more",
        careful(
            "n = min(n + 1, 40); publish push = n > 20 ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
            "var n: int in [0, 40] = 0;",
        ),
    ),
    of_locals(
        "SC answers what it read 1.5 s ago",
        "in that time AC went from one side to the other",
        careful(
            "publish push = clamp(-4.0 * xs[n], -1.0, 1.0); xs[n] = pos; n = n < 29 ? n + 1 : 0;",
            "var xs: float[30];",
            "var n: int in [0, 29] = 0;",
        ),
        under((GOES, "publish push = time < 0.6 ? -1.0 : 1.0;")),
    ),
    of_locals(
        "SC answers the side on which it was 1.5 s ago",
        "in that time AC went from one side to the other",
        careful(
            "publish push = right[n] ? -1.0 : 1.0; right[n] = pos > 0.0; n = n < 29 ? n + 1 : 0;",
            "var right: bool[30];",
            "var n: int in [0, 29] = 0;",
        ),
        under((GOES, "publish push = time < 0.6 ? -1.0 : 1.0;")),
    ),
    of_locals(
        "SC integrates its error without bound",
        "the integral of AC's time winds up",
        careful(
            "sum = clamp(sum + pos * dt, -9.0, 9.0);"
            " publish push = clamp(-pos + 2.0 * sum, -1.0, 1.0);",
            "var sum: float = 0.0;",
        ),
    ),
    of_locals(
        "a flag that a far place sets for ever",
        "beyond 0.65 once, and it pushes right",
        careful(
            "if pos > 0.65 { bad = true; }"
            " publish push = bad ? 1.0 : clamp(-4.0 * pos, -1.0, 1.0);",
            "var bad: bool = false;",
        ),
    ),
    of_locals(
        "a map: SC pushes the other way every fourth step",
        KEPT,
        careful(
            "n = n < 3 ? n + 1 : 0; publish push = n > 0 ? 1.0 : -1.0;", "var n: int in [0, 3] = 0;"
        ),
        RUN,
        MAP,
    ),
)

FAULTY = (*FAULTS, *CONTRACTS, *LOCALS)
