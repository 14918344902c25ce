"""The words of the language, as an editor explains them.

Purpose: `WORDS` says what each word means, `PLACES` where it can begin something, for hover and for
completion; a test compares them with `docs/grammar.ebnf`.
Non-goals: names of programs (`hover.py`); the reference (`docs/language.md`).
"""

from __future__ import annotations

from soter.language.syntax.parsing.declarations import NODE_ITEMS, PLANT_ITEMS
from soter.language.syntax.parsing.items import begins
from soter.language.syntax.parsing.modules import RTA_ITEMS, VERIFY_ITEMS, VIEW_ITEMS
from soter.language.syntax.parsing.systems import FAULT_ITEMS, SYSTEM_ITEMS, TEST_ITEMS

PLACES: dict[str, tuple[str, ...]] = {
    "file": (
        "import", "type", "const", "param", "fun", "extern", "topic", "input topic", "node", "rta",
        "plant", "system", "test",
    ),
    "node": begins(NODE_ITEMS),
    "rta": begins(RTA_ITEMS),
    "verify": begins(VERIFY_ITEMS),
    "view": begins(VIEW_ITEMS),
    "plant": begins(PLANT_ITEMS),
    "system": begins(SYSTEM_ITEMS),
    "test": begins(TEST_ITEMS),
    "faults": begins(FAULT_ITEMS),
    "block": ("let", "var", "publish", "push", "if", "for", "return", "assert"),
}  # fmt: skip
"""Kind of body -> words that can begin an item in it."""

TYPES = ("bool", "int", "float", "duration")
VALUES = ("true", "false", "choose", "fair")

BUILTINS: dict[str, str] = {
    "sqrt": "sqrt(x: float): float. The square root, rounded correctly.",
    "floor": "floor(x: float): float. The largest whole number that is not above x.",
    "abs": "abs(x): the magnitude of a float or an int.",
    "min": "min(a, b): the smaller of two floats or ints; `b < a ? b : a`.",
    "max": "max(a, b): the larger of two floats or ints; `b > a ? b : a`.",
    "dot": "dot(v, w): float. The components of two vectors multiplied and added from the left.",
    "norm": "norm(v): float. `sqrt(dot(v, v))`.",
    "saturate": "saturate(x, a): each component of x put into [-a, a].",
    "seconds": "seconds(d: duration): float. A length of time in seconds.",
    "mode": "mode(M): Mode. Who is in control of module M: `Mode.AC` or `Mode.SC`.",
    "margin": "margin(M): float. Seconds for which the module surely keeps AC in control, whatever"
    " AC does.",
    "age": "age(t): float. Seconds since topic t was last published.",
}
SPECIALS: dict[str, str] = {
    "time": "time: float. Virtual time in seconds: of nodes, plants and properties.",
    "dt": "dt: float. The period of this node or plant in seconds.",
    "in_control": "in_control: bool. Whether the outputs of this node count: true outside modules.",
}

WORDS: dict[str, str] = {
    "soter": "The first line, `soter 1;`: the edition of the language.",
    "import": '`import "file.soter" as name;`: its declarations are `name.Declaration` here.',
    "as": "The name that an imported file gets here.",
    "type": "A name for a type: a record, an array, a bounded list, a range of ints or an `enum`.",
    "enum": "A type of named values: `type Phase = enum { IDLE, UP };`.",
    "const": "A value that is computed when the program is compiled, or read from a `data` file.",
    "param": "A value that `--set` or a system's `set` may choose before the start, in its range.",
    "fun": "A function: no state, no recursion, bounded loops.",
    "extern": "Written in Python or C: Soter knows its interface, and checks what it answers.",
    "from": "Where the code of something extern is: `python:file.py:name`, `c:file.c:name`, or a"
    " policy, `onnx:file.onnx`.",
    "topic": "What nodes and plants publish and read: a value with a type and a set it stays in.",
    "input": "`input topic`: driven by the environment. In a system or test: which values, how"
    " often.",
    "in": "The set that a value stays in, the values that are drawn from, or what a loop is over.",
    "static": "What this topic says of the world stays true: a map, for `safe` of a module with"
    " `rest`.",
    "max_age": "Older than this, a topic is stale: a DM that reads it gives SC control.",
    "unit": 'What the numbers of a type count, for people: `float unit "m/s"`.',
    "node": "Code that runs every `period`: reads topics, publishes topics, keeps locals.",
    "period": "How often it runs: a length of time such as `10ms`.",
    "phase": "How long after the start a node runs first; less than its period.",
    "subscribes": "The topics that a node may read; `queue n` keeps the last n messages.",
    "queue": "How many messages of a subscription wait to be read.",
    "drop_oldest": "A full queue loses its oldest message.",
    "drop_newest": "A full queue refuses the new message.",
    "fault": "A message for a full queue is a fault of the step that reads it.",
    "publishes": "The topics that a node may publish; `[<=n]`: so many messages of it a step.",
    "takes": "How long a step lasts, at least and at most: it publishes at its end.",
    "wcet": "What a step needs of its processor at most.",
    "jitter": "How late a release may be.",
    "failsafe": "What holds where nothing better is known: of a node after a fault, of a module"
    " once the trusted part is silent.",
    "assumes": "What a node or a module relies on; it is checked as it steps.",
    "guarantees": "What a node or a module promises; it is checked as it steps.",
    "on": "`on takeover { ... }`: runs before the first step in which the node has control.",
    "takeover": "`on takeover { ... }`: runs before the first step in which the node has control.",
    "step": "What a node does every period: reads see the topics as the step began, publications"
    " count at its end.",
    "var": "A local that may be assigned; of a node it is kept between steps.",
    "let": "A local that is never assigned again; in a plant, a value that what follows may use.",
    "publish": "Publish a topic at the end of this step; the last one counts.",
    "push": "Append a value to a bounded list; a full list is a fault.",
    "if": "A condition, without parentheses.",
    "elseif": "Another condition, where those before do not hold.",
    "else": "Where no condition held.",
    "for": "A loop with constant bounds, `for i in 0..n`, or over an array or a list; in a system"
    " it repeats items. Of a fault: how long it lasts.",
    "return": "The value of the function.",
    "assert": "A step fault where the condition does not hold.",
    "while": "There is none: every step must end within a bound that is known beforehand.",
    "choose": "One of finitely many values: a test tries them all, a run draws one.",
    "fair": "`fair choose`: no alternative is left out for ever.",
    "true": "A value of `bool`.",
    "false": "A value of `bool`.",
    "bool": "`true` or `false`.",
    "int": "64-bit; overflow is a fault. `int in [a, b]` keeps to a range. `int(x)` truncates.",
    "float": "IEEE 754 double. `float(n)` converts an int.",
    "duration": "A length of time in whole nanoseconds, of constants and parameters: `10ms`.",
    "rta": "A module: an advanced controller, a safe one, and a decision module that switches.",
    "ac": "The advanced controller: anything may stand here, nothing is believed of it.",
    "sc": "The safe controller, or several plans of one: the proof is about what it does.",
    "synthesized": "A safe controller that `soter verify --synthesize` finds.",
    "safe": "What the module keeps true: φ_safe.",
    "safer": "Where AC may get control back: φ_safer, well inside `safe`.",
    "ttf": "When SC must take over now, whatever AC would do: ttf_2Δ.",
    "clean": "How many clean outputs AC needs after a fault before it may have control.",
    "returns": "When the DM gives control back: `after` an operator's press, or `never`.",
    "after": "`returns after button;`: the DM waits for a press of it, new and not too old.",
    "rest": "Where SC ends, in place of `ttf` and `safer`: each look of the DM follows it there.",
    "moves": "What SC still moves where `rest` holds, each by at most so much.",
    "down": "`gap by 0.2 down`: the bound is one on the way down; up it may go anywhere.",
    "up": "`x by 0.2 up`: the bound is one on the way up; down it may go anywhere.",
    "shield": "Each command of AC is judged before it acts; a number: by cells of a grid.",
    "toward": "`shield toward sc;`: what is not permitted is moved toward SC's command; "
    "`shield toward plans, sc;`: the first of `plans` that is good is published, else SC's.",
    "verify": "What `soter verify` is to know: over which states, how late things are.",
    "grid": "States that are analysed together, in cells: `grid p.x in [0, 1] / 200;`.",
    "open": "`open to c`: one more cell, nothing is claimed beyond; `open`: the axis has no ends.",
    "to": "The far end of an open axis.",
    "abstracts": "A plant by simpler ones, each on a part of its state.",
    "by": "What stands in for it, or how much.",
    "commands": "The values that a synthesized controller may publish.",
    "core": "A hint: a set that SC keeps.",
    "enters": "What holds of the step in which a view's map changes.",
    "horizon": "How far ahead is looked; of a test, how long it explores.",
    "levels": "How many levels computed sets have.",
    "late": "How late the DM, SC or nodes between start at most; of a test, a fault of that kind.",
    "response": "How long the DM, SC or nodes between take at most.",
    "dm": "The decision module.",
    "acts": "How long it takes until a command acts on the plant.",
    "within": "The bound of a time or of an error.",
    "recover": "`recover within d`: how long SC may keep control; `never`: for ever.",
    "never": "A property: at no time; of `recover`: SC may keep control for ever; of `returns`: it"
    " does.",
    "dropout": "For how long a sensor may be silent beyond its period.",
    "age": "How long ago a topic was published; of `verify`: how old SC reads it at most.",
    "induction": "Prove the module by induction over what nodes publish.",
    "lemma": "An invariant that the proof may use, and proves.",
    "progress": "What P2b takes for granted; nobody proves it.",
    "view": "A part of the predicates, on plants of its own.",
    "plant": "The physics: states that change by `der` or `next`, and the topics they drive.",
    "reads": "The topics that a plant obeys.",
    "drives": "A topic that a plant publishes after each of its steps.",
    "state": "A state of a plant; `in` an interval it is drawn at the start.",
    "disturbance": "What nobody knows: any value of its interval, drawn anew every step or `hold`.",
    "hold": "How long a disturbance keeps its value.",
    "der": "The derivative of a state in time.",
    "next": "The value of a state after the period, from the old state.",
    "integrate": "The scheme by which `der` is integrated: `rk4` (default) or `euler`.",
    "rk4": "Runge and Kutta's scheme of order 4.",
    "euler": "Euler's scheme, of order 1.",
    "substeps": "How many steps of the scheme a period is divided into.",
    "measured": "How far an estimate may be off: `measured motion.x within 0.1`.",
    "system": "What runs: plants, modules, nodes, properties. In a test: the system it explores.",
    "default": "The system that runs where none is named.",
    "deploys": "The same system in the world, without plants: the proof of the other holds of it.",
    "external": "`external topic`: published by the world, with what is promised of it.",
    "every": "How often.",
    "delayed": "How old a value is at most when it arrives.",
    "module": "An instance of an `rta` in a system.",
    "until": "How long a run of the system lasts, if nothing else is said.",
    "always": "A property: at every time.",
    "eventually": "A property: at some time, within a bound.",
    "leadsto": "A property: whenever the left side holds, the right side does within a bound.",
    "force": "`force M ac` or `sc`: an experiment in which the module records but never switches.",
    "inline": "Runs in the thread of the trusted part.",
    "replace": "Another node or plant in its place, in this system or test only.",
    "contract": "`replace M by contract`: any value that what it promises permits.",
    "set": "The value of a parameter here, of one instance or of all.",
    "faults": "What goes wrong, and how often.",
    "measure": "What a campaign tells of every run: a histogram.",
    "order": "`order any`: steps of an instant in any order; `order deployed`: as deployed.",
    "any": "`order any`: steps of an instant in any order.",
    "deployed": "`order deployed`: steps of an instant as they are deployed.",
    "overrun": "A step takes longer than it may.",
    "bias": "A fault: a value is off by so much.",
    "noise": "A fault: a value is off by at most so much, at random.",
    "scale": "A fault: a value is a multiple of what it should be.",
    "skip": "A release is left out.",
    "nan": "A fault: the values are no numbers.",
    "stuck": "A fault: the last value is published again.",
    "silent": "A fault: nothing is published.",
    "saturated": "A fault: the values are at the end of their set.",
    "at": "How often a fault happens; `at most`: how many.",
    "most": "`at most`: how many at a time.",
    "per": "In which time.",
    "test": "What `soter test` explores: every schedule, every choice, up to a horizon.",
    "skew": "How far the clocks of nodes may be apart.",
    "quantum": "The steps in which lateness is tried.",
    "invariant": "`always invariant(M)`: the invariant of Theorem 3.1 of a module.",
    "invariants": "`always invariants`: those of all modules of the system.",
    "data": 'A value read from a file: `const ROUTE: Vec3[4] = data "route.json";`.',
}


def word_meaning(word: str) -> str | None:
    """What a word of the language means; None for any other word."""
    return WORDS.get(word) or BUILTINS.get(word) or SPECIALS.get(word)
