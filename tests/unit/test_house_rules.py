"""The rules of the house that no linter knows (docs/architecture.md, STYLE)."""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

import pytest

import processes
from generators.file_listing import files_below
from tables import all_rows
from unit.test_house_figures import ROOT, SOURCES, tree_of

MACHINE_PATHS = re.compile(r"/(?:work|root|home/\w+)/|(?:localhost|127\.0\.0\.1):\d+/simple")


def _tracked() -> list[Path]:
    done = processes.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    names = [n for n in done.stdout.split("\0") if n]
    if not names:
        pytest.skip("not a git checkout: nothing says which files are committed")
    return [ROOT / n for n in names if (ROOT / n).is_file()]


@all_rows("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT / "src" / "soter")))
def test_a_module_opens_with_its_purpose(path: Path) -> None:
    said = re.match(r'r?"""(.+?)"""\n', path.read_text(encoding="utf-8"), re.DOTALL)
    assert said, "no docstring"
    docstring = said.group(1)
    if path.name != "__init__.py":
        assert "Purpose:" in docstring
        assert "Non-goals:" in docstring


def first_sentence(path: Path) -> str:
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return re.split(r"\.\s", " ".join(docstring.partition("\n\n")[0].split()))[0]


NOT_OF_THE_FILE = {"wcet", "trace_sha256", "rosbags", "idlc", "make"}
"""Names in heads that are a field of JSON, a member of C, or somebody else's program."""


def _identifiers(path: Path) -> set[str]:
    """Every name that the code of a file has: defined, imported, read, or written as a text."""
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        for attribute in ("name", "asname", "id", "attr", "arg"):
            found.update(str(getattr(node, attribute, "")).split("."))
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


@all_rows("path", SOURCES, ids=lambda p: str(p.relative_to(ROOT / "src" / "soter")))
def test_what_a_head_says_something_of_is_there(path: Path) -> None:
    """After a renaming it was not; of a package its files may have it, or those below."""
    head = " ".join((ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split())
    files = sorted(path.parent.rglob("*.py")) if path.name == "__init__.py" else [path]
    grammar = (ROOT / "docs" / "grammar.ebnf").read_text(encoding="utf-8")
    known = {*re.findall(r"'(\w+)'", grammar), *NOT_OF_THE_FILE}.union(*map(_identifiers, files))
    said = re.findall(r"`([A-Za-z_]\w*)` [a-z]+s\b", head)
    assert [name for name in said if name not in known] == []


SEVERAL_SUBJECTS = {
    "addons.py": 1,
    "api": 12,
    "campaign": 6,
    "certificate": 22,
    "cli": 13,
    "codegen": 11,
    "core": 6,
    "diagnostics": 5,
    "diagram": 3,
    "editor": 5,
    "explore": 16,
    "gym": 3,
    "language": 42,
    "mapping": 3,
    "monitor": 8,
    "native": 2,
    "playground": 3,
    "policy": 4,
    "remote": 1,
    "report": 14,
    "semantics": 4,
    "simulate": 9,
    "targets": 10,
    "verify": 39,
    "version.py": 1,
    "workers": 3,
}
"""Of each room: files whose first sentence has an "and". These may only become fewer."""


def test_a_file_has_one_subject() -> None:
    """It is said in the first sentence of its docstring, without an "and"."""
    rooms = [p.relative_to(ROOT / "src" / "soter").parts[0] for p in SOURCES]
    several = Counter(
        room for room, p in zip(rooms, SOURCES, strict=True) if " and " in first_sentence(p)
    )
    assert several == SEVERAL_SUBJECTS


def test_the_page_of_the_house_has_every_room_and_files_that_are_there() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)/` \|", page, re.MULTILINE)
    soter = ROOT / "src" / "soter"
    rooms = {p.name for p in soter.iterdir() if p.is_dir() and p.name != "__pycache__"}
    assert len(rows) == len(set(rows))
    assert set(rows) == rooms
    first = re.findall(r"^\d+\. `([\w./]+)`", page, re.MULTILINE)
    assert len(first) == 10
    assert [n for n in first if not ((soter / n).is_file() or (ROOT / n).is_file())] == []


def _missing_folders(text: str, *roots: Path) -> list[str]:
    """The folders that a text names, `x/`, and that lie in none of the roots."""
    named = re.findall(r"`([\w.]+(?:/[\w.]+)*)/`", text)
    return [name for name in named if not any((root / name).is_dir() for root in roots)]


def test_folders_that_the_table_of_rooms_names_are_there_and_it_names_all_packages() -> None:
    """Those below its room, or below `src/soter`; a package that lies in the room itself."""
    soter = ROOT / "src" / "soter"
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    wrong = []
    for room, told in re.findall(r"^\| `(\w+)/` \|[^|]*\|(.*)\|$", page, re.MULTILINE):
        wrong += [f"{room}: no {name}/" for name in _missing_folders(told, soter / room, soter)]
        packages = [p.parent.name for p in (soter / room).glob("*/__init__.py")]
        wrong += [f"{room}: {name}/ unnamed" for name in packages if f"`{name}/`" not in told]
    assert wrong == []


def test_folders_that_the_docstring_of_a_package_names_are_there() -> None:
    """Those beside it, or below `src/soter`."""
    soter = ROOT / "src" / "soter"
    wrong = []
    for path in SOURCES:
        if path.name == "__init__.py":
            told = ast.get_docstring(tree_of(path)) or ""
            at = path.parent.relative_to(soter).as_posix()
            wrong += [f"{at}: no {n}/" for n in _missing_folders(told, path.parent, soter)]
    assert wrong == []


def test_every_file_is_named_in_the_docstring_of_its_folder() -> None:
    """It says there, in reading order, what each file is for."""
    unnamed = [
        path.relative_to(ROOT / "src" / "soter").as_posix()
        for path in SOURCES
        if path.name != "__init__.py"
        and f"`{path.name}`" not in (ast.get_docstring(tree_of(path.parent / "__init__.py")) or "")
    ]
    assert unnamed == []


def test_files_that_docstrings_and_pages_name_are_there() -> None:
    """A path of one that ends in it; a bare name of a file of the same room, on a page of any."""
    there = {f"/{p.relative_to(ROOT).as_posix()}" for p in _tracked()}
    names = {p.rpartition("/")[2] for p in there}
    of_rooms: dict[str, set[str]] = {}
    for listed in there:
        if listed.startswith("/src/soter/"):
            room, _, name = listed.removeprefix("/src/soter/").partition("/")
            of_rooms.setdefault(room if name else "", set()).add(listed.rpartition("/")[2])
    of_users = re.compile(r"NAME|PREFIX|^(externs|actuate)\.c$|^(math|string)\.h$|^out/")
    missing = []
    for path in _tracked():
        at = path.relative_to(ROOT).as_posix()
        source = at.startswith("src/") and path.suffix in {".py", ".c", ".h"}
        page = at.startswith("docs/") and path.suffix == ".md"
        if not source and (not page or path.name in {"benchmarks.md", "decisions.md"}):
            continue
        text, inside = path.read_text(encoding="utf-8"), at.removeprefix("src/soter/")
        here = of_rooms[inside.partition("/")[0] if "/" in inside else ""] if source else names
        for name in re.findall(r"`((?:[\w.]+/)*\w+\.(?:py|c|h))`", text):
            known = name in here if "/" not in name else any(p.endswith(f"/{name}") for p in there)
            if not known and not of_users.search(name):
                missing.append(f"{at}: {name}")
    assert missing == []


def test_decisions_that_are_cited_are_there_once() -> None:
    """Under their own number, or among those that a later one *Replaces*."""
    page = (ROOT / "docs" / "decisions.md").read_text(encoding="utf-8")
    numbers = re.findall(r"^\*\*(\d+)\.", page, re.MULTILINE)
    for replaced in re.findall(r"\*Replaces ([\d,\s]+)", page):
        numbers += re.findall(r"\d+", replaced)
    several = (
        r"\bdecisions? (\d+(?:(?:,| to| and)\s+\d+)*)\b(?!:)|docs/decisions\.md, ([\d, toand]+)"
    )
    missing = []
    for path in _tracked():
        if path.suffix in {".md", ".py", ".c", ".h", ".soter"} and path.name != "benchmarks.md":
            for cited in re.finditer(several, path.read_text(encoding="utf-8", errors="replace")):
                at = path.relative_to(ROOT)
                missing += [
                    f"{at}: {n}" for n in re.findall(r"\d+", cited.group()) if n not in numbers
                ]
    assert missing == []
    assert len(numbers) == len(set(numbers))


def test_committed_text_names_no_path_of_a_machine() -> None:
    paths = []
    for path in _tracked():
        if path.suffix in {".png", ".npy", ".gz"} or path == Path(__file__):
            continue
        text = path.read_text(encoding="utf-8", errors="replace")
        paths += [f"{path.relative_to(ROOT)}: {m.group()}" for m in MACHINE_PATHS.finditer(text)]
    assert paths == []


def test_there_are_no_postponed_repairs() -> None:
    words = ("TO" + "DO", "FIX" + "ME", "XX" + "X")
    paths = [
        str(p.relative_to(ROOT))
        for p in _tracked()
        if p.suffix in {".py", ".c", ".h", ".soter"}
        and any(w in p.read_text(encoding="utf-8", errors="replace") for w in words)
    ]
    assert paths == []


@pytest.mark.parametrize("room", ["runtime", "verify/engine", "explore/engine/c"])
def test_the_c_has_no_heap_and_no_mutable_globals(room: str) -> None:
    for path in files_below(ROOT / "src" / "soter" / room, "*.[ch]"):
        text = path.read_text(encoding="utf-8")
        explorer = room.startswith("explore")  # never deployed: it keeps every world
        bridge = path.parent.name == "dds"  # not trusted, and DDS below it allocates as it likes
        core = path.parent.name == "cortex_m"  # interrupts take no argument
        # descriptors and signals are the process's, and a handler takes no argument
        core = core or path.name in {"soter_process.c", "soter_posix_main.c"}
        may = explorer or bridge
        assert may or not re.search(r"\b(malloc|calloc|realloc|free|alloca)\s*\(", text), path.name
        for line in text.splitlines():
            is_variable = re.match(
                r"^(static\s+)?(?!const)[a-z_0-9]+ \*?[a-z_]+(\[.*\])?( =.*)?;$", line
            )
            assert not is_variable or core or line.startswith(("typedef", "struct ")), line


def test_what_only_types_need_is_imported_for_types_alone() -> None:
    """`typing_extensions` is there beside the tools of a developer, and is no dependency."""
    at_run_time = re.compile(r"^(?:from|import) typing_extensions\b", re.MULTILINE)
    found = [p for p in SOURCES if at_run_time.search(p.read_text(encoding="utf-8"))]
    assert found == []
