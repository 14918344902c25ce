"""Programs of some hundred thousand configurations, for searches that are to take a while.

Purpose: two robots that share nothing but a property, and a step that overruns; violated, or not.
Non-goals: anything random.
"""

from __future__ import annotations


def wanderers(ms: int, most: int = 16, extra: str = "", apart: bool = False) -> str:
    """Two counters that wander by chance and never leave [-8, 8], and a node that looks at both.

    `most`: a property says that they are never further apart; `extra`: items of the test; `apart`:
    nothing looks at both.
    """
    both = "" if apart else f"always abs(a - b) <= {most};"
    return f"""soter 1;
type Small = int in [-9, 9];
topic a: Small;
topic b: Small;
topic n: int in [0, 3];
node A period 10ms {{ publishes a; var at: Small; step {{
  at = at >= 8 ? at - 1 : at <= -8 ? at + 1 : at + choose {{ 0, 1, -1 }}; publish a = at;
}} }}
node B period 10ms {{ publishes b; var at: Small; step {{
  at = at >= 8 ? at - 1 : at <= -8 ? at + 1 : at + choose {{ 0, 1, -1 }}; publish b = at;
}} }}
node N period 20ms {{ subscribes a; publishes n; var last: int in [0, 3]; step {{
  if a > 2 {{ last = choose [0, 3]; }}
  publish n = last;
}} }}
system S {{ node A; node B; node N; until 1s; }}
test T {{ system S; horizon {ms}ms; {both} always a <= 8; always b <= 8; {extra} }}
"""
