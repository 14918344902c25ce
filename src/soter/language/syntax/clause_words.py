"""Words of items and clauses: where each of them belongs, and what it looks like there.

Purpose: the one table that answers a word of Soter in a wrong place: in another body, behind
another item, or too late in its own. Nothing is looked up before there is an error.
Non-goals: words of other languages (`foreign_words.py`); how the parser goes on
(`parsing/token_cursor.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

NODE, STEP, RTA, VERIFY, PLANT = "node", "step", "rta", "verify", "plant"
SYSTEM, TEST, FAULTS, FUNCTION, TOP = "system", "test", "faults", "function", "top"


@dataclass(frozen=True)
class Home:
    """Where a word belongs, as a phrase, and the item that it stands in there."""

    where: str
    form: str


def _homes(where: str, forms: str) -> dict[str, tuple[Home, ...]]:
    """The items of a body, one a line, each led by its word."""
    lines = [line.strip() for line in forms.strip().split("\n")]
    return {line.split()[0].rstrip(";"): (Home(where, line),) for line in lines}


_IN_A_NODE = _homes(
    "in a node, beside its `step`",
    """
    subscribes motion;
    publishes accel;
    failsafe accel = 0.0;
    guarantees accel < 1.0;
    assumes motion < 1.0;
    on takeover { ... }
    takes [1ms, 5ms];
    step { ... }
    """,
)
_IN_A_PLANT = _homes(
    "in a plant",
    """
    reads accel;
    drives motion = x;
    state x: float;
    disturbance wind: float in [-1.0, 1.0];
    der x = v;
    next x = x + v;
    integrate rk4;
    measured motion within 0.1;
    """,
)
_IN_A_MODULE = _homes(
    "in an `rta`",
    """
    ac Fast;
    sc Careful;
    safe motion.x < 1.0;
    ttf motion.x > 0.5;
    safer motion.x < 0.2;
    clean 3;
    shield 8;
    rest abs(motion.v) < 0.1 moves motion.x by 0.1 within 5s;
    returns after button;
    verify { ... }
    """,
)
_VERIFY_BLOCK = "in the `verify` block of an `rta`"
_IN_VERIFY = _homes(
    _VERIFY_BLOCK,
    """
    grid motion.x in [0.0, 1.0] / 50;
    polytope motion.x in [0.0, 1.0];
    abstracts cart by a: Slow = x;
    commands accel in { -1.0, 1.0 };
    core motion.x < 0.1;
    enters motion.x < 0.2;
    levels 4;
    response dm 1ms;
    acts within 20ms;
    recover within 5s;
    dropout 100ms;
    induction;
    lemma motion.x < 1.0;
    progress motion.x;
    view low { ... }
    """,
)
_IN_A_SYSTEM = _homes(
    "in a system",
    """
    module Guard;
    until 10s;
    force Guard sc;
    inline Lamp;
    faults { ... }
    measure far = motion.x in [0.0, 1.0] / 10 every 100ms;
    external topic motion;
    """,
)
_IN_A_TEST = _homes(
    "in a test",
    """
    skew 1ms;
    horizon 1s;
    quantum 1ms;
    order deployed;
    overrun Lamp by 5ms;
    eventually motion.x > 1.0 within 1s;
    """,
)
_PROPERTIES = _homes(
    "in a system or a test",
    """
    always motion.x < 1.0;
    never motion.x > 1.0;
    replace Fast by Slow;
    set GAIN = 2.0;
    input goal every 100ms;
    """,
)
_IN_FAULTS = _homes(
    "in the `faults` block of a system",
    """
    bias motion.x by 0.1 at 1 per 1s;
    noise motion.x by 0.1 at 1 per 1s;
    scale motion.x by 0.1 at 1 per 1s;
    nan motion.x at 1 per 1s;
    stuck motion at 1 per 1s;
    silent Lamp at 1 per 1s;
    saturated accel at 1 per 1s;
    """,
)
_TOPIC = "in the declaration of a topic"
_QUEUE = "behind a topic that a node subscribes to"
_MEASURED = Home("in a plant, where it bounds the error of a topic", "measured motion within 0.1;")

PLACES: dict[str, tuple[Home, ...]] = {
    **_IN_A_NODE,
    **_IN_A_PLANT,
    **_IN_A_MODULE,
    **_IN_VERIFY,
    **_IN_A_SYSTEM,
    **_IN_A_TEST,
    **_PROPERTIES,
    **_IN_FAULTS,
    "period": (
        Home("behind the name of a node or plant", "node Lamp period 10ms { ... }"),
        Home("in an `rta`", "period 50ms;"),
    ),
    "phase": (Home("behind the period of a node", "node Lamp period 10ms phase 2ms { ... }"),),
    "max_age": (Home(_TOPIC, "topic motion: float max_age 20ms;"),),
    "static": (Home(_TOPIC, "topic map: float max_age 1s static;"),),
    "unit": (Home("behind a type", 'topic motion: float unit "m";'),),
    "queue": (Home(_QUEUE, "subscribes motion queue 4;"),),
    "drop_oldest": (Home(f"{_QUEUE} with a queue", "subscribes motion queue 4 drop_oldest;"),),
    "drop_newest": (Home(f"{_QUEUE} with a queue", "subscribes motion queue 4 drop_newest;"),),
    "hold": (
        Home("behind the range of a disturbance", "disturbance w: float in [-1.0, 1.0] hold 1s;"),
    ),
    "substeps": (Home("behind the method of integration", "integrate rk4 substeps 4;"),),
    "every": (Home("behind an input of a system", "input goal every 100ms;"),),
    "delayed": (Home("in a system", "external topic motion delayed 20ms;"),),
    "default": (Home("behind the name of a system", "system Track default { ... }"),),
    "deploys": (Home("behind the name of a system", "system Board deploys Track { ... }"),),
    "within": (
        _MEASURED,
        Home("in a test, behind `eventually` or `leadsto`", "eventually motion.x > 1.0 within 1s;"),
    ),
    "leadsto": (Home("in a test", "motion.x > 1.0 leadsto motion.x < 1.0 within 1s;"),),
    "wcet": (Home("in a node or an `rta`", "wcet 200us;"),),
    "jitter": (Home("in a node or an `rta`", "jitter 50us;"),),
    "horizon": (
        Home("in a test", "horizon 1s;"),
        Home(_VERIFY_BLOCK, "horizon 5s;"),
    ),
    "late": (
        Home("in a test or a `faults` block", "late Lamp by 5ms;"),
        Home("in a `verify` block", "late dm 1ms;"),
    ),
    "skip": (Home("in a test or a `faults` block", "skip Lamp;"),),
}

_VALUES_OF_A_VARIABLE = "a variable holds any value of its type: only an `int` has a range"
_BOUND = "leave the range out, and bound what is assigned: `clamp(e, low, high)`"
_SET_OF_A_TOPIC = Home(_TOPIC, "topic motion: float in [-1.0, 1.0];")

#: What is said of `in` behind the item that this word leads: a note and a help.
_RANGES: dict[str, tuple[str, str]] = {
    **dict.fromkeys(["var", "let"], (_VALUES_OF_A_VARIABLE, _BOUND)),
    "const": ("a constant has one value", "leave the range out; what is tuned is a `param`"),
    "type": (
        "a set of values is no part of a type, but for an `int`",
        f"move it to the topic: `{_SET_OF_A_TOPIC.form}`",
    ),
    **dict.fromkeys(
        ["subscribes", "publishes", "drives", "reads", "publish"],
        (
            f"the values of a topic stand {_TOPIC}",
            f"move it to the topic: `{_SET_OF_A_TOPIC.form}`",
        ),
    ),
    "fun": ("a parameter takes any value of its type", "leave the range out"),
}

#: In a body: an item of another one whose part another word plays there.
INSTEAD: dict[tuple[str, str], str] = {
    (TEST, "until"): "horizon",
    (SYSTEM, "horizon"): "until",
    (SYSTEM, "safe"): "always",
    (TEST, "safe"): "always",
    (RTA, "always"): "safe",
    (PLANT, "var"): "state",
    (PLANT, "publish"): "drives",
}

#: In a body: an item of another one that is written quite differently there.
ADVICE: dict[tuple[str, str], str] = {
    (NODE, "drives"): "say which topics the node publishes, `publishes motion;`, and publish each "
    "in a step: `publish motion = x;`",
    **dict.fromkeys(
        [(b, w) for b in (NODE, STEP, FUNCTION) for w in ("der", "next")],
        "a node keeps values in variables, and assigns them in a step: `x = x + 0.01 * v;`",
    ),
    (RTA, "subscribes"): "leave it out: a module reads what its predicates name",
    (RTA, "publishes"): "leave it out: a module publishes what its AC and SC do",
    **dict.fromkeys(
        [(SYSTEM, "subscribes"), (SYSTEM, "publishes")],
        "leave it out: nodes say what they read and publish",
    ),
    (PLANT, "failsafe"): "the value before anything is published is the topic's: "
    "`topic accel: float = 0.0;`",
    (SYSTEM, "eventually"): "ask in a test: `eventually motion.x > 1.0 within 1s;`; a system knows "
    "`always` and `never`",
    (RTA, "within"): "leave the time out: a predicate is about one moment; the period and the "
    "`verify` block say how fast a module acts",
    (RTA, "horizon"): "write it into the `verify` block: `verify { horizon 5s; }`",
}

_IN_A_STEP = "statements stand inside a `step { ... }` block of a node"
#: What is said of statements that stand in a body as items.
STATEMENTS = {
    NODE: "statements stand inside a `step { ... }` block",
    PLANT: "a plant has equations, no statements: a choice is `next x = condition ? a : b;`",
    RTA: "a module has conditions, no statements: what is computed first stands in a `fun`",
    SYSTEM: "a system lists what runs, and has no statements",
    TEST: "a test says what is asked, and has no statements",
    VERIFY: _IN_A_STEP,
    FAULTS: _IN_A_STEP,
    TOP: _IN_A_STEP,
}

_HERE = {
    NODE: "in a node",
    STEP: "in a `step`",
    RTA: "in an `rta`",
    VERIFY: "in a `verify` block",
    PLANT: "in a plant",
    SYSTEM: "in a system",
    TEST: "in a test",
    FAULTS: "in a `faults` block",
    FUNCTION: "in a function",
    TOP: "here",
}
#: Bodies by an item that only they have.
_BODY_BY_ITEM = (
    ("subscribes", NODE),
    ("der", PLANT),
    ("ac", RTA),
    ("until", SYSTEM),
    ("quantum", TEST),
    ("grid", VERIFY),
    ("bias", FAULTS),
)

_CLAUSE = re.compile(r"\s*[\w\"{(!\[-]")
"""What follows a word of an item or clause; `=`, `.` or `;` follow a name."""
_TIMES = re.compile(r"\s*\[[^\];]*,[^\];]*\]\s*;")
_RANGE = re.compile(r"\s*[\[{]")
_SHOWN_MAX = 80
"""So many characters of an item are shown."""


@dataclass(frozen=True)
class Misplaced:
    """What is said of a word that stands in a wrong place."""

    message: str
    note: str
    help: str


def body_of(items: Collection[str], blocks: int) -> str:
    """The kind of body at hand, by the words that begin its items and the blocks around."""
    for word, kind in _BODY_BY_ITEM:
        if word in items:
            return STEP if kind == NODE and blocks else kind
    return FUNCTION if blocks else TOP


def is_clause(word: str, rest: str) -> bool:
    """Whether `word` is one of an item or clause, by the text behind it."""
    if word == "in":
        return _RANGE.match(rest) is not None
    if word == "takes":
        return _TIMES.match(rest) is not None
    if word in ("induction", "static"):
        return rest.lstrip()[:1] == ";"
    if word == "on":
        return rest.split(None, 1)[:1] == ["takeover"]
    return word in PLACES and _CLAUSE.match(rest) is not None


def _in_its_block(home: Home, form: str) -> str:
    """An item as it is written, with the block that is often forgotten around it."""
    return f"verify {{ {form} }}" if home.where == _VERIFY_BLOCK else form


def misplaced(word: str, body: str, item: str, written: str) -> Misplaced | None:
    """What is said of a word in this body, behind the item that `item` leads; None if unknown.

    `written` is the item that the word begins, as far as its `;` or a brace.
    """
    shown = "on takeover" if word == "on" else word
    where = f"behind `{item}`" if item else _HERE[body]
    message = f"`{shown}` does not belong {where}"
    if word == "in":
        said = _RANGES.get(item)
        return None if said is None else Misplaced(f"{message}: no range stands here", *said)
    homes = PLACES[word]
    if word == "within":
        homes = homes[1:] if body in (SYSTEM, TEST) else homes[:1]
    belongs = " or ".join(home.where for home in homes)
    note = f"`{shown}` belongs {belongs}"
    advice = ADVICE.get((body, word))
    if advice is not None:
        return Misplaced(message, note, advice)
    line = " ".join(written.split())
    if line.endswith("}") and "{" not in line:  # its `;` is missing
        line = f"{line[:-1].rstrip()};"
    own = not item and line.endswith(";") and len(line) < _SHOWN_MAX
    shown_forms = [
        _in_its_block(home, line if own and home.form.startswith(f"{word} ") else home.form)
        for home in homes
    ]
    forms = " or ".join(f"`{form}`" for form in dict.fromkeys(shown_forms))
    return Misplaced(message, note, f"move it there: {forms}")
