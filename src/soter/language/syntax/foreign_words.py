"""Words of other languages: names of types, values and functions, and words that lead an item.

Purpose: tables that say what one word was meant to be, by language and by body. Parser and checker
ask them where a word is unknown, never before.
Non-goals: whole phrases (`foreign_phrases.py`); words of Soter in a wrong place (`clause_words.py`);
words that are nearly right (`diagnostics/similar_names.py`).
"""

from __future__ import annotations

import re

from soter.language.syntax.clause_words import NODE, PLANT, RTA, SYSTEM, TEST

_FLOATS = frozenset(
    ["double", "single", "real", "number", "num", "f16", "f32", "f64", "f128", "float_t",
     "double_t", "float16", "float32", "float64", "float32_t", "float64_t", "scalar", "decimal"]
)  # fmt: skip
_INTS = frozenset(
    ["integer", "long", "short", "signed", "size_t", "ssize_t", "isize", "byte_t", "i64", "i128",
     "int64", "int64_t", "ptrdiff_t", "usize", "unsigned", "uint", "uint64", "uint64_t", "u64",
     "u128", "ulong", "time_t"]
)  # fmt: skip
_BOOLS = frozenset(["boolean", "_bool", "bool_t", "bit", "logical", "std_bool"])
_DURATIONS = frozenset(["time_delta", "timedelta", "milliseconds", "seconds_t"])
_TEXTS = frozenset(["string", "str", "char", "text", "wstring", "cstring", "std_string"])
_CONTAINERS = frozenset(
    ["object", "any", "Any", "dict", "Dict", "map", "Map", "set", "Set", "tuple", "Tuple", "list",
     "List", "vector", "array"]
)  # fmt: skip
_SIZED = re.compile(r"(u?)(?:int|i)(8|16|32)(?:_t)?|u(8|16|32)")

_FUNCTIONS = {
    "fabs": "abs", "fabsf": "abs", "labs": "abs", "absolute": "abs", "fmin": "min", "fmax": "max",
    "minimum": "min", "maximum": "max", "sqrtf": "sqrt", "sinf": "sin", "cosf": "cos",
    "tanf": "tan", "atan2f": "atan2", "arctan2": "atan2", "arctan": "atan", "arcsin": "asin",
    "arccos": "acos", "clip": "clamp", "constrain": "clamp", "limit": "clamp", "bound": "clamp",
    "clampf": "clamp", "signum": "sign", "sgn": "sign", "copysign": "sign", "ln": "log",
    "power": "pow", "magnitude": "norm", "length": "norm", "sat": "saturate", "floorf": "floor",
    "wrap_to_pi": "wrap_angle", "normalize_angle": "wrap_angle", "normalize": "unit",
    "double": "float", "float64": "float", "long": "int", "trunc": "int",
}  # fmt: skip
_SUM = "a plant integrates by `der x = ...;`; a node sums up itself, in a variable it keeps (`var`)"
_BEFORE = "keep the last value in a variable of the node (`var last: float = 0.0;`)"
_BLOCKS = {
    **dict.fromkeys(["integrate", "integral", "integrator", "cumsum", "odeint", "solve_ivp"], _SUM),
    **dict.fromkeys(
        ["derivative", "ddt", "diff", "delay", "prev", "last", "pre", "filter"], _BEFORE
    ),
    **dict.fromkeys(["pid", "pidf"], f"write out its sum; {_BEFORE}"),
}
_NUMBERS = {
    "PI": "3.141592653589793", "M_PI": "3.141592653589793", "pi": "3.141592653589793",
    "TWO_PI": "6.283185307179586", "TAU": "6.283185307179586", "tau": "6.283185307179586",
    "M_PI_2": "1.5707963267948966", "M_E": "2.718281828459045",
}  # fmt: skip
_VALUES = {
    "True": "true", "TRUE": "true", "yes": "true", "False": "false", "FALSE": "false",
    "no": "false", "AC": "Mode.AC", "SC": "Mode.SC",
}  # fmt: skip
_NOTHING = frozenset(["None", "NULL", "null", "nullptr", "nil", "undefined", "nullopt"])

LIBRARIES = frozenset(
    ["math", "np", "numpy", "cmath", "std", "Math", "torch", "jnp", "jax", "scipy", "tf", "libm"]
)
"""What the prelude stands in for."""


def type_meant(word: str) -> str | None:
    """The type of Soter for a type of another language: `int in [0, 255]` for `uint8_t`."""
    small = word.lower()
    if small in _FLOATS or small == "float":
        return "float"
    if small in _INTS or small == "int":
        return "int"
    if small in _BOOLS or small == "bool":
        return "bool"
    if small in _DURATIONS:
        return "duration"
    if small == "byte":
        return "int in [0, 255]"
    match = _SIZED.fullmatch(small)
    if match is None:
        return None
    bits = int(match[2] or match[3])
    unsigned = bool(match[1]) or match[3] is not None
    low, high = (0, 2**bits - 1) if unsigned else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    return f"int in [{low}, {high}]"


def type_advice(word: str) -> str | None:
    """What to do without a type that Soter has nothing for."""
    if word.lower() in _TEXTS:
        return "there are no texts at run time: name the cases, `type Name = enum { A, B };`"
    if word == "void":
        return "a function returns a value, of type `float` for example: what acts is a node"
    if word in _CONTAINERS:
        return (
            "values have one fixed type: a record `{ x: float }`, an array `float[4]` or a list "
            "`float[<=4]`"
        )
    return None


def value_meant(word: str) -> str | None:
    """What is written for a value of another language."""
    return _VALUES.get(word) or _NUMBERS.get(word)


def function_meant(word: str) -> str | None:
    """The function of the prelude, or built in, that another language calls `word`."""
    return _FUNCTIONS.get(word)


def function_advice(word: str) -> str | None:
    """What to do without a block of Simulink or an operator of time."""
    return _BLOCKS.get(word.lower())


def is_nothing(word: str) -> bool:
    """Whether it says in another language that there is no value."""
    return word in _NOTHING


_SCALES = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "mps": 1.0, "rad": 1.0,
    "radians": 1.0, "kg": 1.0, "N": 1.0, "Nm": 1.0, "V": 1.0, "A": 1.0, "W": 1.0, "J": 1.0,
    "cm": 1e-2, "mm": 1e-3, "km": 1e3, "g": 1e-3, "kmh": 1 / 3.6, "kph": 1 / 3.6,
    "deg": 0.017453292519943295, "degrees": 0.017453292519943295, "mV": 1e-3, "mA": 1e-3,
    "percent": 1e-2,
}  # fmt: skip


def in_si(number: str, unit: str) -> str | None:
    """A quantity with a unit as the bare number of SI that it stands for."""
    scale = _SCALES.get(unit)
    if scale is None:
        return None
    if scale == 1.0:
        return number
    return repr(float(f"{float(number.replace('_', '')) * scale:.12g}"))


def period_of(rate: str) -> str | None:
    """The period of a rate in Hz where it is a whole number of nanoseconds: `20ms` for `50`."""
    value = float(rate.replace("_", ""))
    if not 1e-3 < value <= 1e9:
        return None
    period_ns = round(1e9 / value)
    if abs(period_ns * value - 1e9) > 1e-3:
        return None
    for unit, size in (("s", 1_000_000_000), ("ms", 1_000_000), ("us", 1_000)):
        if period_ns % size == 0:
            return f"{period_ns // size}{unit}"
    return f"{period_ns}ns"


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
