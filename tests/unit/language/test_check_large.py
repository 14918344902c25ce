"""Programs of a size, or with numbers, that nobody writes: checked by little work."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import KEPT_MAX, Diagnostics
from soter.language.check import constants_and_types
from soter.language.elaborate.lints import step_lints
from soter.language.front_end import CheckResult, check_file, system_of
from work import work_of

if TYPE_CHECKING:
    from collections.abc import Iterator

CALLS_MAX = 30_000_000
"""Twice what the dearest of these programs takes; what is quadratic in thousands takes far more."""

PLANT = """
topic pos: float;
input topic force: float in [-1.0, 1.0];
plant Cart period 10ms { reads force; drives pos = x; state x: float; der x = force; }
"""


def check(text: str) -> CheckResult:
    checked, calls = work_of(lambda: check_file("large.soter", "soter 1;\n" + text))
    assert calls <= CALLS_MAX
    return checked


def codes(text: str) -> list[str]:
    return [d.code for d in check(text).diagnostics.items]


def lines(count: int, template: str) -> str:
    return "\n".join(template.format(i=i, j=i + 1) for i in range(count)) + "\n"


# ---------------------------------------------------------------- many of a kind


def test_five_thousand_topics_and_two_thousand_nodes() -> None:
    topics = lines(5000, "topic t{i}: float in [0.0, 1.0];")
    nodes = "".join(
        f"node N{i} period {(1, 2, 4, 5, 10)[i % 5]}ms {{\n"
        f"  subscribes t{(i + 7) % 2000};\n  publishes t{i};\n"
        f"  step {{ publish t{i} = t{(i + 7) % 2000}; }}\n}}\n"
        for i in range(2000)
    )
    checked = check(topics + nodes)
    assert checked.ok
    assert len(system_of(checked, None).components) == 2000


def test_a_node_that_reads_five_thousand_topics() -> None:
    names = ", ".join(f"t{i}" for i in range(5000))
    reads = " ".join(f"assert t{i} < 3.0;" for i in range(5000))
    topics = lines(5000, "input topic t{i}: float in [0.0, 1.0];")
    assert codes(topics + f"node A period 10ms {{ subscribes {names}; step {{ {reads} }} }}") == []


def test_fifteen_hundred_modules() -> None:
    text = "input topic x: float in [-1.0, 1.0];\n" + lines(
        1500,
        "topic u{i}: float in [-1.0, 1.0];\n"
        "node A{i} period 10ms {{ subscribes x; publishes u{i}; step {{ publish u{i} = x; }} }}\n"
        "node S{i} period 10ms {{ publishes u{i}; step {{ publish u{i} = 0.0; }} }}\n"
        "rta M{i} {{ ac A{i}; sc S{i}; period 20ms; safe x < 2.0; ttf x > 0.5; safer x < 0.4; }}",
    )
    assert codes(text) == []


def test_ten_thousand_mistakes() -> None:
    error_codes = codes(lines(10_000, "fun f{i}(x: float): int {{ return x; }}"))
    assert error_codes == ["T001"] * KEPT_MAX + ["S021"]


@pytest.mark.parametrize("count", [1000, 5000])
def test_thousands_of_unknown_names(count: int) -> None:
    error_codes = codes(lines(count, "const CONSTANT_{i}: float = CONSTENT_{i};"))
    assert error_codes == ["N001"] * KEPT_MAX + ["S021"]


def test_names_of_half_a_megabyte() -> None:
    a, b = "a" * 500_000, "b" * 500_000
    assert codes(f"const {a}: float = {b};") == ["N001"]


# ---------------------------------------------------------------- long chains


def test_a_chain_of_five_thousand_constants() -> None:
    text = lines(5000, "const C{i}: float = C{j} + 1.0;") + "const C5000: float = 1.0;"
    checked = check(text)
    assert checked.ok
    assert checked.program is not None
    assert checked.program.consts["C0"].value == 5001.0


def test_a_circle_of_five_thousand_constants() -> None:
    text = lines(4999, "const C{i}: float = C{j} + 1.0;") + "const C4999: float = C0;"
    assert codes(text) == ["T012"]


def test_a_chain_of_constants_through_functions() -> None:
    text = lines(2000, "const C{i}: float = f{i}();\nfun f{i}(): float {{ return C{j} + 1.0; }}")
    assert codes(text + "const C2000: float = 1.0;") == []


def test_a_chain_of_five_thousand_calls() -> None:
    text = lines(5000, "fun f{i}(x: float): float {{ return f{j}(x); }}")
    assert codes(text + "fun f5000(x: float): float { return x; }") == []


def test_a_circle_of_five_thousand_calls() -> None:
    text = lines(4999, "fun f{i}(x: float): float {{ return f{j}(x); }}")
    assert codes(text + "fun f4999(x: float): float { return f0(x); }") == ["T006"]


def test_five_thousand_types_inside_each_other() -> None:
    text = lines(5000, "type T{i} = {{ a: T{j}, b: T{j} }};") + "type T5000 = { x: float };"
    assert codes(text) == ["T011"]


def test_a_type_of_sixty_thousand_numbers_in_use() -> None:
    text = lines(16, "type T{i} = {{ a: T{j}, b: T{j} }};") + "type T16 = { x: float };\n"
    text += lines(8, "topic t{i}: T0 in [0.0, 1.0];")
    body = "c = a + b; " * 300
    assert codes(text + f"fun f(a: T0, b: T0): T0 {{ var c = a; {body} return c; }}") == []


def test_three_thousand_systems_inside_each_other() -> None:
    text = PLANT + lines(3000, "system S{i} {{ a: S{j}; }}") + "system S3000 { c: Cart; }"
    assert codes(text) == ["M007"]


@pytest.mark.whole
def test_a_circle_of_three_thousand_systems() -> None:
    text = lines(2999, "system S{i} {{ a: S{j}; }}") + "system S2999 { a: S0; }"
    assert codes(text) == ["T012"]


def test_fifty_systems_inside_each_other() -> None:
    text = PLANT + "".join(
        f"system S{i} {{ a: S{i + 1}; always a{'.a' * (48 - i)}.c.truth.x < 1.0; }}\n"
        for i in range(49)
    )
    checked = check(text + "system S49 default { c: Cart; until 1s; }")
    assert checked.ok
    system = system_of(checked, "S0")
    assert system.components[0].name == "a." * 49 + "c"
    assert len(system.properties) == 49


def test_systems_that_double_fifty_times() -> None:
    text = PLANT + lines(50, "system S{i} {{ a: S{j}; b: S{j}; }}") + "system S50 { c: Cart; }"
    assert set(codes(text)) == {"M007"}


@pytest.mark.parametrize("blocks", [40, 62])
@pytest.mark.parametrize(
    ("before", "middle", "after"),
    [("f(", "x", ")"), ("-(", "x", ")"), ("x + (", "x", ")"), ("true ? x : (", "x", ")")],
)
def test_the_deepest_tree_that_parses(blocks: int, before: str, middle: str, after: str) -> None:
    levels = 190 if before == "f(" else 95
    expression = before * levels + middle + after * levels
    text = (
        "fun f(x: float): float { return x; }\ntopic y: float;\n"
        "node N period 10ms { publishes y; var u: float; step { let x = u; "
        + "if u >= 0.0 { " * blocks
        + f"u = {expression};"
        + " }" * blocks
        + " publish y = u; } }"
    )
    assert codes(text) == []


# ---------------------------------------------------------------- large numbers and sizes


def test_literals_of_ten_thousand_digits() -> None:
    digits = "9" * 10_000
    for t in ("int", "float", "bool", "float[2]", "int in [0, 3]"):
        assert codes(f"const A: {t} = {digits};") == ["L005"]
        assert codes(f"const A: {t} = {digits}.0;") == ["L005"]
        assert codes(f"const A: {t} = {digits}ms;") == ["L005"]
    assert codes(f"type T = float[{digits}];") == ["L005"]


@pytest.mark.parametrize("size", ["100000", "99999999999999999999", "9223372036854775807", "0"])
def test_sizes_that_multiply_beyond_measure(size: str) -> None:
    error_codes = codes(
        f"type A = float[{size}];\ntype B = A[{size}];\ntype C = B[{size}];\ntopic c: C;"
    )
    assert error_codes == (["T016"] * 3 if len(size) == 20 else ["T011"])


def test_an_enum_of_a_hundred_thousand_members() -> None:
    members = ", ".join(f"A{i}" for i in range(100_000))
    assert codes(f"type T = enum {{ {members} }};\ntopic t: T;") == ["T011"]


def test_an_array_of_a_hundred_thousand_elements() -> None:
    elements = ", ".join(["1.0"] * 100_000)
    assert codes(f"const A: float[100000] = [{elements}];\ntopic x: float[100000] = A;") == []


def test_a_hundred_topics_of_a_hundred_thousand_numbers() -> None:
    text = lines(100, "input topic t{i}: float[100000] in [0.0, 1.0];")
    names = ", ".join(f"t{i}" for i in range(100))
    reads = " ".join(f"assert t{i}[0] < 2.0;" for i in range(100))
    node = f"node A period 10ms {{ subscribes {names}; step {{ {reads} }} }}\n"
    assert codes(text + node + "system S { node A; }") == ["M007"]


@pytest.fixture
def _budgets_of_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """That a check ends hangs on budgets alone: they may be twenty seconds as well."""
    monkeypatch.setattr(constants_and_types, "CONSTANT_BUDGET", 1_000_000)
    monkeypatch.setattr(constants_and_types, "PROGRAM_BUDGET", 2_000_000)


@pytest.mark.usefixtures("_budgets_of_a_second")
def test_constants_that_compute_for_ever() -> None:
    loop = "for i in 0..900 {{ for j in 0..900 {{ s = s + i * j; }} }}"
    text = lines(50, "fun f{i}(): int {{ var s = 0; " + loop + " return s; }}")
    error_codes = codes(text + lines(50, "const A{i}: int = f{i}();"))
    assert error_codes == ["T020", "T020"]


@pytest.mark.usefixtures("_budgets_of_a_second")
def test_constants_that_copy_for_ever() -> None:
    text = "type V = float[1000];\nfun f(v: V): V { var s = v; "
    text += "for i in 0..1000 { s = s + v; } return s; }\nconst Z: V = ["
    text += ", ".join(["1.0"] * 1000) + "];\n"
    assert codes(text + lines(50, "const A{i}: V = f(Z);"))[0] == "T020"


def test_loops_in_loops_in_loops() -> None:
    loops = "for i{i} in 0..1000000 {{ "
    body = "".join(loops.format(i=i) for i in range(20)) + "s = s + 1;" + " }" * 20
    assert codes(f"fun f(): int {{ var s = 0; {body} return s; }}") == ["T007"]


# ---------------------------------------------------------------- many mistakes

FEW = 100_000
"""Comparisons of names that a check may make, whatever is wrong."""

MISSPELT = {
    "fields": "type R = {{ {names} }};\nfun f(r: R): float {{ var s = 0.0; {uses} return s; }}",
    "members": "type E = enum {{ {members} }};\nfun f(s: E): bool {{ {tests} return true; }}",
    "values": "{consts}\nfun f(): float {{ var s = 0.0; {reads} return s; }}",
    "types": "{types}\n{topics}",
    "statements": "fun f(): float {{ {words} return 1.0; }}",
}


@pytest.mark.parametrize("kind", MISSPELT)
def test_many_misspelt_names_are_not_all_compared(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    known, wrong = range(600), range(3000)
    text = MISSPELT[kind].format(
        names=", ".join(f"alpha{i}: float" for i in known),
        uses=" ".join(f"s = s + r.alhpa{i};" for i in wrong),
        members=", ".join(f"alpha{i}" for i in known),
        tests=" ".join(f"assert s == E.alhpa{i};" for i in wrong),
        consts=" ".join(f"const alpha{i}: float = 1.0;" for i in known),
        reads=" ".join(f"s = s + alhpa{i};" for i in wrong),
        types=" ".join(f"type alpha{i} = float[2];" for i in known),
        topics=" ".join(f"topic t{i}: alhpa{i};" for i in wrong),
        words=" ".join(f"lett{i} x = 1.0;" for i in wrong),
    )
    compared = 0
    real = difflib.SequenceMatcher.set_seq1

    def counting(self: difflib.SequenceMatcher[str], a: str) -> None:
        nonlocal compared
        compared += 1
        real(self, a)

    monkeypatch.setattr(difflib.SequenceMatcher, "set_seq1", counting)
    assert check(text).diagnostics.has_errors
    assert compared < FEW


def test_names_are_looked_at_only_while_somebody_reads_the_suggestions() -> None:
    looked = 0

    def names() -> Iterator[str]:
        nonlocal looked
        for i in range(10_000):
            looked += 1
            yield f"alpha{i}"

    diagnostics = Diagnostics()
    assert diagnostics.did_you_mean("alhpa17", names()) == ("did you mean `alpha17`?",)
    for i in range(10_000):
        diagnostics.did_you_mean(f"alhpa{i}", names())
    assert looked < FEW


def test_a_list_before_an_enum_in_what_is_false_at_the_start_has_its_first_value() -> None:
    text = """soter 1;
type Kind = enum { Near, Far };
type Seen = { at: float[<=3], kind: Kind };
topic seen: Seen;
plant Eyes period 10ms {
  reads turn; drives seen = { at: [x, x], kind: Kind.Near }; state x: float = 0.5; der x = turn;
}
topic turn: float in [-1.0, 1.0] = 0.0;
node Fast period 10ms { publishes turn; step { publish turn = 1.0; } }
node Slow period 10ms { publishes turn; step { publish turn = 0.0; } }
rta Guard { ac Fast; sc Slow; period 10ms; safe SAFE; ttf turn > 0.5; safer turn < 0.4; }
system S { e: Eyes; module Guard; until 1s; }
"""
    for safe in ("seen.kind == Kind.Far", "seen.at.len > 0 && seen.kind == Kind.Far"):
        checked = check_file("seen.soter", text.replace("SAFE", safe))
        (said,) = [d for d in checked.diagnostics.items if d.code == "W021"]
        assert said.primary is not None
        assert said.primary.text == "false where `seen` has its first value"


STEP = """soter 1;
input topic speed: float in [-2.0, 2.0] = 0.0;
topic turn: float in [-1.0, 1.0] = 0.0;
node Fast period 10ms {
  subscribes speed; publishes turn;
  step {
    if speed > 1.0 { publish turn = 3.0; } elseif speed + speed < -2.0 { publish turn = -5.0; }
    publish turn = speed * 0.25;
  }
}
system S { node Fast; until 1s; }
"""


def test_looking_through_a_step_may_become_too_hard_anywhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Where it does, fewer values are doubted, and nothing else happens."""
    said = []
    for budget in range(60):
        monkeypatch.setattr(step_lints, "BUDGET", budget)
        checked = check_file("step.soter", STEP)
        assert checked.ok, checked.diagnostics.items
        said.append([d.code for d in checked.diagnostics.items].count("W015"))
    assert said == sorted(said)
    assert {0, 1, 2} == set(said)
