"""Which of the C that ships is reached: lines, branches, and conditions each on its own (MC/DC).

    .venv/bin/python bench/c_code/c_coverage.py [--seeds N] [--show]

Purpose: the run-time (kernel, virtual driver, gate, hash) over the programs of tests/correct and
of the gallery, and the generated C of the drone; clang 18 or newer tells what was reached
(-fcoverage-mcdc), AddressSanitizer and UBSan watch the same runs. `--show`: every branch that was
not reached, with its line. Needs clang-19 and llvm-19 of the system (or newer: $CLANG, $LLVM_COV,
$LLVM_PROFDATA). Non-goals: whether what came out was right: that is what the tests ask.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from soter.codegen.unit import generate
from soter.diagnostics.diagnostic import SoterError
from soter.language.front_end import check_file, system_of
from soter.language.model.types import FloatType, leaves
from soter.native.compiler import STRICT
from soter.native.shared_library import CHECK_FAILED, KERNEL, RUNTIME
from soter.report.tables import table

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.codegen.unit import Unit

ROOT = Path(__file__).resolve().parents[2]
HARNESS = (
    ROOT / "bench" / "c_code" / "c_coverage.c",
    ROOT / "bench" / "c_code" / "c_coverage_loop.c",
)
CLANG = os.environ.get("CLANG", "clang-19")
COV = os.environ.get("LLVM_COV", "llvm-cov-19")
PROFDATA = os.environ.get("LLVM_PROFDATA", "llvm-profdata-19")
LOOP = ("soter_firmware.c", "soter_grant.c", "soter_lease.c")
SOURCES = (*KERNEL, "soter_sha256.c", "soter_self_test.c", *LOOP)
SHIPPED = (*SOURCES, "soter.h", "soter_faults.h")
COVERAGE = (
    "-DSOTER_UNCHECKED",
    "-fprofile-instr-generate",
    "-fcoverage-mapping",
    "-fcoverage-mcdc",
)
WATCHED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
DRONE = ("motion_primitive", "corridor", "battery")
SMALL = (
    ROOT / "bench" / "c_code" / "c_coverage.soter",
    *sorted((ROOT / "tests" / "dynamic_error").glob("*.soter")),
    *sorted((ROOT / "tests" / "correct").glob("*.soter")),
    *sorted((ROOT / "examples" / "gallery").glob("*.soter")),
    ROOT / "examples" / "wall" / "cart.soter",
)
HIDDEN = ("-U__FAST_MATH__", "-U__FINITE_MATH_ONLY__", "-D__FINITE_MATH_ONLY__=0", "-w")
WRONG = (
    ("-ffast-math", "-O0", *HIDDEN),
    ("-ffast-math", "-O2", *HIDDEN),
    ("-ffp-contract=fast", "-mfma", "-O1"),
    ("-funsafe-math-optimizations", "-O0"),
    ("-funsafe-math-optimizations", "-O2"),
)
"""Flags under which the self-test has to refuse to go on; `HIDDEN`: from the preprocessor."""
INSTANTS = {False: 400, True: 40_000}
"""In a run: of the small programs, and of the drone, which has to fly somewhere."""


def units(files: tuple[Path, ...]) -> Iterator[tuple[Unit, list[int]]]:
    """Every system of these files, its externs left to the harness; and its topics of floats."""
    for file in files:
        checked = check_file(str(file))
        if not checked.ok or checked.program is None:
            print(f"left out, it has errors: {file.name}")
            continue
        for name in checked.program.systems:
            try:
                system = system_of(checked, name)
            except SoterError:
                continue
            alone = replace(system)
            alone.components = tuple(
                replace(x, binding=None if x.extern else x.binding) for x in system.components
            )
            floats = [
                t.index
                for t in system.topics
                if all(isinstance(leaf, FloatType) for _, leaf in leaves(t.type))
            ]
            yield generate(alone), floats


def compiled(unit: Unit, floats: list[int], folder: Path, flags: tuple[str, ...]) -> Path | None:
    """The harness around a unit; None where it has C of its own, which is not ours."""
    if unit.c_sources:
        return None
    folder.mkdir(parents=True)
    (folder / f"{unit.prefix}.h").write_text(unit.header, encoding="utf-8")
    source = folder / f"{unit.prefix}.c"
    source.write_text(unit.source, encoding="utf-8")
    program = folder / "program"
    subprocess.run(
        [
            *(CLANG, *STRICT, "-O0", *flags, f"-I{folder}", f"-I{RUNTIME}"),
            f'-DCOVERED_HEADER="{unit.prefix}.h"',
            f"-DCOVERED_PROGRAM={unit.prefix}_program",
            f"-DCOVERED_FLOATS={{{', '.join(map(str, (len(floats), *floats)))}}}",
            *map(str, (*HARNESS, source, *(RUNTIME / s for s in SOURCES), CHECK_FAILED)),
            *("-o", str(program), "-lm"),
        ],
        check=True,
    )
    return program


def wrong_builds(unit: Unit, floats: list[int], work: Path) -> tuple[list[Path], list[str]]:
    """Programs that compute wrongly, and what they reached until the self-test stopped them."""
    programs, raws = [], []
    for k, flags in enumerate(WRONG):
        program = compiled(unit, floats, work / f"wrong{k}", (*COVERAGE, *flags))
        assert program is not None
        raw = str(work / f"wrong{k}.profraw")
        run(program, 1, 1, {"LLVM_PROFILE_FILE": raw}, "refused")
        programs.append(program)
        raws.append(raw)
    return programs, raws


def reached(programs: list[Path], seeds: int, instants: int, work: Path, raws: list[str]) -> Any:  # noqa: ANN401 - JSON
    """What llvm-cov says about these programs after so many runs of each, and about `raws`."""
    for k, program in enumerate(p for p in programs if not p.parent.name.startswith("wrong")):
        for seed in range(1, seeds + 1):
            raw = work / f"{k}-{seed}.profraw"
            run(program, seed, instants, {"LLVM_PROFILE_FILE": str(raw)})
            raws.append(str(raw))
    data = work / "all.profdata"
    (work / "raws").write_text("\n".join(raws), encoding="utf-8")
    subprocess.run([PROFDATA, "merge", "-f", str(work / "raws"), "-o", str(data)], check=True)
    objects = [x for p in programs[1:] for x in ("-object", str(p))]
    told = subprocess.run(
        [COV, "export", str(programs[0]), *objects, f"-instr-profile={data}"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(told.stdout)["data"][0]["files"]


def run(program: Path, seed: int, instants: int, environment: dict[str, str], *more: str) -> None:
    """One run; RuntimeError where a sanitizer stops it."""
    wild = (0, 1, 20, 80)[seed % 4]
    done = subprocess.run(
        [str(program), str(seed), str(instants), str(wild), *more],
        capture_output=True, text=True, check=False, timeout=600,
        env={**os.environ, **environment},
    )  # fmt: skip
    if done.returncode:
        raise RuntimeError(f"{program} seed {seed}: {done.stderr[-2000:]}")


def rows(files: Any, names: tuple[str, ...]) -> list[list[str]]:  # noqa: ANN401 - JSON
    """A row a file: lines, branches and conditions reached of how many."""
    table_rows = []
    for file in files:
        if Path(file["filename"]).name in names:
            s = file["summary"]
            cells = [f"{s[k]['covered']} / {s[k]['count']}" for k in ("lines", "branches", "mcdc")]
            table_rows.append([Path(file["filename"]).name, *cells])
    return sorted(table_rows)


def missed(files: Any, names: tuple[str, ...]) -> Iterator[str]:  # noqa: ANN401 - JSON
    """Every way out of a branch that was not taken, and every condition that did not decide."""
    for file in files:
        path = Path(file["filename"])
        if path.name not in names:
            continue
        text = path.read_text(encoding="utf-8").splitlines()
        ways: dict[tuple[int, int], list[int]] = {}
        for line, column, _, _, yes, no, *_ in file.get("branches", ()):
            both = ways.setdefault((line, column), [0, 0])
            both[0], both[1] = both[0] + yes, both[1] + no
        for line, text_of in reached_never(file, text):
            yield f"{path.name}:{line}: never: {text_of}"
        for (line, _), both in sorted(ways.items()):
            for way, times in zip(("true", "false"), both, strict=True):
                if not times:
                    yield f"{path.name}:{line}: never {way}: {text[line - 1].strip()}"


def reached_never(file: Any, text: list[str]) -> Iterator[tuple[int, str]]:  # noqa: ANN401 - JSON
    """The lines at which code begins that was never reached."""
    for line, _, count, has_count, entry, *_ in file.get("segments", ()):
        if has_count and entry and not count:
            yield line, text[line - 1].strip()


def measure(title: str, files: tuple[Path, ...], *, seeds: int, drone: bool, show: bool) -> None:
    """Both builds of every program, and the table of what was reached."""
    with tempfile.TemporaryDirectory() as place:
        work = Path(place)
        programs, watched, names = [], 0, []
        made = list(units(files))
        for k, (unit, floats) in enumerate(made):
            program = compiled(unit, floats, work / f"c{k}", COVERAGE)
            if program is None:
                continue
            programs.append(program)
            names.append(f"{unit.prefix}.c")
            careful = compiled(unit, floats, work / f"w{k}", WATCHED)
            assert careful is not None
            for seed in range(1, seeds + 1):
                run(careful, seed, INSTANTS[drone], {})
                watched += 1
        raws: list[str] = []
        if not drone:
            broken, raws = wrong_builds(*made[0], work)
            programs += broken
        files_of = reached(programs, seeds, INSTANTS[drone], work, raws)
        wanted = tuple(names) if drone else SHIPPED
        print(title)
        print(table(["file", "lines", "branches", "MC/DC"], rows(files_of, wanted)))
        print(f"{len(programs)} programs, {watched} runs under ASan and UBSan: nothing found\n")
        if show:
            print("\n".join(missed(files_of, wanted)))


def main() -> int:
    """Measure both; 2 where clang is not there."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seeds", type=int, default=8, help="runs of each program")
    parser.add_argument("--show", action="store_true", help="what was not reached, line by line")
    args = parser.parse_args()
    for tool in (CLANG, COV, PROFDATA):
        if shutil.which(tool) is None:
            print(f"`{tool}` was not found: apt install clang-19 llvm-19 libclang-rt-19-dev")
            return 2
    measure("the run-time", SMALL, seeds=args.seeds, drone=False, show=args.show)
    drone = tuple(ROOT / "examples" / "drone" / f"{n}.soter" for n in DRONE)
    measure("the drone", drone, seeds=args.seeds, drone=True, show=args.show)
    return 0


if __name__ == "__main__":
    sys.exit(main())
