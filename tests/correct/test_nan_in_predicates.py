"""A NaN that `ttf` or `safer` compares is danger: on both engines alike, whatever is around it.

One program has a module a case; what each of them reads, a plant says: `s.k` counts its periods.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from generators.explorer_agreement import compared, enumerated
from soter.api.program import load
from soter.core.steps import lower
from soter.language.evaluate.predicates import maybe_nan
from soter.language.evaluate.ranges import TOTAL
from soter.language.front_end import check_file, system_of
from soter.language.prelude.function_error_bounds import BOUNDS
from soter.simulate.run import NativeProgram, run_interpreted
from tables import all_rows

if TYPE_CHECKING:
    from pathlib import Path

    from soter.simulate.result import Run

LOOKS, END_NS = 21, 1_000_000_000


class Case(NamedTuple):
    """The predicates of a module, what share of time is AC's, how many looks met a NaN."""

    ttf: str
    safer: str
    ac: bool
    nan_looks: int = LOOKS


FINE = "s.k >= 0.0"
NEVER = "s.k < 0.0"
CASES = {
    "constant": Case("s.two > NAN", FINE, ac=False),
    "constant_in_function": Case("beyond(s.two)", FINE, ac=False),
    "constant_in_min": Case("min(s.two, NAN) > 100.0", FINE, ac=False),
    "constant_in_saturate": Case("saturate(s.two, NAN) > 100.0", FINE, ac=False),
    "constant_infinity": Case("s.two > 1.0e300 * 1.0e300", FINE, ac=True, nan_looks=0),
    "root": Case("sqrt(s.minus) > 5.0", FINE, ac=False),
    "acos": Case("acos(s.two) > 5.0", FINE, ac=False),
    "log": Case("log(s.minus) > 5.0", FINE, ac=False),
    "sine": Case("sin(s.huge) > 5.0", FINE, ac=False),
    "difference": Case("s.huge * 1.0e10 - s.huge * 1.0e10 > 5.0", FINE, ac=False),
    "product": Case("(s.huge * 1.0e10) * s.zero > 5.0", FINE, ac=False),
    "zero_by_zero": Case("!(s.zero / s.zero > 5.0)", FINE, ac=False, nan_looks=0),
    "infinite_quotient": Case("(s.huge * 1.0e10) / (s.huge * 1.0e10) > 5.0", FINE, ac=False),
    "negated": Case("!(sqrt(s.minus) < 5.0) && false", FINE, ac=False),
    "first_of_or": Case("sqrt(s.minus) > 5.0 || false", FINE, ac=False),
    "second_of_or": Case(f"{NEVER} || sqrt(s.minus) > 5.0", FINE, ac=False),
    "behind_or": Case(f"{NEVER}", f"{FINE} || sqrt(s.minus) > 5.0", ac=True, nan_looks=0),
    "behind_and": Case(f"{NEVER} && sqrt(s.minus) > 5.0", FINE, ac=True, nan_looks=0),
    "in_safer": Case(NEVER, "!(sqrt(s.minus) > 5.0)", ac=False),
    "in_both": Case("sqrt(s.minus) > 5.0", "sqrt(s.minus) < 5.0", ac=False),
    "equal": Case("sqrt(s.minus) == 1.0", FINE, ac=False),
    "unequal": Case(NEVER, "sqrt(s.minus) != 1.0", ac=False),
    "itself": Case("let_of(s.minus)", FINE, ac=False),
    "branch": Case("branched(s.minus, s.two)", FINE, ac=False),
    "other_branch": Case("branched(s.two, s.minus)", FINE, ac=True, nan_looks=0),
    "loses_in_max": Case("max(1.0, sqrt(s.minus)) > 5.0", FINE, ac=False),
    "loses_in_saturate": Case("saturate(1.0, sqrt(s.minus)) > 5.0", FINE, ac=False),
    "vector": Case("norm(saturate(pair(s.two, sqrt(s.minus)), 1.0)) > 5.0", FINE, ac=False),
    "clamped": Case("clamp(sqrt(s.minus), 0.0, 1.0) > 5.0", FINE, ac=False),
    "reversed_clamp": Case("clamp(s.two, s.two, s.minus) > 5.0", FINE, ac=False),
    "not_compared": Case("not_compared(s.minus, s.two)", FINE, ac=True, nan_looks=0),
    "in_a_loop": Case("looped(s.two)", FINE, ac=False),
    "whole_numbers": Case("int(s.two) > 5", FINE, ac=True, nan_looks=0),
    "array": Case("[s.two, sqrt(s.minus)][1] > 5.0", FINE, ac=False),
    "other_element": Case("[s.two, sqrt(s.minus)][0] > 5.0", FINE, ac=True, nan_looks=0),
}
TEXT = """soter 1;
const NAN: float = sqrt(-1.0);
fun beyond(x: float): bool { return x < NAN; }
topic s: { k: float, minus: float, two: float, huge: float, zero: float, once: float };
type Pair = { x: float, y: float };
fun pair(x: float, y: float): Pair { return { x: x, y: y }; }
fun let_of(x: float): bool { let r = sqrt(x); let at_all = r == r; return false; }
fun branched(x: float, y: float): bool {
  if x < 0.0 { return sqrt(x) > 5.0; }
  return sqrt(x) > 5.0;
}
fun not_compared(x: float, y: float): bool { let unused = sqrt(x); return y > 5.0; }
fun looped(x: float): bool {
  var far = x;
  for i in 0..4 { if far > 5.0 { return true; } far = far - 1.0 - float(i); far = sqrt(far); }
  return false;
}
plant P period 50ms {
  drives s = {
    k: k, minus: -1.0, two: 2.0, huge: 1.0e300, zero: 0.0, once: k == 10.0 ? -1.0 : 1.0
  };
  state k: float = 0.0;
  next k = k + 1.0;
}
"""
MODULE = """
topic u_{n}: float in [0.0, 1.0];
node A_{n} period 50ms {{ publishes u_{n}; step {{ publish u_{n} = 1.0; }} }}
node S_{n} period 50ms {{ publishes u_{n}; step {{ publish u_{n} = 0.0; }} }}
rta M_{n} {{ ac A_{n}; sc S_{n}; period 50ms; safe s.k < 1.0e9; ttf {ttf}; safer {safer}; }}
"""


def _program(tmp_path: Path, cases: dict[str, Case]) -> Path:
    text = TEXT + "".join(MODULE.format(n=n, ttf=c.ttf, safer=c.safer) for n, c in cases.items())
    modules = " ".join(f"module M_{n};" for n in cases)
    path = tmp_path / "nan.soter"
    path.write_text(f"{text}system S default {{ p: P; {modules} until 1s; }}\n")
    return path


def _both(path: Path) -> tuple[Run, Run]:
    """The run of each engine; their traces are one."""
    system = system_of(check_file(str(path)), "S")
    native = NativeProgram(system).run(END_NS, 1, hash_trace=True)
    interpreted = run_interpreted(system, END_NS, 1)
    assert native.trace_sha256 == interpreted.trace_sha256
    return native, interpreted


def test_a_nan_that_is_compared_is_danger_on_both_engines(tmp_path: Path) -> None:
    native, interpreted = _both(_program(tmp_path, CASES))
    for run in (native, interpreted):
        for name, case in CASES.items():
            module = run.modules[f"M_{name}"]
            assert (module.ac_share > 0.9) == case.ac, name
            assert module.nan_looks == case.nan_looks, name


def test_a_nan_of_one_period_takes_control_for_as_long(tmp_path: Path) -> None:
    cases = {
        "ttf": Case("sqrt(s.once) > 5.0", FINE, ac=True),
        "safer": Case("s.k == 8.0", "sqrt(s.once) < 5.0 && s.k > 9.0", ac=True),
    }
    for run in _both(_program(tmp_path, cases)):
        ttf, safer = run.modules["M_ttf"], run.modules["M_safer"]
        assert (ttf.nan_looks, ttf.switches_to_sc, ttf.switches_to_ac) == (1, 1, 2)
        assert (safer.nan_looks, safer.switches_to_sc, safer.switches_to_ac) == (1, 0, 1)
        assert any("compared a NaN in 1 looks" in note for note in run.notes)


EXPLORED = """soter 1;
topic s: { far: float, near: float };
topic u: float in [0.0, 1.0];
node A period 50ms { publishes u; step { publish u = 1.0; } }
node B period 50ms { publishes u; step { publish u = 0.0; } }
rta M {
  ac A; sc B; period 50ms;
  safe s.near < 5.0; ttf sqrt(s.far) > 5.0; safer !(sqrt(s.far) > 5.0);
}
plant P period 50ms {
  drives s = { far: b ? -1.0 : 1.0, near: 1.0 };
  state b: bool = false;
  next b = choose { true, false };
}
system Q { p: P; module M; }
test T { system Q; horizon 200ms; always mode(M) == Mode.SC || u < 0.5; }
"""


def test_the_explorer_and_the_enumerator_agree_on_it() -> None:
    s = enumerated(0, EXPLORED)
    assert len(s.found.configurations) > 10
    assert not compared(s, ("-O0",)).complaints


def test_a_log_is_judged_as_the_run_was(tmp_path: Path) -> None:
    cases = {"ttf": Case("sqrt(s.once) > 5.0", FINE, ac=True)}
    program = load(_program(tmp_path, cases))
    run = program.simulate(seed=1, log=tmp_path / "run.mcap")
    fields = {n: n for n in ("k", "minus", "two", "huge", "zero", "once")}
    mapping = {"topics": {"s": {"channel": "s", "fields": fields}}}
    (judged,) = program.judge_log(tmp_path / "run.mcap", mapping).modules
    assert judged.nan_looks == run.modules["M_ttf"].nan_looks == 1
    assert [c.to for c in judged.changes] == ["AC", "SC", "AC"]


ENDS = (0.0, -0.0, 5e-324, 1e-308, 1e-9, 0.5, 1.0, 1.5, 3.0, 1e5, 1e9, 1e300, 1.7e308, math.inf)


@all_rows("name", sorted(TOTAL))
def test_a_function_of_the_prelude_is_a_number_in_its_domain_and_keeps_a_nan(
    name: str, tmp_path: Path
) -> None:
    of = "xy"[: len(BOUNDS[name].domain)]
    parameters = ", ".join(f"{x}: float" for x in of)
    text = f"soter 1;\nfun f({parameters}): float {{ return {name}({', '.join(of)}); }}\n"
    (tmp_path / "f.soter").write_text(text)
    call = load(tmp_path / "f.soter").function("f")
    ends = [s * x for x in ENDS for s in (1.0, -1.0)]
    domain = ((0.0, math.inf), BOUNDS[name].domain[1]) if name == "pow" else BOUNDS[name].domain
    for x in ends:
        given = [[v for v in ends if low <= v <= high] for low, high in domain[1:]]
        for rest in given[0] if given else [None]:
            arguments = [x] if rest is None else [x, rest]
            inside = domain[0][0] <= x <= domain[0][1]
            result = call(*arguments)
            assert not (inside and math.isnan(result)), arguments
            for k in range(len(arguments)):
                with_nan = [math.nan if i == k else v for i, v in enumerate(arguments)]
                assert math.isnan(call(*with_nan)), with_nan


BOUNDED = """soter 1;
topic s: {{ x: float, v: float }} in {{ x in [-10.0, 10.0], v in [-5.0, 5.0] }};
topic free: float;
topic u: float in [0.0, 1.0];
fun stop(v: float): float {{ return v * abs(v) / (2.0 * 3.0) + sin(v) + hypot(v, 1.0); }}
node A period 50ms {{ publishes u; step {{ publish u = 1.0; }} }}
node B period 50ms {{ publishes u; step {{ publish u = 0.0; }} }}
rta M {{
  ac A; sc B; period 50ms; safe s.x < 9.0;
  ttf {ttf}; safer s.x < 1.0;
}}
plant P period 50ms {{ drives s = {{ x: x, v: 0.0 }}; drives free = 0.0; state x: float; }}
system S default {{ p: P; module M; until 1s; }}
"""


@all_rows(
    ("ttf", "may"),
    [
        ("s.x + stop(s.v) > 8.0", False),
        ("sqrt(s.x * s.x + s.v * s.v) > 8.0", False),
        ("free * free + abs(free) > 8.0", False),
        ("free > 8.0 || age(free) > 0.2", False),
        ("norm(vec2(free, s.v)) / 3.0 > exp(free)", False),
        ("acos(s.v / 5.0) > 1.0 || min(s.x, free) > 8.0", False),
        ("s.x / s.v > 3.0 && int(s.x) < 3", False),
        ("sqrt(s.x) > 1.0", True),
        ("acos(s.v) > 1.0", True),
        ("free * free - free * s.x > 1.0", True),
        ("max(s.x, log(s.v)) > 1.0", True),
        ("s.x / s.v - free / s.v > 1.0", True),
    ],
)
def test_what_cannot_be_nan_is_not_looked_at(ttf: str, may: bool, tmp_path: Path) -> None:
    (tmp_path / "b.soter").write_text(BOUNDED.format(ttf=ttf))
    system = system_of(check_file(str(tmp_path / "b.soter")), "S")
    assert bool(maybe_nan(system, system.modules[0])) is may
    (decision,) = lower(system).decisions
    assert (decision.ttf.maybe_nan, decision.safer.maybe_nan) == (may, False)


def test_a_ttf_that_only_a_nan_fulfils_is_not_told_to_never_hold(tmp_path: Path) -> None:
    for ttf, told in (("sqrt(s.x) < -1.0", False), ("abs(s.x) < -1.0", True)):
        (tmp_path / "b.soter").write_text(BOUNDED.format(ttf=ttf))
        checked = check_file(str(tmp_path / "b.soter"))
        assert ("W022" in [d.code for d in checked.diagnostics.items]) is told


LISTS = """
topic pts: float[<=3];
plant Points period 50ms { drives pts = [1.0, 2.0]; state y: float = 0.0; next y = y; }
fun set_in(q: float[<=3]): bool { var r = q; r[0] = sqrt(-1.0); return r[0] > 5.0; }
fun set_in_loop(q: float[<=3]): bool {
  var r = q;
  for i in 0..2 { r[i] = sqrt(-1.0); }
  for v in r { if v > 5.0 { return true; } }
  return false;
}
fun pushed(q: float[<=3]): bool { var r = q; push r, sqrt(-1.0); return r[2] > 5.0; }
fun untouched(q: float[<=3]): bool { var r = q; return r[0] > 5.0; }
"""


def test_an_element_of_a_list_that_was_set_may_be_nan(tmp_path: Path) -> None:
    names = ("set_in", "set_in_loop", "pushed", "untouched")
    cases = {name: Case(f"{name}(pts)", FINE, ac=name == "untouched") for name in names}
    path = _program(tmp_path, cases)
    path.write_text(path.read_text().replace("p: P;", "p: P; q: Points;") + LISTS)
    for run in _both(path):
        for name, case in cases.items():
            assert (run.modules[f"M_{name}"].ac_share > 0.9) == case.ac, name


COUNTS = "#include <stdint.h>\nstatic int64_t n;\nint64_t count(int64_t x) { return x + n++; }\n"


def test_two_calls_of_an_extern_are_not_one_value(tmp_path: Path) -> None:
    (tmp_path / "count.c").write_text(COUNTS)
    cases = {
        "extern": Case("!(count(1) == count(1)) && sqrt(s.minus) > 1.0", FINE, ac=False),
        "below": Case("!(below(1) == below(1)) && sqrt(s.minus) > 1.0", FINE, ac=False),
    }
    path = _program(tmp_path, cases)
    extern = """extern fun count(x: int): int from "c:count.c:count";
fun below(x: int): int { return count(x) + 1; }
"""
    path.write_text(path.read_text() + extern)
    for engine in ("native", "interp"):
        run = load(path).simulate(engine=engine)
        for name in cases:
            assert run.modules[f"M_{name}"].ac_share < 0.9, (engine, name)
