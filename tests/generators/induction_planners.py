"""Small programs of the shape that induction is for, by chance: some right, most of them wrong.

Purpose: a candidate that AC publishes as it likes, a follower (or two) that adopts it at some age,
a DM and an SC that replace it, with periods, phases, lateness and lemmas of all kinds.
Non-goals: programs that the checker refuses.
"""

from __future__ import annotations

import random

PERIODS = ("5ms", "10ms", "10ms", "20ms")
HEAD = """soter 1;
type Plan = enum {{ Hover, Around, Through }};
topic candidate: Plan;
topic inForce: Plan;
{topics}
fun good(p: Plan): bool {{ return p != Plan.Through; }}
node Any period {ac} phase {ac_phase} {{
  publishes candidate;
  step {{ if choose bool {{ publish candidate = choose Plan; }} }}
}}
node Safe period {sc} phase {sc_phase} {{
  {sc_reads}publishes candidate;
  {sc_locals}
  step {{ {sc_step} }}
}}
node Follower period {follower} phase {follower_phase} {{
  subscribes candidate{follower_reads};
  publishes inForce;
  var plan: Plan;
  {follower_locals}
  step {{
    {follower_step}
    publish inForce = plan;
  }}
}}
{nodes}
rta Planner {{
  ac Any;
  sc Safe;
  period {dm};
  safe {safe};
  ttf {ttf};
  safer {safer};
  verify {{
    induction;
    {verify}
  }}
}}
system S default {{ node Follower; {instances} module Planner; until 1s; }}
"""


def planner(seed: int, *, late: bool = False) -> str:
    """A program; `late`: some steps may come late."""
    draw = random.Random(seed)  # noqa: S311 - test programs
    dm = draw.choice(("10ms", "20ms", "20ms", "30ms"))
    fast = [p for p in PERIODS if int(p[:-2]) <= int(dm[:-2])]
    periods = {who: draw.choice(fast) for who in ("ac", "sc")}
    periods["follower"] = draw.choice(PERIODS)

    def phase(who: str) -> str:
        possible = [n for n in (0, 0, 5, 3, 10) if n < int(periods[who][:-2])]
        return f"{draw.choice(possible)}ms"

    settled = draw.choice((0, 10, 15, 20, 25, 30, 35, 40, 45, 50, 60))
    compared = draw.choice((">", ">", ">="))
    adopts = draw.choice(
        (
            f"if age(candidate) {compared} seconds({settled}ms) {{ plan = candidate; }}",
            f"if age(candidate) {compared} seconds({settled}ms) {{ plan = candidate; }}",
            f"if age(candidate) {compared} seconds({settled}ms) {{ plan = candidate; }}",
            (
                f"if age(candidate) {compared} seconds({settled}ms) && mode(Planner) == Mode.AC "
                "{ plan = candidate; }"
            ),
            f"if age(candidate) > seconds({settled}ms) || good(candidate) {{ plan = candidate; }}",
            "plan = candidate;",
            "if good(candidate) { plan = candidate; }",
            (
                f"if candidate == seen && n >= {settled // 10} {{ plan = candidate; }}\n"
                "    n = candidate == seen ? min(n + 1, 9) : 0;\n    seen = candidate;"
            ),
        )
    )
    locals_ = "var seen: Plan; var n: int in [0, 9];" if "seen" in adopts else ""
    sc_step, sc_reads, sc_locals = draw.choice(
        (
            ("publish candidate = Plan.Hover;", "", ""),
            ("publish candidate = Plan.Hover;", "", ""),
            ("publish candidate = Plan.Hover;", "", ""),
            ("publish candidate = inForce;", "subscribes inForce; ", ""),
            ("publish candidate = Plan.Through;", "", ""),
            (
                "publish candidate = k == 0 ? Plan.Hover : Plan.Around; k = (k + 1) % 3;",
                "",
                "var k: int in [0, 2];",
            ),
            (
                "if k > 0 { publish candidate = Plan.Hover; } k = (k + 1) % 2;",
                "",
                "var k: int in [0, 1];",
            ),
        )
    )
    ttf = draw.choice(
        (
            "!good(candidate)",
            "!good(candidate)",
            "!good(candidate)",
            f"!good(candidate) && age(candidate) >= seconds({draw.choice((0, 10, 20))}ms)",
            "false",
        )
    )
    safer = draw.choice(("good(candidate)", "good(candidate)", "good(inForce)", "true"))
    verify = ""
    if draw.random() < 0.3:
        verify += f"lemma good(candidate) || age(candidate) <= seconds({draw.choice((20, 40))}ms);"
    if draw.random() < 0.2:
        verify += " lemma good(inForce) || mode(Planner) == Mode.AC;"
    if late:
        chosen = [
            f"{who} {draw.choice((1, 2, 4))}ms"
            for who in ("dm", "sc", "Follower", "Any")
            if draw.random() < 0.5
        ]
        if chosen:
            verify += f" late {', '.join(chosen)};"
    nodes = instances = topics = ""
    safe, reads = draw.choice((("good(inForce)", ""),) * 5 + (("good(flown)", ""),))
    if safe == "good(flown)":
        topics, instances = "topic flown: Plan;", "node Relay;"
        nodes = (
            f"node Relay period {draw.choice(PERIODS)} {{ subscribes inForce; publishes flown; "
            "step { publish flown = inForce; } }"
        )
    return HEAD.format(
        topics=topics,
        nodes=nodes,
        instances=instances,
        ac=periods["ac"],
        ac_phase=phase("ac"),
        sc=periods["sc"],
        sc_phase=phase("sc"),
        sc_reads=sc_reads,
        sc_locals=sc_locals,
        sc_step=sc_step,
        follower=periods["follower"],
        follower_phase=phase("follower"),
        follower_reads=reads,
        follower_locals=locals_,
        follower_step=adopts,
        dm=dm,
        safe=safe,
        ttf=ttf,
        safer=safer,
        verify=verify,
    )
