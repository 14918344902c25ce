"""Words of other languages: each row of the table mends a program, or shows what to write."""

from __future__ import annotations

from pathlib import Path

import pytest

from generators.file_listing import files_below
from soter.diagnostics.fixes import apply_fix
from soter.language.front_end import check_file
from soter.language.syntax import their_words
from soter.language.syntax.their_words import THEIRS, is_only_shown
from soter.mapping.read_mapping import parse_toml
from tables import all_rows

ROOT = Path(__file__).resolve().parents[4]
SOTER = ROOT / "src" / "soter"
ROWS_MAX = 60
PROGRAM = """soter 1;
type Way = enum { Up, Down };
type Motion = { x: float, v: float };
const A: float = 3.0;
fun half(xs: float[2], n: int): float { var sum = 0.0; for x in xs { sum = sum + x; } return sum; }
input topic goal: float in [-1.0, 1.0];
topic motion: Motion in { x in [-9.0, 9.0], v in [-9.0, 9.0] } max_age 20ms;
topic accel: float in [-A, A];
topic lamp: bool;
topic way: Way;
node Fast period 10ms {
  subscribes motion, goal;
  publishes accel;
  var last: float = 0.0;
  step {
    let e = goal - motion.x;
    last = clamp(e * last, -1.0, 1.0);
    publish accel = last;
  }
  on takeover { last = 0.0; }
}
node Slow period 10ms { publishes accel; step { publish accel = 0.0; } }
node Lamp period 10ms {
  subscribes motion;
  publishes lamp, way;
  var n: int = 0;
  step {
    n = min(n + 1, 10);
    if motion.x > 0.5 && n != 3 { publish lamp = true; } else { publish lamp = !(n > 1); }
    publish way = Way.Up;
  }
}
node Dark period 10ms {
  publishes lamp, way;
  step { publish lamp = false; publish way = Way.Down; }
}
rta Guard { ac Fast; sc Slow; period 20ms; safe motion.x < 9.0; ttf motion.x > 5.0;
  safer motion.x < 4.0; }
plant Cart period 5ms {
  reads accel;
  state x: float in [-1.0, 1.0];
  state v: float;
  der x = v;
  der v = accel;
  drives motion = { x: clamp(x, -9.0, 9.0), v: clamp(v, -9.0, 9.0) };
}
system Track { cart: Cart; module Guard; node Lamp; until 10s; }
test Soon { system Track; horizon 100ms; replace Lamp by Dark; always motion.x < 9.5; }
"""
WRONG = {
    "until": ("horizon 100ms", "until 100ms"),
    "horizon": ("until 10s", "horizon 10s"),
    "double": ("last: float", "last: double"),
    "f64": ("last: float", "last: f64"),
    "float64": ("x: float,", "x: float64,"),
    "float32": ("last: float", "last: float32"),
    "long": ("var n: int", "var n: long"),
    "u32": ("var n: int", "var n: u32"),
    "uint8_t": ("var n: int", "var n: uint8_t"),
    "True": ("lamp = true", "lamp = True"),
    "False": ("lamp = true", "lamp = False"),
    "AC": ("lamp = true", "lamp = mode(Guard) == AC"),
    '"SC"': ("lamp = true", 'lamp = mode(Guard) == "SC"'),
    "std::": ("clamp(", "std::clamp("),
    "math.": ("clamp(", "math.clamp("),
    "np.": ("clamp(", "np.clamp("),
    "torch.": ("clamp(", "torch.clamp("),
    "this->": ("    last = ", "    this->last = "),
    "vec!": ("half([0.0", "half(vec![0.0"),
    "pub": ("const A", "pub const A"),
    "::": ("Way.Up", "Way::Up"),
    "clip": ("clamp(e", "clip(e"),
    "pi": ("goal - motion.x", "goal - math.pi"),
    "M_PI": ("goal - motion.x", "goal - M_PI"),
    "auto": ("let e", "auto e"),
    "~": ("!(n", "~(n"),
    "~=": ("n != 3", "n ~= 3"),
    ".*": ("e * last", "e .* last"),
    "minute": ("until 10s", "until 1minute"),
    "timeout": ("max_age 20ms", "timeout 20ms"),
    "on_activate": ("on takeover", "on_activate"),
    "def": ("fun half", "def half"),
    "reads": ("subscribes motion, goal", "reads motion, goal"),
    "subscribes": ("reads accel", "subscribes accel"),
    "state": ("var last", "state last"),
    "publishes": ("drives motion", "publishes motion"),
    "always": ("safe motion", "always motion"),
    "advanced": ("ac Fast", "advanced Fast"),
    "with": ("Lamp by Dark", "Lamp with Dark"),
    "within": ("Lamp by Dark", "Lamp within Dark"),
    "^": ("e * last", "e ^ 2"),
    "printf": ("    last = ", '    printf("x"); last = '),
    "println": ("    last = ", '    println("x"); last = '),
    "string": ("last: float", "last: string"),
    "struct": ("type Motion =", "struct Motion"),
    "enum": ("type Way = enum", "enum Way"),
    "typedef": ("type Way = enum", "typedef enum"),
    "void": ("): float {", "): void {"),
    "lambda": ("let e = goal - motion.x", "let e = lambda x: x"),
    "None": ("float = 0.0", "float = None"),
    "NULL": ("float = 0.0", "float = NULL"),
    "nullptr": ("float = 0.0", "float = nullptr"),
    "switch": ("    last = ", "    switch (n) { } last = "),
    "match": ("    last = ", "    match n { } last = "),
    "break": ("sum = sum + x;", "break;"),
    "loop": ("    last = ", "    loop { } last = "),
    "pass": ("{ last = 0.0; }", "{ pass; }"),
    "declare_parameter": ("const A: float = 3.0;", 'declare_parameter("A", 3.0);'),
    "std::vector": ("last: float", "last: std::vector<float>"),
}
"""By word of the table, a part of the program and what stands there with the word."""


def program(folder: Path, text: str) -> str:
    path = folder / "program.soter"
    path.write_text(text, encoding="utf-8")
    return str(path)


def test_the_program_is_right_without_these_words(tmp_path: Path) -> None:
    diagnostics = check_file(program(tmp_path, PROGRAM)).diagnostics
    assert not diagnostics.has_errors


def test_the_table_is_short_and_every_row_has_an_example() -> None:
    assert set(WRONG) == set(THEIRS)
    assert len(THEIRS) <= ROWS_MAX


@all_rows("word", THEIRS)
def test_a_row_mends_the_program_or_shows_what_to_write(word: str, tmp_path: Path) -> None:
    old, new = WRONG[word]
    text = PROGRAM.replace(
        "step {\n    let e", "step {\n    last = half([0.0, 1.0], 1);\n    let e"
    )
    assert text.count(old) >= 1
    wrong = check_file(program(tmp_path, text.replace(old, new, 1))).diagnostics
    first, *_ = wrong.items
    if is_only_shown(THEIRS[word]):
        assert any(str(h).startswith("in Soter: `") for h in first.helps), first
        assert not first.fixes
        return
    (fix,) = first.fixes
    (mended,) = apply_fix(fix).values()
    assert not check_file(program(tmp_path, mended)).diagnostics.has_errors


def test_a_name_behind_a_word_stands_in_what_is_shown(tmp_path: Path) -> None:
    text = PROGRAM.replace("type Way = enum", "enum Way")
    first, *_ = check_file(program(tmp_path, text)).diagnostics.items
    assert first.helps == ("in Soter: `type Way = enum { A, B };`",)


@pytest.mark.parametrize("wrong", ["let a = 1.0 :: 2.0 + ;", "auto a = ;", "std::abs(1.0;"])
def test_an_edit_that_leaves_a_syntax_error_is_not_offered(wrong: str, tmp_path: Path) -> None:
    text = f"soter 1;\nfun f(): float {{ {wrong} return 1.0; }}\n"
    items = check_file(program(tmp_path, text)).diagnostics.items
    assert items
    assert all(not d.fixes for d in items)


@pytest.mark.parametrize("file", ["wall/cart.soter", "testing/two_modules.soter"])
def test_a_right_program_is_never_compared_with_the_table(file: str) -> None:
    their_words._pattern_of_words.cache_clear()
    assert not check_file(str(ROOT / "examples" / file)).diagnostics.items
    assert their_words._pattern_of_words.cache_info().misses == 0


def test_all_that_lies_beside_the_code_is_installed() -> None:
    toml = parse_toml((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    patterns = toml["tool"]["setuptools"]["package-data"]["soter"]
    installed = {p for pattern in patterns for p in SOTER.glob(pattern)}
    beside = {p for p in files_below(SOTER, "*") if p.is_file() and p.suffix != ".py"}
    assert not {str(p) for p in beside - installed if "__pycache__" not in p.parts}
