"""A module with `rest` as a C library that an adversary flies.

Purpose: `Loop`: the C that `soter build` would emit for a program (DM, SC, AC, the plants'
derivative), with a hook at every step of its check, compiled together with `tube_loop.c`.
Non-goals: adversaries (`tube_loop.c`), which runs (`attack.py`).
"""

from __future__ import annotations

import ctypes as ct
import re
from dataclasses import dataclass
from functools import reduce
from math import gcd, inf
from pathlib import Path
from typing import TYPE_CHECKING

from soter.codegen.unit import generate
from soter.language.elaborate.derived_systems import faultless
from soter.language.front_end import check_file, system_to_prove
from soter.language.model.types import leaves
from soter.native.cache import cached_folder, digest
from soter.native.compiler import compile_with, find_compiler
from soter.native.shared_library import CHECK_FAILED, KERNEL, RUNTIME, c_texts, library_flags
from soter.verify.deploy.missing_predicates import install_predicates, rest_claims
from soter.verify.problem.extract import extract
from soter.verify.problem.problem import Interval
from soter.verify.tubes.expression_graph import Node, in_order
from soter.verify.tubes.module_expressions import ModuleExpressions
from soter.verify.tubes.problem import TubeProblem
from soter.verify.tubes.rest_claims import RestClaims
from soter.verify.tubes.tube_check import TubeCheck
from soter.verify.tubes.tube_levels import TubeLevels

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from soter.codegen.unit import Unit

HERE = Path(__file__).parent
SOURCE = HERE / "tube_loop.c"
LIBRARY = "tube_loop.so"
STEPS_A_HOLD = 20
"""Into how many ticks, at least, a period of SC is cut."""
AROUND = 50.0
"""How far from a declared start a state without a set may start."""
NO_SHIELD = """enum { TIMES = 1 };
static void replaced(double *until, const double *u, int64_t ct) { (void)until; }
static void behind_gate(const double *u, const double *until) { (void)until; }"""
FUNCTIONS = {"sin", "cos", "exp", "tan", "atan", "tanh", "sqrt"}


@dataclass
class Module:
    """A module of a system, and what was shown of it; of several plans `check` is the first's."""

    problem: TubeProblem
    check: TubeCheck
    claims: RestClaims
    unit: Unit

    @property
    def kept(self) -> bool:
        """Whether row P2a is proved."""
        return not (self.claims.kept or self.claims.moves)


def module_of(
    name: str, text: str, changed: Callable[[str], str] | None = None, *, claimed: bool = True
) -> Module:
    """The module of a program. `changed`: of the text of its check, another one.

    Not `claimed`: nothing is shown of its rest, and half of every set is taken for what SC keeps.
    `SoterError` where it is no program with one module that tubes follow.
    """
    flat = system_to_prove(check_file(name, text), None)
    problem = extract(faultless(flat), flat.modules[0])
    assert isinstance(problem, TubeProblem)
    every, levels = [], []
    for of in problem.plans or (problem,):
        check = TubeCheck(of)
        if claimed:
            claims = rest_claims(check)
        else:
            inner = {s: Interval(0.5 * r.low, 0.5 * r.high) for s, r in enumerate(of.states)}
            claims = RestClaims(ways=inner, kept="not asked")
        source = check.text_in_flight(claims.ways)
        if changed is not None:
            source = changed(source)
        every.append((check, claims))
        levels.append(TubeLevels(tuple(check.states), source, len(of.map_leaves)))
    install_predicates(flat, flat.modules[0], problem, levels)
    check, claims = every[0]
    return Module(problem, check, claims, generate(flat, prefix="m"))


# ---------------------------------------------------------------- the generated C


def _hooked(source: str) -> str:
    """The C with a hook behind every step of `follows` and `settles`."""
    for name in ("m_follows_fn", "m_settles_fn", "m_answered_fn"):
        start = re.search(rf"^SOTER_INLINE \w+ {name}\(", source, re.MULTILINE)
        if start is None:
            assert name == "m_answered_fn", name  # where SC reads nothing
            continue
        end = source.index("\n}\n", start.start())
        body = source[start.start() : end]
        timed = "double passed" in body  # where SC reads nothing
        if timed:
            gone = "passed = passed + time;"
            body = body.replace(gone, f"trace_span(passed, time, step);\n{gone}")
        else:
            body = re.sub(r"m_flow_fn\(([^;]*), &(\w+), fault\);", _flow_hook, body)
        answer = r"m_(?:law|answer_to)_fn\([^;]*(&[\w>-]+)(?:, fault)?\);"
        body = re.sub(answer, r"\g<0>\n    trace_law(\1);", body)
        end_hook = f"trace_end({'passed' if timed else '0.0'});"
        body = re.sub(r"(    if \(there\) \{)", rf"\1\n      {end_hook}", body)
        source = source[: start.start()] + body + source[end:]
    assert "trace_law(&" in source, "no answer of SC is compared"
    estimated = r"m_estimated_fn\([^;]*&(\w+), fault\);"
    return re.sub(estimated, r"\g<0>\n  trace_begin(&\1);", source)


def _flow_hook(m: re.Match[str]) -> str:
    """The kind of a step is told by what it is given."""
    kinds = {"step_s": 0, "window_s": 1, "m_OPEN": 2, "m_CLOSED": 3}
    kind = next((n for word, n in kinds.items() if word in m.group(1)), 4)
    return f"{m.group(0)}\n    trace_flow({kind}, &{m.group(2)});"


def _path(path: Sequence[str]) -> str:
    """A leaf of a C structure."""
    return "".join(f".at[{p}]" if p.isdigit() else f".{p}" for p in path)


class _Shim:
    """What `tube_loop.c` calls, in C, of one module."""

    def __init__(self, module: Module) -> None:
        self.p, self.check, self.source = module.problem, module.check, module.unit.source
        self.system = self.p.system
        self.make = ModuleExpressions(self.p)

    def text(self) -> str:
        """All of it."""
        q, flat = self.p.quantities, self.p.module
        dm = self.system.components[flat.dm].name.removesuffix(".dm").replace(".", "_")
        sc, ac = (self._step(i) for i in (flat.sc, flat.ac))
        n, m, w = len(q.states), len(q.controls), len(q.disturbances)
        followed = ", ".join(map(str, self.check.states))
        read, commands, rates = self._read(), self._controls(), self._rates()
        places, ends = self._kept()
        return f"""
static m_state S;
enum {{ N = {n}, M = {m}, W = {w}, AIMS = {len(self._aims())}, SAFES = {self._safes()} }};
static const int FOLLOWED[NS] = {{{followed}}};
static double *const KEPT_AT[] = {{{places}NULL}};
static const double KEPT_ENDS[][2] = {{{ends}{{0.0, 0.0}}}};
static bool decide(bool ac) {{
  S.modules[0].mode = ac ? SOTER_AC : SOTER_SC;
  S.modules[0].gate_fault = 0;
  S.modules[0].clean_needed = 0;
  return m_{dm}_decide(&S) == SOTER_AC;
}}
static int answer(double *u) {{
  uint32_t published = 0;
  soter_fault fault = {sc}(&S, SOTER_ENABLED, &published, NULL);
  {commands[0]}
  return fault != SOTER_OK || published == 0;
}}
static void wishes(double *u) {{
  uint32_t published = 0;
  (void){ac}(&S, SOTER_ENABLED, &published, NULL);
  {commands[0]}
}}
static void held(double *u) {{
  {commands[0]}
}}
static void begin(void) {{ memset(&S, 0, sizeof S); m_init(&S, NULL); }}
static void observe(const double *y, int64_t stamp, int64_t now) {{
  S.header.ct = now;
  {read}
}}
{self._shield()}
static void rates(const double *x_in, const double *u_in, const double *w_in, double *dx_out) {{
  m_state *const s = &S;
  soter_fault status = SOTER_OK;
  soter_fault *const fault = &status;
  {commands[1]}
  {rates}
}}
static void margins(const double *x, double *aim) {{
{_printed(self._aims(), "aim")}
}}
static double resting(const double *x) {{
  double aim[1];
{_printed([self.make.condition_of_predicate(self.p.rest)], "aim")}
  return aim[0];
}}
"""

    def _kept(self) -> tuple[str, str]:
        """Where SC keeps floats, and between which ends these may be."""
        sc = _name(self.system.components[self.p.module.sc].name)
        places = "".join(f"&S.{sc}.{name}, " for name in self.check.variables)
        ends = (f"{{{r.low!r}, {r.high!r}}}, " for r in self.check.variables.values())
        return places, "".join(ends)

    def _step(self, index: int) -> str:
        return f"m_{self.system.components[index].name.replace('.', '_')}_step"

    def _shield(self) -> str:
        """What a publication leaves in the shield's topic, as docs/semantics.md has it."""
        shield = self.p.module.shield
        if shield is None:
            return NO_SHIELD
        topic = self.system.topics[shield.topic]
        ends = ", ".join(f"{{{r.low!r}, {r.high!r}}}" for r in self.p.controls)
        return f"""enum {{ CELLS = {shield.cells}, TIMES = {len(topic.default)} }};
static void replaced(double *until, const double *u, int64_t ct) {{
  static const double ENDS_OF[M][2] = {{{ends}}};
  for (int k = 0; k < M; k++) {{
    int cell = (int)((u[k] - ENDS_OF[k][0]) / (ENDS_OF[k][1] - ENDS_OF[k][0]) * CELLS);
    until[k * CELLS + (cell < CELLS ? cell : CELLS - 1)] = 1e-9 * (double)ct;
  }}
}}
static void behind_gate(const double *u_in, const double *until) {{
  {self._controls()[1]}
  memcpy(&S.topics.{_name(topic.name)}, until, TIMES * sizeof *until);
}}"""

    def _aims(self) -> list[Node]:
        """Conditions all of which hold in C, those of `safe` first."""
        if not hasattr(self, "_found"):
            self.make.rates()
            self._found = _parts(self.make.constraint_condition())
        return self._found

    def _safes(self) -> int:
        """How many of them are those of `safe`."""
        return len(_parts(self.make.condition_of_predicate(self.p.module.symbol.safe)))

    def _read(self) -> str:
        """Values of what plants publish."""
        lines = []
        for (topic, leaf), state in self.p.state_of_leaf.items():
            t = self.system.topics[topic]
            path = [p for p, _ in leaves(t.type)][leaf]
            lines.append(f"S.topics.{_name(t.name)}{_path(path)} = y[{state}];")
        lines += [f"S.stamps[{i}] = stamp;" for i in {topic for topic, _ in self.p.state_of_leaf}]
        return "\n  ".join(lines)

    def _controls(self) -> tuple[str, str]:
        out, into = [], []
        for k, leaf in enumerate(self.p.quantities.controls):
            at = f"S.topics.{_name(self.system.topics[leaf.owner].name)}{_path(leaf.path)}"
            out.append(f"u[{k}] = {at};")
            into.append(f"{at} = u_in[{k}];")
        return "\n  ".join(out), "\n  ".join(into)

    def _rates(self) -> str:
        """The derivative as the plants' own steps call it."""
        q, blocks = self.p.quantities, []
        for index in sorted(self.p.core.plants):
            step = self._step(index)
            start = self.source.index(f"static soter_fault {step}(")
            body = self.source[start : self.source.index("\n}\n", start)]
            call = re.search(r"const (\w+) k1 = ([^;]*);", body)
            assert call is not None, f"{step}: no derivative in its C"
            states = [(i, s) for i, s in enumerate(q.states) if s.owner == index]
            wind = [(k, d) for k, d in enumerate(q.disturbances) if d.owner == index]
            lines = [f"{call.group(1)} x_;"]
            lines += [f"x_{_path((s.member, *s.path))} = x_in[{i}];" for i, s in states]
            for k, d in wind:
                assert not d.path, d.name
                lines.append(f"const double {d.member} = w_in[{k}]; (void){d.member};")
            asked = re.sub(r"\(\w+,", "(x_,", re.sub(r"\bcanonical_", "", call.group(2)), count=1)
            lines.append(f"const {call.group(1)} k1 = {asked};")
            lines += [f"dx_out[{i}] = k1{_path((s.member, *s.path))};" for i, s in states]
            blocks.append("{ " + "\n    ".join(lines) + " }")
        return "\n  ".join(blocks)


def _parts(condition: Node) -> list[Node]:
    """What is joined by "and"."""
    todo, found = [condition], []
    while todo:
        c = todo.pop()
        if c.op == "and":
            todo += reversed(c.of)
        elif c.op != "known":
            found.append(c)
    return found


def _name(topic: str) -> str:
    return topic.replace(".", "_")


def _printed(roots: Sequence[Node], out: str) -> str:
    """Signed margins of conditions over x, in doubles."""
    names: dict[Node, str] = {}
    lines = []
    for k, e in enumerate(in_order(roots)):
        names[e] = f"t{k}"
        lines.append(f"  const double t{k} = {_c(e, names)}; (void)t{k};")
    lines += [f"  {out}[{i}] = {names[e]};" for i, e in enumerate(roots)]
    return "\n".join(lines)


def _c(e: Node, names: dict[Node, str]) -> str:
    """An expression; of a condition how far it holds."""
    a = [names[x] if isinstance(x, Node) else x for x in e.of]
    binary = {"add": "+", "sub": "-", "mul": "*", "over": "/"}
    if e.op == "number":
        return repr(float(e.of[0])).replace("inf", "INFINITY")
    if e.op == "input":
        return f"x[{a[1]}]"
    if e.op in binary:
        return f"{a[0]} {binary[e.op]} {a[1]}"
    if e.op in ("max", "or", "min", "and"):
        return f"f{'max' if e.op in ('max', 'or') else 'min'}({a[0]}, {a[1]})"
    if e.op == "select":
        return f"{a[0]} > 0.0 ? {a[1]} : {a[2]}"
    given = {
        "known": "INFINITY" if a[0] else "-INFINITY", "neg": f"-{a[0]}", "abs": f"fabs({a[0]})",
        "square": f"{a[0]} * {a[0]}", "inverse": f"1.0 / {a[0]}", "positive": f"{a[0]}",
        "not negative": f"{a[0]}", "wrap_angle": f"remainder({a[0]}, 6.283185307179586)",
    }  # fmt: skip
    if e.op == "inside":
        return f"fmin({a[0]} - ({a[1]!r}), {a[2]!r} - {a[0]})".replace("inf", "INFINITY")
    if e.op == "share":
        return f"({a[0]} > 0.0 ? 1.0 : 0.0)"
    if e.op in FUNCTIONS:
        return f"{e.op}({a[0]})"
    assert e.op in given, e.op
    return given[e.op]


# ---------------------------------------------------------------- the library


class Config(ct.Structure):
    """`config` of tube_loop.c: times in ns, then ranges."""

    TIMES = (
        *("tick", "delta_dm", "phase_dm", "late_dm", "response_dm", "age_dm"),
        *("delta_sc", "phase_sc", "late_sc", "response_sc", "age_sc", "least", "most"),
        *(
            "horizon",
            "alpha",
            "delay",
            "jitter",
            "switches",
            "delta_ac",
            "free",
            "steps",
            "any_for",
            "within",
        ),
    )
    _fields_ = (
        *((name, ct.c_int64) for name in TIMES),
        *((name, ct.c_double * 16) for name in ("error", "u_low", "u_high", "w_low", "w_high")),
        *((name, ct.c_double * 16) for name in ("x_low", "x_high", "x_first")),
        *((name, ct.c_double * 16) for name in ("below", "above", "y_low", "y_high")),
    )


class Told(ct.Structure):
    """`told` of tube_loop.c: what runs showed."""

    _fields_ = (
        *((n, ct.c_int64) for n in ("runs", "violated", "holds", "outside", "looks", "good")),
        *((n, ct.c_int64) for n in ("in_ac", "in_all", "early", "late", "dives", "kinds")),
        *((n, ct.c_double) for n in ("least", "off")),
        ("seed", ct.c_uint64),
        ("at", ct.c_int64),
        ("where", ct.c_int64),
    )


class Loop:
    """A module's library."""

    def __init__(self, module: Module, optimise: str = "-O3") -> None:
        self.module = module
        self.config = config_of(module)
        self._library = ct.CDLL(str(_built(module, optimise)))
        for name in ("attack_fly", "attack_contain", "attack_late"):
            function = getattr(self._library, name)
            function.argtypes = [ct.c_void_p, ct.c_uint64, ct.c_int64, ct.c_int64, ct.c_void_p]
            function.restype = None

    def run(self, name: str, seed: int, count: int, how: int) -> Told:
        """`fly`, `contain` or `late`; see tube_loop.c."""
        told = Told()
        call = getattr(self._library, f"attack_{name}")
        call(ct.byref(self.config), seed, count, how, ct.byref(told))
        return told


def config_of(module: Module) -> Config:
    """Times and ranges as the problem has them."""
    p, check, t = module.problem, module.check, module.problem.times
    acts, tubes = t.schedule.outputs, check.times
    times = {
        "delta_dm": t.delta_dm, "phase_dm": t.phase_dm, "late_dm": t.late_dm,
        "response_dm": t.response_dm, "age_dm": t.age_dm, "delta_sc": t.delta_sc,
        "phase_sc": t.phase_sc, "late_sc": t.late_sc, "response_sc": t.response_sc,
        "age_sc": t.age_sc, "least": min(o.least for o in acts), "most": t.acts,
        "horizon": tubes.latest, "alpha": tubes.earliest, "delay": tubes.delay,
        "jitter": tubes.jitter,
        "delta_ac": p.system.components[p.module.ac].period_ns,
    }  # fmt: skip
    assert not any(o.nodes for o in acts), "nodes behind SC are not flown here"
    tick = reduce(gcd, times.values())
    tick = max(d for d in _divisors(tick) if d <= t.delta_sc // STEPS_A_HOLD)
    c = Config(tick=tick, switches=tubes.switches, free=_constant(module, "FREE_STEPS"), **times)
    c.steps = _constant(module, "STEPS")
    c.within = p.within_ns
    c.any_for = tubes.any_command if p.module.shield is not None else -1
    errors = check.error_by_state()
    for i in range(len(p.quantities.states)):
        c.error[i] = errors.get(i, 0.0)
        first = p.initial[i]
        c.x_first[i] = 0.5 * (first.low + first.high)
        told = p.states[i]
        c.x_low[i] = max(told.low, first.low - AROUND)
        c.x_high[i] = min(told.high, first.high + AROUND)
        drift, way = p.drifts.get(i), module.claims.ways.get(i)
        if not module.kept or i in check.turning:  # whole turns are all anywhere
            drift = way = None
        c.below[i], c.above[i] = (inf, inf) if drift is None else (drift.below, drift.above)
        c.y_low[i], c.y_high[i] = (-inf, inf) if way is None else (way.low, way.high)
    for k, r in enumerate(p.controls):
        c.u_low[k], c.u_high[k] = r.low, r.high
    for k, r in enumerate(p.disturbances):
        c.w_low[k], c.w_high[k] = r.low, r.high
    return c


def _divisors(n: int) -> list[int]:
    """Of a time in ns, those that a run may have for a tick."""
    return [n // k for k in range(1, 4001) if n % k == 0]


def _constant(module: Module, name: str) -> int:
    found = re.search(rf"const {name}: int = (\d+);", module.check.text_in_flight({}))
    assert found is not None
    return int(found.group(1))


def _built(module: Module, optimise: str) -> Path:
    """The library, kept by content."""
    names = ("STATES", "CONTROLS", "SYMBOLS")
    sizes = [_constant(module, n) for n in names]
    defines = f"enum {{ NS = {sizes[0]}, MS = {sizes[1]}, SYMBOLS = {sizes[2]} }};\n"
    parts = {
        "m.h": module.unit.header,
        "m.c": _hooked(module.unit.source),
        "sizes.h": defines,
        "shim.h": _Shim(module).text(),
    }
    kernel = [RUNTIME / name for name in KERNEL]
    flags = (*library_flags(optimise), "-w")
    key = digest([find_compiler().identity, *flags, *parts.values(), *c_texts(SOURCE, *kernel)])

    def build(folder: Path) -> None:
        for name, text in parts.items():
            (folder / name).write_text(text, encoding="utf-8")
        command = [
            *find_compiler().command, *flags, f"-I{folder}", f"-I{RUNTIME}", f"-I{HERE}",
            str(SOURCE), *map(str, kernel), str(CHECK_FAILED), "-o", str(folder / LIBRARY), "-lm",
        ]  # fmt: skip
        compile_with(command, folder, "the loop of an adversary does not compile")

    return cached_folder("attacks", key, (LIBRARY,), build) / LIBRARY
