"""The enclosures of a module against the evaluator: law, derivative, next, predicates, drives.

Random points of states, errors, disturbances, controls and others of two verification systems, one
a flow and one a map: what the program computes there must lie in what the emitted functions say of
a box around them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cffi
import pytest

from generators.engine_comparison import call_compiler
from generators.python_enclosures import holds, seeded, set_input
from soter.core.steps import lower
from soter.language.evaluate.environment import Environment
from soter.language.evaluate.statements import Evaluator
from soter.language.front_end import check_file, system_of
from soter.native.shared_library import CHECK_FAILED
from soter.verify.enclose.compiled_enclosures import generate_enclosures
from soter.verify.enclose.enclosure_emitter import EnclosureError
from soter.verify.problem.problem import Leaf, Quantities

if TYPE_CHECKING:
    import random
    from pathlib import Path

    from soter.language.model.system import Component, System

BOXES, POINTS = 60, 12

COMMON = """soter 1;
type Seen = { x: float, v: float, gear: int in [0, 2] };
type Command = { push: float, light: bool };
const FORCE: float[3] = [1.0, 2.5, 4.0];
topic seen: Seen max_age 20ms;
topic force: Command in { push in [-4.0, 4.0] };
input topic goal: float in [-2.0, 2.0] = 0.5;
fun Limit(g: int in [0, 2]): float { return FORCE[g]; }
node Fast period 10ms {
  subscribes seen; publishes force;
  step { publish force = { push: 4.0, light: seen.x > 0.0 }; }
}
node Careful period 10ms {
  subscribes seen, goal; publishes force;
  var kept: int in [0, 3] = 1;
  on takeover { kept = 2; }
  step {
    let wanted = float(kept + 1) * (goal - seen.x) - 3.0 * seen.v;
    let limit = Limit(seen.gear);
    kept = min(kept + 1, 3);
    if abs(seen.v) < 2.5 {
      publish force = { push: clamp(wanted, -limit, limit), light: wanted > 0.0 };
    }
  }
}
rta Safe {
  ac Fast; sc Careful; period 50ms;
  safe seen.x < 1.5 && seen.x * seen.x < 4.0;
  ttf seen.x + 0.25 * abs(seen.v) > 1.0 + 0.1 * goal;
  safer seen.x + 0.5 * seen.v < 0.5;
}
"""
MEASURED = "measured seen.x within 0.02, seen.v within 0.05;"
STATES = "state x: float = 0.0; state v: float = 0.0; state gear: int in [0, 2] = 1;"
FLOW = (
    COMMON
    + f"""
plant Cart period 5ms {{
  reads force; drives seen = {{ x: x, v: v, gear: gear }}; {STATES}
  disturbance wind: float in [-0.2, 0.2];
  let drag = v * abs(v);
  der x = v;
  der v = force.push - 0.1 * drag + wind * sin(x);
  {MEASURED}
}}
system One {{ cart: Cart; module Safe; input goal every 50ms; }}
"""
)
MAP = (
    COMMON
    + f"""
plant Cart period 5ms {{
  reads force; drives seen = {{ x: x, v: v, gear: gear }}; {STATES}
  disturbance wind: float in [-0.2, 0.2];
  let drag = v * abs(v);
  next x = min(x + 0.1 * v, 3.0);
  next v = force.light ? v + 0.1 * (force.push - drag + wind) : 0.5 * v;
  {MEASURED}
}}
system One {{ cart: Cart; module Safe; input goal every 50ms; }}
"""
)


@dataclass
class Case:
    """A verification system with its compiled enclosures."""

    system: System
    quantities: Quantities
    ranges: list[tuple[float, float]]
    ffi: Any
    library: Any
    functions: tuple[str, ...]


def case(text: str, folder: Path) -> Case:
    """Compile the enclosures of the only module."""
    system = system_of(check_file("cart.soter", text), None)
    cart = system.component("cart").index
    seen, force, goal = (system.topic(n).index for n in ("seen", "force", "goal"))
    q = Quantities(
        (Leaf(cart, "x", (), "cart.x"), Leaf(cart, "v", (), "cart.v")),
        (Leaf(force, "", ("push",), "push"), Leaf(force, "", ("light",), "light")),
        (Leaf(cart, "wind", (), "wind"),),
        (Leaf(seen, "", ("x",), "e x"), Leaf(seen, "", ("v",), "e v")),
        (Leaf(goal, "", (), "goal"),),
        (Leaf(cart, "gear", (), "gear"),),
    )
    ranges = [(-3.0, 3.0), (-3.0, 3.0), (-4.0, 4.0), (0.0, 1.0), (-0.2, 0.2)]
    ranges += [(-0.02, 0.02), (-0.05, 0.05), (-2.0, 2.0)]
    unit = generate_enclosures(system, lower(system), system.modules[0], q)
    assert set(unit.prelude) == ({"sin"} if "sin(" in text else set())
    (folder / "unit.c").write_text(unit.source, encoding="utf-8")
    built = folder / "unit.so"
    call_compiler(
        folder,
        "-O1",
        "-fPIC",
        "-shared",
        "-o",
        str(built),
        str(folder / "unit.c"),
        str(CHECK_FAILED),
        "-lm",
    )
    ffi = cffi.FFI()
    count = len(ranges)
    ffi.cdef(f"typedef struct {{ double lo, hi, c, r; double g[{count}]; }} soter_form;")
    for name in unit.functions:
        out = "soter_form" if name in NUMBERS else "unsigned char"
        ffi.cdef(f"unsigned {name}(const soter_form in[], const int64_t param[], {out} out[]);")
    return Case(system, q, ranges, ffi, ffi.dlopen(str(built)), unit.functions)


NUMBERS = frozenset(f"soter_{n}" for n in ("law", "law_0", "law_1", "derivative", "next", "drives"))


class Reference:
    """The program's own answers."""

    def __init__(self, system: System) -> None:
        self.system = system
        self.plant: Component = system.component("cart")
        self.sc = system.components[system.modules[0].sc]
        self.seen, self.force, self.goal = (
            system.topic(n).index for n in ("seen", "force", "goal")
        )

    def topics(self, at: list[float], gear: int, *, estimated: bool) -> list[Any]:
        """Every topic at a point."""
        x, v, push, light, _wind, e_x, e_v, goal = at
        values: list[Any] = [None] * len(self.system.topics)
        values[self.seen] = (x + e_x, v + e_v, gear) if estimated else (x, v, gear)
        values[self.force] = (push, bool(light))
        values[self.goal] = goal
        return values

    def law(self, at: list[float], gear: int, kept: int) -> list[float] | None:
        """What SC publishes; None where it does not."""
        node = self.sc.node
        assert node is not None
        env = Environment(
            {node.locals[0]: kept}, topics=self.topics(at, gear, estimated=True),
            period_ns=self.sc.period_ns,
        )  # fmt: skip
        Evaluator.for_scope(self.sc.scope).compiled_block(node.step)(env)
        value = env.published.get(self.force)
        return None if value is None else [float(x) for x in value]

    def motion(self, at: list[float], gear: int) -> list[float]:
        """Derivatives or next values of the states."""
        plant = self.plant.plant
        assert plant is not None
        x, v, gear_state = plant.states
        wind = self.plant.disturbances[0].variable
        env = Environment(
            {x: at[0], v: at[1], gear_state: gear, wind: at[4]},
            topics=self.topics(at, gear, estimated=False), period_ns=self.plant.period_ns,
        )  # fmt: skip
        evaluator = Evaluator.for_scope(self.plant.scope)
        for variable, value in plant.lets:
            env.variables[variable] = evaluator.compiled(value)(env)
        table = plant.der or plant.next
        return [evaluator.compiled(table[s])(env) for s in (x, v)]

    def predicate(self, name: str, at: list[float], gear: int) -> bool:
        """`safe` on the true topics, the others on estimates."""
        module = self.system.modules[0]
        e = getattr(module.symbol, name)
        env = Environment(topics=self.topics(at, gear, estimated=name != "safe"))
        return bool(Evaluator.for_scope(module.scope).compiled(e)(env))


def boxes(rng: random.Random, ranges: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """A box inside the ranges, of any size; the light is on, off or either."""
    box = []
    scale = 10.0 ** rng.uniform(-4, 0)
    for i, (low, high) in enumerate(ranges):
        if i == 3:
            box.append(rng.choice([(0.0, 0.0), (1.0, 1.0), (0.0, 1.0)]))
            continue
        middle, half = rng.uniform(low, high), 0.5 * (high - low) * scale
        box.append((max(low, middle - half), min(high, middle + half)))
    return box


def point(rng: random.Random, box: list[tuple[float, float]]) -> list[float]:
    """A point of a box, often at its corners."""
    at = [rng.choice((a, b, min(max(rng.uniform(a, b), a), b))) for a, b in box]
    at[3] = rng.choice(box[3])
    return at


@pytest.mark.parametrize(("text", "moves"), [(FLOW, "soter_derivative"), (MAP, "soter_next")])
def test_what_a_module_does_lies_in_its_enclosures(text: str, moves: str, tmp_path: Path) -> None:
    k = case(text, tmp_path)
    names = ("law", moves.removeprefix("soter_"), "drives", "safe", "ttf", "safer")
    assert {f"soter_{n}" for n in names} <= set(k.functions)
    reference = Reference(k.system)
    rng = seeded(moves)
    forms = k.ffi.new("soter_form[]", len(k.ranges))
    param = k.ffi.new("int64_t[]", 1)
    tally = dict.fromkeys(("published", "silent", "decided", "narrow"), 0)
    for _ in range(BOXES):
        box = boxes(rng, k.ranges)
        for i, (low, high) in enumerate(box):
            for j in range(len(box)):
                forms[i].g[j] = 0.0
            set_input(forms[i], i, low, high)
        gear = param[0] = rng.randint(0, 2)
        law, motion, drives = (k.ffi.new("soter_form[]", 3) for _ in range(3))
        assert k.library.soter_law(forms, param, law) == 0
        alone = k.ffi.new("soter_form[]", 2)
        assert k.library.soter_law_0(forms, param, alone) == 0
        assert k.library.soter_law_1(forms, param, alone) == 0
        assert getattr(k.library, moves)(forms, param, motion) == 0
        assert k.library.soter_drives(forms, param, drives) == 0
        said = {}
        for name in ("safe", "ttf", "safer"):
            truth = k.ffi.new("unsigned char[]", 1)
            assert getattr(k.library, f"soter_{name}")(forms, param, truth) == 0
            said[name] = truth[0]
            tally["decided"] += truth[0] != 3
        tally["narrow"] += law[0].hi - law[0].lo < 0.5
        for _ in range(POINTS):
            at = point(rng, box)
            published = reference.law(at, gear, kept=rng.randint(0, 3))
            tally["silent" if published is None else "published"] += 1
            for i, value in enumerate(published or [rng.uniform(-4, 4), rng.choice((0.0, 1.0))]):
                assert holds(law[i], value, forms, at), ("law", at, value)
                assert holds(alone[i], value, forms, at), ("law_K", at, value)
            for i, value in enumerate(reference.motion(at, gear)):
                assert holds(motion[i], value, forms, at), (moves, at, value)
            for i, value in enumerate((at[0], at[1], float(gear))):
                assert holds(drives[i], value, forms, at), ("drives", at, value)
            for name, truth in said.items():
                held = reference.predicate(name, at, gear)
                assert truth & (2 if held else 1), (name, at, held)
    assert all(n > BOXES / 4 for n in tally.values()), tally


def test_a_command_that_may_leave_its_set_is_a_possible_fault(tmp_path: Path) -> None:
    text = FLOW.replace("clamp(wanted, -limit, limit)", "wanted").replace(
        "abs(seen.v) < 2.5", "true"
    )
    k = case(text, tmp_path)
    reference = Reference(k.system)
    forms = k.ffi.new("soter_form[]", len(k.ranges))
    param = k.ffi.new("int64_t[]", [1])
    out = k.ffi.new("soter_form[]", 2)
    for x, fault in ((0.5, 0), (-3.0, 1)):
        for i, value in enumerate((x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)):
            set_input(forms[i], i, value, value)
        assert k.library.soter_law(forms, param, out) == fault
        assert k.library.soter_law_0(forms, param, out) == fault
        assert k.library.soter_law_1(forms, param, out) == 0, "the light alone cannot fault"
    assert reference.law([0.5, 0, 0, 0, 0, 0, 0, 0.5], 1, 0) == [0.0, 0.0]


@pytest.mark.parametrize("where", ["all ways", "one way"])
def test_a_record_constant_that_is_published_is_enclosed(where: str, tmp_path: Path) -> None:
    computed = "{ push: clamp(wanted, -limit, limit), light: wanted > 0.0 }"
    begin, end = FLOW.index("if abs(seen.v) < 2.5"), FLOW.index("rta Safe")
    law = "STOP" if where == "all ways" else f"seen.x < 0.0 ? STOP : {computed}"
    text = f"{FLOW[:begin]}publish force = {law}; }} }}\n{FLOW[end:]}".replace(
        "node Careful", "const STOP: Command = { push: -1.5, light: true };\nnode Careful"
    )
    k = case(text, tmp_path)
    reference = Reference(k.system)
    forms = k.ffi.new("soter_form[]", len(k.ranges))
    param = k.ffi.new("int64_t[]", [1])
    out = k.ffi.new("soter_form[]", 2)
    for x in (-0.5, 0.25):
        at = [x, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]
        for i, value in enumerate(at):
            set_input(forms[i], i, value, value)
        assert k.library.soter_law(forms, param, out) == 0
        laws = [reference.law(at, 1, kept) for kept in range(4)]
        for i in range(2):
            assert all(law is not None and out[i].lo <= law[i] <= out[i].hi for law in laws)
        if where == "all ways" or x < 0.0:
            assert [(f.lo, f.hi) for f in out] == [(-1.5, -1.5), (1.0, 1.0)]


def test_a_record_constant_that_a_plant_drives_is_enclosed(tmp_path: Path) -> None:
    text = FLOW.replace("reads force;", "reads force; drives far = FAR;").replace(
        "node Careful",
        "type Far = { a: float, b: float };\nconst FAR: Far = { a: 0.5, b: 2.0 };\n"
        "topic far: Far in [-1.0, 1.0];\nnode Careful",
    )
    k = case(text, tmp_path)
    forms = k.ffi.new("soter_form[]", len(k.ranges))
    for i, value in enumerate((0.5, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5)):
        set_input(forms[i], i, value, value)
    out = k.ffi.new("soter_form[]", 5)
    assert k.library.soter_drives(forms, k.ffi.new("int64_t[]", [1]), out) == 0
    driven = sorted((f.lo, f.hi) for f in out)
    assert driven == [(0.25, 0.25), (0.5, 0.5), (0.5, 0.5), (1.0, 1.0), (2.0, 2.0)]


def test_what_is_first_read_in_a_branch_is_read_behind_it_too(tmp_path: Path) -> None:
    """An estimate that only one side of a branch made is none on the other, nor behind."""
    wanted = "let wanted = float(kept + 1) * (goal - seen.x) - 3.0 * seen.v;"
    assert wanted in FLOW
    text = FLOW.replace(
        wanted,
        "var wanted = 0.0; if kept > 1 { wanted = goal - seen.x; } else { wanted = -seen.v; }",
    )
    k = case(text, tmp_path)
    reference = Reference(k.system)
    forms = k.ffi.new("soter_form[]", len(k.ranges))
    param = k.ffi.new("int64_t[]", [1])
    out = k.ffi.new("soter_form[]", 2)
    at = [0.5, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5]
    for i, value in enumerate(at):
        set_input(forms[i], i, value, value)
    assert k.library.soter_law(forms, param, out) == 0
    for kept in (0, 3):
        law = reference.law(at, 1, kept)
        assert law is not None
        assert out[0].lo <= law[0] <= out[0].hi


def test_the_constraint_is_about_the_true_state(tmp_path: Path) -> None:
    """`safe` does not see the errors, `safer` does."""
    k = case(FLOW, tmp_path)
    forms = k.ffi.new("soter_form[]", len(k.ranges))
    param = k.ffi.new("int64_t[]", [1])
    for i, value in enumerate((1.49, -2.0, 0.0, 0.0, 0.0, 0.02, 0.05, 0.5)):
        set_input(forms[i], i, value, value)
    out = k.ffi.new("unsigned char[]", 1)
    assert k.library.soter_safe(forms, param, out) == 0
    assert out[0] == 2
    assert k.library.soter_safer(forms, param, out) == 0
    assert out[0] == 1


def test_extern_controllers_are_refused() -> None:
    extern = COMMON.replace("sc Careful;", "sc Foreign;").replace(
        "rta Safe",
        "extern node Foreign period 10ms { subscribes seen; publishes force; }\nrta Safe",
    )
    text = FLOW.replace(COMMON, extern)
    system = system_of(check_file("cart.soter", text), None)
    with pytest.raises(EnclosureError, match="extern"):
        generate_enclosures(
            system, lower(system), system.modules[0], Quantities((), (), (), (), (), ())
        )
