"""The typed interface of topics of every type, in C and in C++, and names that would collide."""

from __future__ import annotations

import json
import re
import shutil
from typing import TYPE_CHECKING

import pytest

import processes
import soter
from generators.c_packages import make
from soter.native.compiler import MEANING, WARNINGS, find_compiler
from soter.native.shared_library import CHECK_FAILED

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
type Kind = enum { Near, Far, Gone };
type Small = int in [-3, 9];
type Inner = { ok: bool, kind: Kind, n: Small };
type Whole = { a: float[3], inner: Inner, list: Inner[<=2], big: int };
topic flag: bool;
topic kind: Kind;
topic small: Small;
topic big: int in [-9000000000, 9000000000];
topic x: float in [-1.0, 1.0];
topic row: float[3] in [0.0, 5.0];
topic names: Small[<=4];
topic whole: Whole in { a in [-9.0, 9.0], big in [-10, 10] };
topic state: int in [0, 100];
topic out: Whole;
topic class: Kind;
node Copy period 10ms {
  subscribes whole, kind;
  publishes out, class;
  step { publish out = whole; publish class = kind; }
}
node Count period 10ms {
  subscribes flag, small, big, x, row, names;
  publishes state;
  step {
    var n = flag ? 1 : 0;
    for k in names { n = n + k; }
    publish state = clampInt(n + small + (big > 0 ? 1 : 0) + int(x + row[0]));
  }
}
fun clampInt(n: int): int { return n < 0 ? 0 : n > 100 ? 100 : n; }
system types {
  external topic flag; external topic kind; external topic small; external topic big;
  external topic x; external topic row; external topic names; external topic whole;
  external topic state; external topic out; external topic class;
  node Copy;
  node Count;
}
"""
MAIN = r"""
#include "types2_firmware.h"
#include <stdio.h>
#include <string.h>
static types2 t;
static int at;
static void is(int wanted, int got) {
  at++;
  if (wanted != got) { (void)printf("%d: %d is not %d\n", at, got, wanted); }
}
int main(void) {
  const char *const wrong = types2_start(&t, 0);
  if (wrong != NULL) { (void)printf("%s\n", wrong); return 1; }
  is(SOTER_TAKEN, types2_publish_flag(&t, true, 0, 0));
  is(SOTER_TAKEN, types2_publish_kind(&t, types2_Kind_Far, 0, 0));
  is(SOTER_NO_VALUE, types2_publish_kind(&t, 3, 0, 0));
  is(SOTER_TAKEN, types2_publish_small(&t, -3, 0, 0));
  is(SOTER_NO_VALUE, types2_publish_small(&t, 10, 0, 0));
  is(SOTER_NO_VALUE, types2_publish_small(&t, 128, 0, 0));
  is(SOTER_NO_VALUE, types2_publish_small(&t, 256 - 3, 0, 0));
  is(SOTER_NO_VALUE, types2_publish_small(&t, INT64_MIN, 0, 0));
  is(SOTER_TAKEN, types2_publish_big(&t, INT64_C(9000000000), 0, 0));
  is(SOTER_NO_VALUE, types2_publish_big(&t, INT64_C(9000000001), 0, 0));
  is(SOTER_TAKEN, types2_publish_x(&t, -1.0, 0, 0));
  is(SOTER_NOT_IN_SET, types2_publish_x(&t, 1.5, 0, 0));
  types2_row row;
  memset(&row, 0, sizeof row);
  row.at[2] = 5.0;
  is(SOTER_TAKEN, types2_publish_row(&t, &row, 0, 0));
  row.at[2] = 5.5;
  is(SOTER_NOT_IN_SET, types2_publish_row(&t, &row, 0, 0));
  types2_names names;
  memset(&names, 0x55, sizeof names);
  names.len = 2;
  names.items[0] = 4;
  names.items[1] = 5;
  is(SOTER_TAKEN, types2_publish_names(&t, &names, 0, 0));
  names.len = 5;
  is(SOTER_NO_VALUE, types2_publish_names(&t, &names, 0, 0));
  types2_whole whole;
  memset(&whole, 0x55, sizeof whole);
  whole.a.at[0] = 1.0; whole.a.at[1] = 2.0; whole.a.at[2] = -9.0;
  whole.inner.ok = 7; whole.inner.kind = types2_Kind_Gone; whole.inner.n = 9;
  whole.list.len = 1;
  whole.list.items[0] = whole.inner;
  whole.big = -10;
  is(SOTER_TAKEN, types2_publish_whole(&t, &whole, 0, 0));
  whole.inner.kind = 9;
  is(SOTER_NO_VALUE, types2_publish_whole(&t, &whole, 0, 0));
  is(SOTER_RAN, (int)types2_step(&t, 0));
  types2_out out;
  int64_t stamp = -1;
  is(1, types2_read_out(&t, &out, &stamp));
  is(0, (int)stamp);
  is(1, out.inner.ok);
  is(types2_Kind_Gone, out.inner.kind);
  is(1, (int)out.list.len);
  is(-10, (int)out.big);
  int64_t state = 0;
  is(1, types2_read_state(&t, &state, NULL));
  is(1 + 9 - 3 + 1 - 1, (int)state);
  uint8_t kind = 0;
  is(1, types2_read_class_(&t, &kind, NULL));
  is(types2_Kind_Far, kind);
  bool flag = false;
  is(1, types2_read_flag(&t, &flag, NULL));
  is(1, flag);
  (void)printf("%d checks\n", at);
  return 0;
}
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The package, its library and a main."""
    folder = tmp_path_factory.mktemp("types")
    (folder / "types.soter").write_text(PROGRAM)
    soter.load(folder / "types.soter").build("c", folder / "out")
    flags = (
        f"CFLAGS=-O1 -g -fsanitize=address,undefined -fno-sanitize-recover=all {' '.join(WARNINGS)}"
    )
    done = make(folder / "out", "lib", flags)
    assert done.returncode == 0, done.stderr
    (folder / "out" / "own.c").write_text(MAIN)
    (folder / "out" / "own.cpp").write_text(MAIN)
    return folder / "out"


@pytest.mark.parametrize("cpp", [False, True], ids=["c", "c++"])
def test_every_type_is_taken_checked_and_read_as_it_was(built: Path, cpp: bool) -> None:
    compiler = list(find_compiler().command)
    if cpp:
        own = shutil.which("clang++" if "clang" in compiler[0] else "g++")
        if own is None:
            pytest.skip("no C++ compiler here")
        compiler = [own]
    words = [*compiler, "-std=c++17" if cpp else "-std=c99", *MEANING]
    words += ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsanitize=address,undefined"]
    words += [str(built / ("own.cpp" if cpp else "own.c")), f"-I{built}"]
    checks = [*find_compiler().command, f"-I{built}", "-c", str(CHECK_FAILED), "-o", "checks.o"]
    assert processes.run(checks, cwd=built).returncode == 0
    words += [
        str(built / "checks.o"),
        str(built / "libtypes.a"),
        "-lm",
        "-o",
        str(built / f"own_{cpp}"),
    ]
    done = processes.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    ran = processes.run([built / f"own_{cpp}"], capture_output=True, text=True)
    assert ran.stdout == "31 checks\n", ran.stdout + ran.stderr
    assert ran.returncode == 0


def test_names_are_the_systems_and_only_a_collision_changes_them(built: Path) -> None:
    header = (built / "types2_firmware.h").read_text()
    assert "types2_publish_small" in header, "`types_` is how the program's own names begin"


def test_names_do_not_depend_on_the_file_that_declares_the_parts(tmp_path: Path) -> None:
    parts = PROGRAM[: PROGRAM.index("system types")]
    system = PROGRAM[PROGRAM.index("system types") :].replace("system types", "system Robot")
    (tmp_path / "one.soter").write_text(parts + system)
    (tmp_path / "parts.soter").write_text(parts)
    apart = re.sub(r"(external topic|node) ", r"\1 p.", system)
    (tmp_path / "two.soter").write_text(f'soter 1;\nimport "parts.soter" as p;\n{apart}')
    identifiers = []
    for name in ("one", "two"):
        soter.load(tmp_path / f"{name}.soter").build("c", tmp_path / name)
        header = (tmp_path / name / "Robot_firmware.h").read_text()
        identifiers.append(sorted(set(re.findall(r"\bRobot_\w+", header))))
        messages = json.loads((tmp_path / name / "messages.json").read_text())
        identifiers[-1].append(messages["layout"])
    assert identifiers[0] == identifiers[1]


def test_the_layout_hash_changes_with_a_type_and_not_with_a_step(tmp_path: Path) -> None:
    hashes = {}
    for name, text in (
        ("as_it_was", PROGRAM),
        ("another_step", PROGRAM.replace("n = n + k", "n = n + k + 1")),
        ("another_set", PROGRAM.replace("[-3, 9]", "[-3, 8]")),
        ("another_age", PROGRAM.replace("topic flag: bool", "topic flag: bool max_age 1s")),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "types.soter").write_text(text)
        soter.load(tmp_path / name / "types.soter").build("c", tmp_path / name / "out")
        told = json.loads((tmp_path / name / "out" / "messages.json").read_text())
        hashes[name] = told["layout"]
    assert hashes["as_it_was"] == hashes["another_step"]
    assert len(set(hashes.values())) == 3
