"""Items that other languages and tools have where Soter has another one, body by body.

Purpose: which item a word stands for that leads one in ROS, Simulink, Gym or a textbook, and what
is said where there is none, or no such statement.
Non-goals: words of Soter in a wrong place (`clause_words.py`).
"""

from __future__ import annotations

from soter.language.syntax.clause_words import NODE, PLANT, RTA, SYSTEM, TEST

_WORDS: dict[str, dict[str, str]] = {
    NODE: {
        "subscribes": "input inputs subscribe subscriber sub listens listen receives consumes",
        "publishes": "output outputs publisher advertise advertises pub emits produces sends",
        "step": "loop update run tick execute callback main process behavior on_timer",
        "var": "variable memory local locals static persistent mutable mut",
        "assumes": "assume requires require pre precondition",
        "guarantees": "guarantee ensures ensure post postcondition",
    },
    PLANT: {
        "reads": "input inputs subscribe listens receives actuators actuator uses",
        "drives": "output outputs publish emits sensor sensors",
        "disturbance": "noise uncertainty unknown perturbation uncertain",
        "state": "variable states float int",
        "der": "dot deriv derivative ddt flow diff",
        "next": "update then jump reset",
        "let": "def auto val define",
        "measured": "error accuracy",
        "integrate": "solver integrator method",
    },
    RTA: {
        "ac": "advanced untrusted performance primary advanced_controller complex",
        "sc": "baseline backup fallback trusted reversionary safe_controller recovery",
        "period": "delta dt interval sample every",
        "safe": "invariant always safety phi",
        "ttf": "unsafe danger switch trigger",
    },
    SYSTEM: {
        "always": "assert check require ensure globally property G invariant forall",
        "never": "forbid avoid",
        "until": "duration timeout stop stoptime runtime simulate end length",
        "node": "use uses include run start launch component spawn add",
        "module": "monitor",
        "set": "parameter configure let",
    },
    TEST: {
        "always": "assert check require ensure expect globally property G invariant",
        "never": "forbid avoid",
        "eventually": "finally F reach",
        "horizon": "duration timeout steps depth bound length time limit",
        "replace": "mock stub substitute",
        "set": "parameter configure let",
    },
}
_MEANT = {
    (body, word): item
    for body, words in _WORDS.items()
    for item, many in words.items()
    for word in many.split()
}
_REWARDS = "there are no rewards: what must hold is asked, `always e;`, or counted, `measure`"
_ADVICE: dict[tuple[str, str], str] = {
    **dict.fromkeys(
        [(b, w) for b in (SYSTEM, TEST, NODE) for w in ("reward", "cost", "objective", "penalty")],
        _REWARDS,
    ),
    **dict.fromkeys(
        [(b, w) for b in (SYSTEM, TEST) for w in ("connect", "remap", "wire", "bind", "link")],
        "nodes that name one topic are connected; another one is wired where the node stands: "
        "`node Fast { goal = target };`",
    ),
    **dict.fromkeys(
        [(b, w) for b in (SYSTEM, TEST) for w in ("print", "log", "record", "plot", "trace")],
        "every topic is logged: leave it out",
    ),
    **dict.fromkeys(
        [(NODE, w) for w in ("on_activate", "on_enter", "on_entry", "on_takeover", "on_switch")],
        "what is done when AC loses control: `on takeover { ... }`",
    ),
    **dict.fromkeys(
        [(NODE, w) for w in ("init", "initialize", "setup", "constructor", "on_start", "start")],
        "a variable has its first value where it is declared: `var n: int = 0;`",
    ),
    **dict.fromkeys(
        [(PLANT, w) for w in ("init", "initial", "initialize", "start")],
        "a state has its first value where it is declared: `state x: float = 0.0;`",
    ),
    **dict.fromkeys(
        [(SYSTEM, w) for w in ("dt", "rate", "clock")],
        "nodes and plants have periods of their own: `node Fast period 10ms { ... }`",
    ),
}

#: What is said of words that begin a statement in other languages.
NO_STATEMENT = {
    "break": "loops always run to their end: guard the body with `if`",
    "continue": "loops always run to their end: guard the body with `if`",
    "switch": "write `if ... elseif ... else`",
    "match": "write `if ... elseif ... else`",
    "print": "publish the value, or read it in the log: every topic is logged",
    "printf": "publish the value, or read it in the log: every topic is logged",
    "goto": "there are only `if` and `for`",
    "do": "every loop has a constant bound: `for i in 0..10 { ... }`",
    "loop": "every loop has a constant bound: `for i in 0..10 { ... }`",
    "repeat": "every loop has a constant bound: `for i in 0..10 { ... }`",
    "try": "a failing step publishes nothing and keeps its locals: no handlers are needed",
    "pass": "an empty block is `{ }`",
    **dict.fromkeys(
        ["raise", "throw", "abort", "exit", "panic"],
        "say what must hold, `assert x < 1.0;`: a failing step publishes nothing",
    ),
    **dict.fromkeys(
        ["catch", "except", "finally", "with", "async", "await", "yield", "defer"],
        "leave it out: a step runs to its end, and a failing one publishes nothing",
    ),
    **dict.fromkeys(["global", "nonlocal"], "leave it out: variables of the node are seen in it"),
    **dict.fromkeys(["del", "delete", "free"], "leave it out: nothing is allocated at run time"),
    **dict.fromkeys(["case", "default", "when"], "write `if ... elseif ... else`"),
    **dict.fromkeys(
        ["static", "volatile", "persistent", "mutable", "private", "public"],
        "a variable that lasts is declared in the node, beside its step: `var n: int = 0;`",
    ),
    "unless": "write `if !(condition) { ... }`",
    **dict.fromkeys(
        ["def", "function", "func", "fn", "class", "struct", "enum", "import"],
        "declare it beside the nodes, at the top level of the file",
    ),
    **dict.fromkeys(
        ["emit", "send", "output", "write", "emits", "signal"], "write `publish speed = 1.0;`"
    ),
    **dict.fromkeys(
        ["wait", "sleep", "delay"],
        "leave it out: the period of the node says when the next step begins",
    ),
    **dict.fromkeys(
        ["end", "endif", "endfor", "fi", "done", "begin", "endwhile"],
        "a block begins with `{` and ends with `}`",
    ),
}


def item_meant(body: str, word: str) -> str | None:
    """The item of a body that a word of other languages stands for; None where there is none."""
    return _MEANT.get((body, word))


def item_advice(body: str, word: str) -> str | None:
    """What is done without an item that other languages have; None where nothing is known."""
    return _ADVICE.get((body, word))
