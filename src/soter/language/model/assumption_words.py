"""The assumptions that prover or re-checker may make, in words with a number each.

Purpose: `in_words` gives an assumption one text, and `numbered_assumptions` one number, wherever
they are printed.
Non-goals: which assumptions a proof makes: the prover (`verify/problem/assumptions.py`) and the
re-checker (`certificate/scope.py`) each derive that.
"""

from __future__ import annotations

from itertools import chain
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

WORDS = {
    "ac": "{} publishes at its releases, any value of the declared sets or none",
    "acknowledged": "P2b: the operator acknowledges: a press of {} is in force when `safer` holds; "
    "without one SC keeps control",
    "binary64": "the compiler and the hardware compute binary64 as IEEE 754 says",
    "changes": "{} changes only while the estimate lies in S_0 of the new value, whichever mode; "
    "DM and SC read the new value from that instant on",
    "conforms": "{} behaves like {} ({}) for some disturbance within its bounds, from {} on",
    "declared": "times as declared: {}",
    "disturbance": "disturbances stay within their bounds: {}",
    "error": "measurement errors stay within their bounds: {}",
    "every solution": "the plant is any absolutely continuous solution of its differential "
    "equation, with any rate between those on both sides where its right-hand side jumps; not the "
    "simulator's scheme",
    "exact": "estimates are exact: {}",
    "fresh": "P2b: what the DM reads is fresh, and no gate fault keeps AC out",
    "identified": "the numbers of {} hold: nobody proved them, they explain {} held-out episodes; "
    "that a new one leaves them with at most 1/{} is of episodes drawn alike; "
    "`soter monitor` watches it",
    "judged": "what `safe` says of {} is judged on what {} drives: what is published there is not "
    "looked at",
    "lease": "the actuators hold the law from the end of the lease on: all of them at one instant, "
    "within {}, and they take nothing that comes later",
    "left out": "left out, as nothing that is proved depends on it, below 1e+308, and where "
    "functions in its rate are defined: {}",
    "machine": "the compiler and the hardware do what the C of the steps says",
    "no dropout": "sensors never drop out: where one does the DM hands over to SC, which then "
    "reads what is too old for its own proof (`dropout` covers a silence)",
    "one instant": "plant, DM and SC run in the same instant, in this order, and commands act "
    "in it",
    "one instant of AC": "AC runs in that instant, too: no command that it replaces there acts any "
    "more",
    "open": "no run gets beyond an open end, of which nothing is proved: {} below {!r}",
    "order": "commands of AC and SC act in the order in which they were published",
    "other": "{}: any value of the declared set, at any time",
    "others": "what others publish and what moves these plants stays in its declared set: {}",
    "scheme": "the plant is the only solution of its differential equation (where the right-hand "
    "side jumps: with any rate between those on both sides); not the simulator's scheme",
    "sensors on time": "sensors publish exactly at their releases, before anybody reads in that "
    "instant",
    "set": "what plants publish lies in the declared sets: {} (else they stop)",
    "together": "what SC publishes begins to act in all of these at one instant: {}",
    "undeclared": "undeclared times are zero: {}",
    "wait": "SC waits for the DM, in one thread, and no release is skipped",
    "world": "the world behaves like {} for some disturbance within its bounds",
    "z3": "z3 is right where it says that no counterexample exists",
}


def in_words(kind: str, *about: object) -> str:
    """Gives the sentence of an assumption: the text of `kind` in WORDS, filled in with `about`."""
    return WORDS[kind].format(*about)


def numbered_assumptions(*lists: Iterable[str]) -> dict[str, str]:
    """Maps the text of each assumption to its number (A1, A2, ...), in the order of the lists."""
    return {text: f"A{k}" for k, text in enumerate(dict.fromkeys(chain(*lists)), 1)}
