"""Functions of the C stay short and simple, and its files need each other one way only.

A rough count over the text: of all C below `src/`, and of what tests and measurements bring along.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from generators.file_listing import files_below
from unit.test_house_figures import circles

ROOT = Path(__file__).resolve().parents[2]
SOTER = ROOT / "src" / "soter"
BESIDE = (ROOT / "tests", ROOT / "bench", ROOT / "examples")
BEGIN = re.compile(r"^[A-Za-z_][^;={}]*?\b([A-Za-z_0-9]+)\([^;{}]*\) \{$", re.MULTILINE)
BRANCH = re.compile(r"\b(?:if|for|while|case)\b|&&|\|\||\?")
NOT_CODE = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:[^"\\\n]|\\.)*"', re.DOTALL)
CHECK = re.compile(r"\bSOTER_CHECK\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\);")
INCLUDE = re.compile(r'^#include "(?:.*/)?([^"/]+)"', re.MULTILINE)
NAME = re.compile(r"(?<![.>\w])soter_\w+\b")
OWN = ("static ", "SOTER_INLINE ")
LONGEST = 70
SIMPLE = 10
NOT_SIMPLE = 13
"""Functions of src with more branches, at most."""
LONG = {
    "adversary_loop.c adversary_run": "an oracle, flat on purpose: read beside docs/semantics.md",
    "c_coverage.c main": "a list of calls",
}
BRANCHING = {
    **LONG,
    "adversary_choices.h choose": "a case a kind of adversary",
    "adversary_choices.h direction": "a case a kind of adversary",
    "adversary_choices.h errors": "a case a kind of adversary",
    "adversary_gate.h forgotten": "every command that may still act, wherever it stands",
    "adversary_gate.h moves": "the rule of the page, read in one piece",
    "adversary_gate.h permitted_of": "the rule of the page, read in one piece",
    "adversary_gate.h proposes": "a case a kind of adversary",
    "adversary_model.h adversary_level": "as adversary_run",
    "c_coverage_loop.c firmware": "a list of calls",
    "c_coverage_loop.c leases": "a list of calls",
    "main.c main": "an example's loop, to be read whole",
    "fall_back.h compared": "the definition of a fall-back run, read beside docs/proof-flight.md",
    "fall_back.h drawn_times": "the definition of a fall-back run, read beside proof-flight.md",
    "fall_back.h fall_back": "the definition of a fall-back run, read beside docs/proof-flight.md",
    "tube_adversary.h a_start": "a case a kind of adversary",
    "tube_adversary.h wanted": "a case a kind of adversary",
    "tube_loop.c actuate": "a closed loop, flat on purpose: read beside docs/semantics.md",
    "tube_loop.c attack_late": "a closed loop, flat on purpose: read beside docs/semantics.md",
    "tube_loop.c trusted": "a closed loop, flat on purpose: read beside docs/semantics.md",
}
"""Functions of C that does not belong to src which are longer, or have more branches, and why."""


def bare(text: str) -> str:
    """C without comments and strings, line for line."""
    return NOT_CODE.sub(lambda m: "\n" * m.group().count("\n"), text)


def bodies(text: str) -> list[tuple[str, str, str]]:
    """Of each function of bare C: how it begins, its name, and all of its text."""
    found = []
    for begin in BEGIN.finditer(text):
        end = text.index("\n}\n", begin.end())
        found.append((begin.group(), begin.group(1), text[begin.start() : end]))
    return found


def functions(text: str) -> list[tuple[str, int, int]]:
    """Name, lines and cyclomatic complexity of each; assertions do not branch."""
    return [
        (name, body.count("\n") + 2, 1 + len(BRANCH.findall(CHECK.sub("", body))))
        for _, name, body in bodies(bare(text))
    ]


def all_functions(*folders: Path) -> list[tuple[str, str, int, int]]:
    return [
        (path.name, *figures)
        for folder in folders or (SOTER,)
        for path in files_below(folder, "*.[ch]")
        for figures in functions(path.read_text(encoding="utf-8"))
    ]


def needs(texts: dict[str, str]) -> dict[str, set[str]]:
    """Every C file by name -> the files whose declarations, functions or tables it needs.

    A header needs what its inline functions call; that it declares what a source defines is what
    it is for, and is no need.
    """
    known = {name: bare(text) for name, text in texts.items()}
    parts = {name: bodies(text) for name, text in known.items()}
    defines = {
        function: name
        for name, found in parts.items()
        for begin, function, _ in found
        if name.endswith(".c") and not begin.startswith(OWN)
    }
    graph: dict[str, set[str]] = {}
    for name, text in texts.items():
        inside = known[name] if name.endswith(".c") else "".join(b for _, _, b in parts[name])
        asked = {defines[word] for word in NAME.findall(inside) if word in defines}
        graph[name] = ((set(INCLUDE.findall(text)) & set(texts)) | asked) - {name}
    return graph


def sources() -> dict[str, str]:
    return {p.name: p.read_text(encoding="utf-8") for p in files_below(SOTER, "*.[ch]")}


def test_the_count_knows_branches_comments_and_assertions() -> None:
    text = """static int f(int a,
             int b) {
  /* if && */
  SOTER_CHECK(a > 0 && (b > 0 || a));
  if (a && b) {
    return a ? 1 : 2;
  }
  return 0;
}
"""
    assert functions(text) == [("f", 9, 4)]


def test_no_function_of_the_c_is_long() -> None:
    figures = all_functions()
    assert len(figures) > 400
    assert [f for f in figures if f[2] > LONGEST] == []


def test_few_functions_of_the_c_have_many_branches() -> None:
    found = [f for f in all_functions() if f[3] > SIMPLE]
    assert len(found) <= NOT_SIMPLE, found


def test_the_c_beside_it_is_so_too_or_says_why_not() -> None:
    found = {f"{file} {name}": figures for file, name, *figures in all_functions(*BESIDE)}
    assert {f for f, (lines, _) in found.items() if lines > LONGEST} == set(LONG)
    assert {f for f, (_, branches) in found.items() if branches > SIMPLE} == set(BRANCHING)


def test_needs_of_c_are_seen() -> None:
    texts = {
        "a.h": "int soter_a(void);\nint soter_b(void);\n",
        "a.c": '#include "a.h"\nint soter_a(void) {\n  return soter_b();\n}\n',
        "b.c": '#include "a.h"\n/* soter_a */\nint soter_b(void) {\n  return 1;\n}\n',
        "c.h": '#include "a.h"\nSOTER_INLINE int soter_c(void) {\n  return soter_a();\n}\n',
    }
    expected = {"a.h": set(), "a.c": {"a.h", "b.c"}, "b.c": {"a.h"}, "c.h": {"a.h", "a.c"}}
    assert needs(texts) == expected
    assert circles(needs(texts)) == []
    back = {**texts, "b.c": texts["b.c"].replace("return 1", "return soter_a()")}
    assert circles(needs(back)) == [{"a.c", "b.c"}]
    header = {**texts, "a.h": texts["a.h"] + texts["c.h"].partition("\n")[2]}
    assert circles(needs(header)) == [{"a.h", "a.c", "b.c"}]


def test_no_two_c_files_have_one_name() -> None:
    every = files_below(SOTER, "*.[ch]")
    names = [p.name for p in every if "templates" not in p.parts]  # these are no files of ours
    assert len(names) == len(set(names)), "needs() knows files by their names"


def test_the_guard_of_a_header_is_its_name() -> None:
    headers = {p.name: p.read_text(encoding="utf-8") for p in files_below(SOTER, "*.h")}
    guards = {name: name.upper().replace(".", "_") for name in headers}
    wrong = [n for n, g in guards.items() if f"#ifndef {g}\n#define {g}\n" not in headers[n]]
    assert wrong == []


ENGINES = (SOTER / "explore" / "engine" / "c", SOTER / "verify" / "engine")
HEAD = re.compile(r"/\*(?:(?!\*/).)*\bPurpose:\s(?:(?!\*/).)*\bNon-goals:\s.*?\*/", re.DOTALL)


def test_a_head_has_a_purpose_and_non_goals() -> None:
    assert HEAD.match("/* a.c: adds.\n *\n * Purpose: add. Non-goals: speed.\n */\n")
    assert not HEAD.match("/* a.c: adds.\n * Purpose: add. */\n/* Non-goals: speed. */\n")


def test_each_file_of_the_engines_begins_with_its_purpose_and_non_goals() -> None:
    every = [path for folder in ENGINES for path in files_below(folder, "*.[ch]")]
    assert len(every) > 50
    assert [p.name for p in every if not HEAD.match(p.read_text(encoding="utf-8"))] == []


def test_c_files_do_not_need_each_other_in_circles() -> None:
    assert circles(needs(sources())) == []


CHECKED = {
    **{f"{folder}/**/*.[ch]": 50 for folder in ("posix", "mavlink", "dds", "cortex_m")},
    "soter_grant.c": 7,
}
"""Files of the runtime, and that more functions than so many are found in them."""


@pytest.mark.parametrize(("files", "more_than"), CHECKED.items())
def test_of_two_functions_of_who_acts_one_checks_at_least(files: str, more_than: int) -> None:
    texts = (p.read_text(encoding="utf-8") for p in (SOTER / "runtime").glob(files))
    found = [body for text in texts for _, _, body in bodies(bare(text))]
    assert len(found) > more_than
    assert 2 * sum(body.count("SOTER_CHECK(") for body in found) >= len(found)


NO_INVARIANT = {
    "options, names and numbers that a person gave: what is wrong is refused": {
        *("posix_main.c number", "posix_main.c whole", "posix_main.c duration"),
        *("posix_main.c policy", "posix_main.c core", "posix_main.c worker"),
        *("posix_main.c plain_option", "posix_main.c option", "posix_main.c parse"),
        *("actuator.c number", "actuator.c option", "actuator.c parse"),
        "actuator.c flag",
    },
    "words of what others have checked": {
        *("posix_main.c print_words", "posix_report.c print_histogram", "posix_log.c show"),
        *(
            "posix_report.c print_nodes",
            "posix_report.c print_world",
            "posix_report.c print_misses",
        ),
        *(
            "posix_report.c json_histogram",
            "posix_report.c json_nodes",
            "posix_report.c json_world",
        ),
        *("posix_report.c json_head", "actuator.c report", "actuator.c report_words"),
        *("status_text.c silent_message", "status_text.c control_message"),
        *("status_text.c soter_module_message", "status_text.c soter_module_level"),
        *("status_text.c soter_armed_text", "status_text.c soter_arming_text"),
        *("status_text.c soter_arm_text", "status_text.c soter_takeover_text"),
        *("status_text.c soter_outward_text", "status_text.c soter_old_read_text"),
    },
    "what the system grants or not, which is told": {
        *("posix_setup.c soter_posix_lock", "posix_setup.c chosen_core", "posix_setup.c pin"),
        *("posix_setup.c take_deadline", "posix_setup.c without", "posix_workers.c limit"),
        *("posix_setup.c soter_posix_become", "posix.c page_faults", "outside.c mapped"),
        *("posix_world.c soter_posix_leases_over", "posix_setup.c soter_posix_note"),
        *("process.c redirect", "process.c set_signals", "process.c soter_process_begin"),
        *("process.c soter_process_say", "process.c pass_on", "process.c await"),
        *("process.c soter_process_ending", "process.c soter_process_end", "posix_main.c joined"),
        *("posix_log.c opened", "posix_log.c closed", "posix_log.c write_line"),
        "actuator.c be_on_time",
    },
    "arithmetic, one access, or a call": {
        *("channel.c soter_channel_bytes", "channel.c load", "channel.c store", "channel.c sum_of"),
        *("posix_status.c of_modules", "posix_status.c of_leases", "posix_status.c of_topics"),
        *(
            "outside.c place_bytes",
            "outside.c file_bytes",
            "outside.c room_bytes",
            "posix.c stopped",
            "posix_report.c bin_of",
            "actuator.c most",
        ),
        *("posix_clock.c soter_posix_clock", "posix_clock.c soter_posix_independent"),
        *("worker.c wait_for_more", "actuator.c on_signal", "actuator.c on_fault"),
        *("posix_main.c on_end", "process.c on_alarm"),
        *("status_text.c alive", "status_text.c waits", "status_text.c soter_module_facts_of"),
        *("status_text.c soter_margin_s", "actuator_arm.c count_answers"),
    },
    "loops and sequences of what checks": {
        *("posix.c wait_for", "posix_main.c wait_for_end", "posix_main.c go", "posix_main.c main"),
        *("posix_world.c soter_posix_hear", "posix_workers.c keep_workers", "actuator.c arm"),
        *("posix_log.c watch_workers", "posix_log.c soter_posix_watch", "actuator.c main"),
        *("worker.c answer", "worker.c main"),
    },
    "what a check that fails calls": {
        *("actuator.c soter_check_failed", "posix_check.c soter_check_failed"),
    },
}
"""Functions of the driver without a check, by why."""


def test_every_function_of_the_driver_checks_its_invariants_or_has_none() -> None:
    without = {
        f"{path.name.removeprefix('soter_')} {name}"
        for path in files_below(SOTER / "runtime" / "posix", "*.c")
        for _, name, body in bodies(bare(path.read_text(encoding="utf-8")))
        if "SOTER_CHECK(" not in body
    }
    assert without == set[str]().union(*NO_INVARIANT.values())
