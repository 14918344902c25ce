"""Large values of generated C go by address: every copy that must be made is made (decision 109).

`large_values.soter` has what could go wrong; each of its functions and nodes differs from the
interpreter where one rule of `codegen/storage_plan.py` is left out.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter import load
from soter.api.deploy.building import stack_bound
from soter.codegen.unit import generate
from soter.language.front_end import check_file, system_of
from soter.simulate.run import NativeProgram, run_interpreted

if TYPE_CHECKING:
    from soter.language.model.system import System

PROGRAM = Path(__file__).parent / "large_values.soter"
UNTIL_NS = 2_000_000_000
FAULTS = """faults {
    bias Wider.wide.cost by 1.5 at 20000 per 1h for 40ms;
    stuck Wider.wide.a[3] at 15000 per 1h for 60ms;
    silent Keeper at 20000 per 1h for 40ms;
  }"""


def flat_of(folder: Path, faults: str = "") -> System:
    """The system of the program; a cache of compiled ones does not know of `LARGE`."""
    text = PROGRAM.read_text(encoding="utf-8")
    path = folder / "large_values.soter"
    path.write_text(text.replace("always sum", f"{faults}\n  always sum"), encoding="utf-8")
    return system_of(check_file(str(path)), "Large")


@pytest.mark.parametrize("optimise", ["-O0", "-O2"])
@pytest.mark.parametrize("faults", ["", FAULTS])
@pytest.mark.parametrize("large", [0, 64])
def test_both_engines_have_the_same_bytes(
    large: int, faults: str, optimise: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("soter.codegen.c_types.LARGE", large)
    flat = flat_of(tmp_path, faults)
    native = NativeProgram(flat, optimise).run(UNTIL_NS, 5, hash_trace=True)
    interpreted = run_interpreted(flat, UNTIL_NS, 5)
    assert native.instants == 201
    assert native.trace_sha256 == interpreted.trace_sha256


def test_nothing_large_is_passed_or_returned_by_value(tmp_path: Path) -> None:
    source = generate(flat_of(tmp_path)).source
    heads = re.findall(r"^SOTER_INLINE [^{]*", source, re.MULTILINE)
    assert len(heads) > 10
    assert all(not re.search(r"large_values_(Plan|Pair) (?!\*)", head) for head in heads)
    assert any("large_values_Pair *made" in head for head in heads)


def test_what_only_passes_through_is_not_copied(tmp_path: Path) -> None:
    path = tmp_path / "p.soter"
    path.write_text("""soter 1;
type Plan = { at: float[16], n: int in [0, 9] };
topic asked: Plan;
topic told: Plan;
fun first(p: Plan): Plan {
  var all = p.at;
  if p.n > 3 { return p; }
  all[p.n] = 1.0;
  return { at: all, n: p.n };
}
fun second(p: Plan): Plan {
  let q = first(p);
  let r = q;
  if r.n == 2 { return first(r); }
  return r;
}
node N period 10ms {
  subscribes asked;
  publishes told;
  step {
    let plan = asked;
    let best = second(plan);
    publish told = best;
  }
}
system S { external topic asked; node N; }
""")
    source = generate(system_of(check_file(str(path)), "S")).source
    assert "p_double_16 all" not in source, "a list grows where the plan that has it will be"
    assert "  made->at.at[i] = 1.0;" in " ".join(source.split("\n  "))
    assert "  p_first_fn(p, made, fault);\n  const p_Plan *const q = made;" in source
    assert "    p_first_fn(r, &first_2, fault);\n    *made = first_2;" in source, "`x = f(x)`"
    assert "  p_second_fn(plan, &out_told, fault);" in source
    assert re.findall(r"^ *(?:p_Plan|p_double_16) (\w+)", source, re.MULTILINE) == [
        "first_2",
        "value",
        "out_told",
    ]


def test_a_part_that_is_given_to_itself_where_it_will_be_published_is_no_name_of_its_own(
    tmp_path: Path,
) -> None:
    path = tmp_path / "p.soter"
    path.write_text(
        """soter 1;
type Plan = { at: float[16], n: int in [0, 99] };
topic told: Plan;
node N period 10ms {
  publishes told;
  var k: int in [0, 99];
  step {
    k = (k + 1) % 100;
    var plan: Plan = { at: [], n: k };
    plan.at[3] = float(k);
    plan.at[1] = plan.at[1];
    plan.n = plan.n;
    publish told = plan;
  }
}
system S default { node N; }
""".replace("at: [],", f"at: [{', '.join(['0.5'] * 16)}],")
    )
    flat = system_of(check_file(str(path)), "S")
    assert "p_Plan plan" not in generate(flat).source, "it lies where it is published"
    native = NativeProgram(flat, "-O0").run(UNTIL_NS, 5, hash_trace=True)
    assert native.trace_sha256 == run_interpreted(flat, UNTIL_NS, 5).trace_sha256


def test_the_trusted_drone_needs_at_most_8_kib_of_stack(tmp_path: Path) -> None:
    example = Path(__file__).parents[2] / "examples" / "drone" / "surveillance.soter"
    bound = stack_bound(load(example).build("c", tmp_path / "out"))
    if bound.bytes is None:
        pytest.skip(bound.why)
    assert 1024 < bound.bytes <= 8 * 1024, bound.way
