"""Whatever a program calls its things, its C compiles, and so does C++ around it."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import processes
import soter
from generators.c_packages import package
from long_tests import examples
from soter.codegen.c_names import file_level_name, why_not_linkable
from soter.codegen.unit import COMPONENT_NAMES, generate
from soter.language.syntax.lexer import RESERVED
from soter.native.compiler import STANDARD, WARNINGS, find_compiler
from soter.native.shared_library import RUNTIME

if TYPE_CHECKING:
    from soter.codegen.unit import Unit

KEYWORDS = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while _Alignas _Alignof _Atomic _BitInt _Bool _Complex _Decimal32 _Decimal64 _Generic
_Imaginary _Noreturn _Static_assert _Thread_local alignas alignof bool constexpr false nullptr
static_assert thread_local true typeof typeof_unqual asm fortran
and and_eq bitand bitor catch char8_t class co_await co_return co_yield compl concept const_cast
consteval constinit decltype delete dynamic_cast explicit export friend mutable namespace new
noexcept not not_eq operator or or_eq private protected public reinterpret_cast requires
static_cast template this throw try typeid typename using virtual wchar_t xor xor_eq
"""
OTHERS = """
main errno stdin stdout size_t int8_t NULL EOF FILE printf time read write exit signal system select
index fabs sinf y0 unix linux assert va_list INT64_MAX EINVAL SIGTERM PRId64 measured value self now
late __x _x __func__ _Exit x__y noreturn complex soter Soter soter_x offsetof uint8_t timer_t I1 div
"""
HEADERS = """
assert complex ctype errno fenv float inttypes limits math setjmp signal stdarg stdbool stddef
stdint stdio stdlib string time unistd wchar
"""
WORDS = [w for w in (*KEYWORDS.split(), *OTHERS.split()) if w not in RESERVED]
NAMES = examples(10)
EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
INCLUDED = "".join(f"#include <{h}.h>\n" for h in HEADERS.split() if h != "complex")
ONE = """soter 1;
topic x: float in [0.0, 1.0] max_age 20ms;
topic u: float in [0.0, 1.0] = 0.0;
node F period 10ms { subscribes x; publishes u; step { publish u = x; } }
node S period 10ms { subscribes x; publishes u; step { publish u = x; } }
rta M { ac F; sc S; period 20ms; safe x < 0.9; ttf x > 0.5; safer x < 0.4; failsafe u = 0.0; }
"""


def compiled(folder: Path, *words: str, cpp: bool = False) -> str:
    """What a compiler says of files that are there, every warning an error."""
    command = [shutil.which("g++") or "clang++", "-std=c++17", "-Wall", "-Wextra", "-Werror"]
    command = command if cpp else [*find_compiler().command, STANDARD, *WARNINGS]
    words = (*command, "-fsyntax-only", "-I.", *words)
    done = processes.run(words, cwd=folder, capture_output=True, text=True)
    return "" if done.returncode == 0 else str(done.stderr)


def test_a_system_may_have_any_name(tmp_path: Path) -> None:
    names = WORDS[:: max(1, len(WORDS) // NAMES)]
    names = list(dict.fromkeys([*names, "_Atomic", "_Bool", "_Thread_local", "main", "errno"]))
    systems = "".join(
        f"system {n} {{ external topic x; external topic u; module M; }}\n" for n in names
    )
    (tmp_path / "p.soter").write_text(ONE + systems)
    headers = []
    for n in names:
        package(tmp_path / "p.soter", tmp_path / n, n)
        (header,) = {p.name for p in (tmp_path / n).glob("*_firmware.h")} - {"soter_firmware.h"}
        headers.append(f'#include "{n}/{header}"\n')
        own = [p.name for p in (tmp_path / n).glob("*.c") if not p.name.startswith("soter_")]
        assert compiled(tmp_path / n, *own) == "", n
    includes = [f"-I{names[0]}"]
    text = f"#define _POSIX_C_SOURCE 200809L\n{INCLUDED}{''.join(headers)}\n"
    (tmp_path / "all.c").write_text(text)
    (tmp_path / "all.cpp").write_text(text)
    assert compiled(tmp_path, *includes, "all.c") == ""
    if shutil.which("g++") or shutil.which("clang++"):
        assert compiled(tmp_path, *includes, "all.cpp", cpp=True) == ""


def test_a_name_that_means_nothing_stays() -> None:
    for name in ("Vehicle", "Protected", "a1", "Island", "strider"):
        assert file_level_name(name) == name


def macros(folder: Path) -> list[str]:
    """Macros of the headers above that are names, as this machine has them."""
    (folder / "h.h").write_text(INCLUDED)
    command = [*find_compiler().command, STANDARD, "-E", "-dM", "h.h"]
    done = processes.run(command, cwd=folder, capture_output=True, text=True)
    named = {line.split()[1] for line in done.stdout.splitlines() if line.startswith("#define")}
    return sorted(n for n in named if "(" not in n and n not in RESERVED)


def test_everything_else_may_have_any_name(tmp_path: Path) -> None:
    """Fields, topics, members, nodes, functions, constants, locals and parameters."""
    macro_names = macros(tmp_path)
    assert "EINVAL" in macro_names
    names = list(dict.fromkeys([*WORDS, *macro_names[:: max(1, len(macro_names) // (6 * NAMES))]]))
    fields = ", ".join(f"{n}: float" for n in names)
    text = f"soter 1;\ntype Words = {{ {fields} }};\ntopic words: Words;\n"
    text += f"type Members = enum {{ {', '.join(names)} }};\ntopic member: Members ="
    text += f" Members.{names[0]};\n"
    for k, n in enumerate(names[:: len(names) // 12][:12]):
        if n in ("Words", "Members"):
            continue
        text += (
            f"topic t_{k}: float = 0.0;\n"
            f"fun f_{k}({n}: float): float {{ let {n}_ = {n}; return {n}_; }}\n"
            f"node n_{k} period 10ms {{ publishes t_{k}; var {n}: float;"
            f" step {{ {n} = f_{k}({n}); publish t_{k} = {n}; }} }}\n"
        )
    text += (
        "topic seen: float = 0.0;\nnode all period 10ms { subscribes words; publishes seen, member;"
    )
    text += (
        f" step {{ publish seen = words.{names[0]}; publish member = Members.{names[0]}; }} }}\n"
    )
    parts = " ".join(["node all;", *(f"node n_{k};" for k in range(12))])
    (tmp_path / "p.soter").write_text(text + f"system Whole {{ {parts} external topic words; }}\n")
    package(tmp_path / "p.soter", tmp_path / "out")
    own = [p.name for p in (tmp_path / "out").glob("*.c") if not p.name.startswith("soter_")]
    (tmp_path / "out" / "before.h").write_text(f"#define _POSIX_C_SOURCE 200809L\n{INCLUDED}")
    assert compiled(tmp_path / "out", "-include", "before.h", *own) == ""
    if shutil.which("g++") or shutil.which("clang++"):
        (tmp_path / "out" / "u.cpp").write_text(f'{INCLUDED}#include "Whole_firmware.h"\n')
        assert compiled(tmp_path / "out", "u.cpp", cpp=True) == ""


@pytest.mark.parametrize("file", ["evidence/cart_faults.soter", "testing/first_cause.soter"])
def test_every_function_of_a_component_has_a_reserved_name(file: str) -> None:
    """Else a type called `SafeCart_Fast_overrun` could be the overrun of `SafeCart.Fast`."""
    unit = generate(soter.load(EXAMPLES / file).flat())
    named = re.findall(r"^[a-z][\w *]*?\b(\w+)\(", unit.source, re.MULTILINE)
    of = unit.names.values()
    endings = {f.removeprefix(name) for f in named for name in of if f.startswith(f"{name}_")}
    assert "_step" in endings
    assert endings <= {*COMPONENT_NAMES}


@pytest.mark.parametrize("name", ["_Atomic", "errno", "main"])
def test_a_file_may_have_such_a_name_too(tmp_path: Path, name: str) -> None:
    (tmp_path / f"{name}.soter").write_text(
        ONE + "system V { external topic x; external topic u; module M; }\n"
    )
    package(tmp_path / f"{name}.soter", tmp_path / "out")
    own = [p.name for p in (tmp_path / "out").glob("*.c") if not p.name.startswith("soter_")]
    assert compiled(tmp_path / "out", *own) == ""


# ---------------------------------------------------------------- functions that are linked

EVERYTHING = """soter 1;
type Many = { at: float[20], on: bool };
topic sum: float in [0.0, 9.0] = 0.0;
topic many: Many;
topic mail: int = 0;
topic u: float in [-1.0, 1.0] = 0.0;
{funs}
node Reader period 10ms {
  publishes sum, many, mail;
  var x: float = 0.0;
  step {
    var m = many_of(x);
    for i in 0..3 { x = x + m.at[i]; }
    {calls}
    publish sum = clamp(x, 0.0, 9.0); publish many = m; publish mail = 1;
  }
}
extern fun many_of(x: float): Many from "c:x.c:many_of";
{nodes}
system S default { node Reader; {names} until 50ms; }
"""
LINKED = """soter 1;
topic u: float = 0.0;
topic v: float = 0.0;
extern fun given(given: float): float from "c:x.c:given";
extern node L period 10ms from "c:x.c:answer" { publishes u; }
node R period 10ms { publishes v; step { publish v = given(1.5); } }
system S default { node L; node R; until 50ms; }
"""
LINKED_C = """#include "a.h"
double given(double given) { return 2 * given; }
int answer(const a_L_in *in, a_L_out *out) {
  (void)in;
  out->u = 2.5;
  out->has_u = 1;
  return 0;
}
"""
IMPOSSIBLE = ("int", "ü", "a b", "soter_run", "a_program", "a_L_step", "memcpy")
OURS = re.compile(r"(soter|SOTER|names)_\w*|names|U?INT\d+_\w+|soter")


def program_of(functions: list[str], nodes: list[str]) -> str:
    """Extern functions and nodes that are bound to C functions of these names."""

    def own(name: str) -> str:
        return "value" if name in RESERVED or name == "_" else name

    funs = "\n".join(
        f'extern fun f_{k}({own(n)}: float): float from "c:x.c:{n}";'
        for k, n in enumerate(functions)
    )
    calls = " ".join(f"x = x + f_{k}(x);" for k, _ in enumerate(functions))
    declared = "\n".join(
        f"topic t_{k}: float[<=12] = [];\n"
        f'extern node N_{k} period 10ms from "c:x.c:{n}" '
        f"{{ subscribes sum; publishes t_{k}, u_{k}; var {own(n)}: float = 0.0; }}\n"
        f"topic u_{k}: float in [-1.0, 1.0] = 0.0;"
        for k, n in enumerate(nodes)
    )
    names = " ".join(f"node N_{k};" for k, _ in enumerate(nodes))
    text = EVERYTHING
    given = {"funs": funs, "calls": calls, "nodes": declared, "names": names}
    for key, part in given.items():
        text = text.replace("{" + key + "}", part)
    return text


def unit_of(folder: Path, text: str) -> Unit:
    """The C of a program."""
    file = folder / "names.soter"
    file.write_text(text)
    return generate(soter.load(str(file)).flat())


def refused(folder: Path, functions: list[str], nodes: list[str]) -> str:
    """The code of the diagnostic where a name is refused."""
    try:
        unit_of(folder, program_of(functions, nodes))
    except soter.SoterError as error:
        return " ".join(d.code for d in error.diagnostics)
    return ""


def test_a_linked_function_may_be_called_as_anything_in_generated_code(tmp_path: Path) -> None:
    """Every identifier of a generated program: none hides a linked function of the same name."""
    first = unit_of(tmp_path, program_of(["given"], ["answer"]))
    found = set(re.findall(r"[A-Za-z_]\w*", first.header + first.source))
    others = {"lround", "in", "out", "local", "made", "outer", "kept", "got", "status", "message"}
    found |= others
    names = sorted(found - {"given", "many_of", "f_0", "N_0"})
    free = {n for n in names if not refused(tmp_path, [n], ["node_bound"])}
    of_nodes = {n for n in names if not refused(tmp_path, ["fun_bound"], [n])}
    for name in set(names) - free:
        assert OURS.fullmatch(name) or why_not_linkable(name, node=False), name
        assert refused(tmp_path, [name], ["node_bound"]) == "X009", name
    for name in free - of_nodes:
        assert OURS.fullmatch(name) or why_not_linkable(name, node=True), name
    assert {"answer", "s", "flags", "status", "in", "out", "fault", "got", "kept"} <= of_nodes
    for functions, nodes in ((sorted(free), ["node_bound"]), (["fun_bound"], sorted(of_nodes))):
        called = [n for n in functions if n not in ("lround", "fabs", "sqrt", "floor")]
        unit = unit_of(tmp_path, program_of(called, nodes))
        (tmp_path / "names.h").write_text(unit.header)
        (tmp_path / "names.c").write_text(unit.source)
        assert compiled(tmp_path, f"-I{RUNTIME}", "names.c") == ""


def test_a_linked_function_called_as_a_parameter_runs(tmp_path: Path) -> None:
    (tmp_path / "a.soter").write_text(LINKED)
    (tmp_path / "x.c").write_text(LINKED_C)
    program = soter.load(str(tmp_path / "a.soter"))
    runs = [program.simulate(engine=engine, until="50ms") for engine in ("native", "interp")]
    assert [(r.final["topics"]["u"], r.final["topics"]["v"]) for r in runs] == [(2.5, 3.0)] * 2


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_a_name_that_cannot_be_linked_is_told_of_itself(tmp_path: Path, name: str) -> None:
    """And not as a mistake in the C file."""
    (tmp_path / "a.soter").write_text(
        f'soter 1;\ntopic u: float = 0.0;\nextern node L period 10ms from "c:x.c:{name}" '
        "{ publishes u; }\nsystem S default { node L; until 50ms; }\n"
    )
    (tmp_path / "x.c").write_text("\n")
    for engine in ("native", "interp"):
        with pytest.raises(soter.SoterError) as caught:
            soter.load(str(tmp_path / "a.soter")).simulate(engine=engine)
        assert [d.code for d in caught.value.diagnostics] == ["X009"]
