"""What the editor takes a name for is what the checker takes it for, in unfinished programs too."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from soter.diagnostics.diagnostic import Diagnostics
from soter.editor.hover import declaration_head
from soter.editor.language_words import word_meaning
from soter.editor.name_resolution import index_of
from soter.language.front_end import check_file
from soter.language.load.loader import load
from soter.language.model import typed
from soter.language.model.tree_walk import nodes
from soter.language.syntax.lexer import NAME, lex

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.diagnostics.diagnostic import Span
    from soter.editor.name_definitions import NameIndex

ROOT = Path(__file__).resolve().parents[3]
PROGRAMS = sorted((ROOT / "examples").glob("*/*.soter"))
HOUSE_WORDS = {"truth", "len", "Mode", "AC", "SC"}
"""Names that nobody declares."""


def read_by(program: typed.TypedProgram) -> Iterator[tuple[Span, Span]]:
    """Where a checked program reads something, and where that is declared."""
    roots: list[object] = []
    for table in (program.funs, program.nodes, program.plants, program.modules):
        for symbol in table.values():
            values = [getattr(symbol, f) for f in symbol.__dataclass_fields__]
            roots += [v for v in values if not isinstance(v, (dict, list))]
            roots += [v for d in values if isinstance(d, dict) for v in d.values()]
    flat = [part for root in roots for part in (root if isinstance(root, tuple) else (root,))]
    for node in nodes(n for n in flat if isinstance(n, (typed.TypedExpr, typed.TypedStmt))):
        if isinstance(node, typed.VarRead):
            yield node.span, node.variable.span
        elif isinstance(node, typed.TopicRead):
            yield node.span, node.topic.span
        elif isinstance(node, typed.ParamRead):
            yield node.span, node.param.span


def words_of(index: NameIndex, path: Path) -> Iterator[tuple[str, int]]:
    """Names of a file that mean nothing to the index, and their lines."""
    source = next(f.source for f in index.files if f.path == path)
    known = {(u.span.start, u.span.end) for u in index.uses_in(source)}
    tokens = lex(source)
    for kind, text, start, end in zip(
        tokens.kinds, tokens.texts, tokens.starts, tokens.ends, strict=True
    ):
        if kind == NAME and (start, end) not in known:
            yield text, source.line_of(start)


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda p: p.stem)
def test_every_read_leads_to_what_the_checker_reads(path: Path) -> None:
    checked = check_file(str(path))
    assert checked.program is not None
    assert checked.loaded is not None
    index = index_of(checked.loaded)
    compared = 0
    for use, declared in read_by(checked.program):
        if use.source.name.startswith("<prelude>"):
            continue
        reference = index.use_at(use.source, use.end if "." in use.text else use.start)
        assert reference is not None, (use.source.name, use.line, use.text)
        assert reference.definition.span.source is declared.source, (use.line, use.text)
        assert declared.start <= reference.definition.span.start < declared.end, (
            use.line,
            use.text,
        )
        compared += 1
    assert compared


@pytest.mark.parametrize("path", PROGRAMS, ids=lambda p: p.stem)
def test_no_name_of_a_program_is_without_a_meaning(path: Path) -> None:
    """What is left are words of the grammar."""
    loaded = load(str(path), Diagnostics())
    assert loaded is not None
    left = {word for word, _ in words_of(index_of(loaded), path)}
    assert {w for w in left if word_meaning(w) is None} - HOUSE_WORDS == set()


ALL_IN_ONE = "let way = { x: cos(angle), up: { y: 1.0 } };"


def test_a_field_that_no_type_declares_is_declared_where_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "a.soter"
    text = f"soter 1;\nfun f(angle: float): float {{ {ALL_IN_ONE} return way.x + way.up.y; }}\n"
    path.write_text(text)
    loaded = load(str(path), Diagnostics())
    assert loaded is not None
    index = index_of(loaded)
    (source,) = [f.source for f in index.files if f.path == path]
    for used, declared in (("way.x", "x:"), ("way.up", "up:"), ("up.y", "y:")):
        use = index.use_at(source, text.index(used) + len(used))
        assert use is not None
        assert use.definition.span.start == text.index(declared)
    way = index.use_at(source, text.index("way"))
    assert way is not None
    assert declaration_head(way.definition) == "(let) way: { x: float, up: { y: float } }"


def test_names_in_rest_lead_to_what_they_mean(tmp_path: Path) -> None:
    path = tmp_path / "a.soter"
    text = (
        "soter 1;\ntype Motion = { x: float, v: float };\ntopic motion: Motion;\n"
        "param WAY: float = 0.1;\nconst LONG: duration = 3s;\n"
        "rta R { rest motion.v < 0.1 moves motion.x by WAY up within LONG; }\n"
    )
    path.write_text(text)
    loaded = load(str(path), Diagnostics())
    assert loaded is not None
    index = index_of(loaded)
    (source,) = [f.source for f in index.files if f.path == path]
    rest = text.index("rest")
    found = {"motion": "motion: M", "WAY": "WAY:", "LONG": "LONG:", ".x": "x: f", ".v": "v: f"}
    for used, declared in found.items():
        use = index.use_at(source, text.index(used, rest) + len(used))
        assert use is not None
        assert use.definition.span.start == text.index(declared)
    module = index.use_at(source, text.index("R {"))
    assert module is not None
    assert word_meaning("moves") is not None


def test_a_field_of_an_element_is_found_where_the_array_is_written_without_a_type(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.soter"
    text = (
        "soter 1;\ntype Place = { x: float };\ntopic a: Place;\ntopic b: Place;\n"
        "node N period 10ms { subscribes a, b; publishes out;\n"
        "  step { let both = [a, b]; let one = both[1]; publish out = one.x + both.len; } }\n"
        "topic out: float;\n"
    )
    path.write_text(text)
    loaded = load(str(path), Diagnostics())
    assert loaded is not None
    index = index_of(loaded)
    (source,) = [f.source for f in index.files if f.path == path]
    use = index.use_at(source, text.index("one.x") + len("one.x"))
    assert use is not None
    assert use.definition.span.start == text.index("x: float")
    both = index.use_at(source, text.index("both"))
    assert both is not None
    assert declaration_head(both.definition) == "(let) both: Place[2]"


def test_names_in_and_behind_the_indices_of_a_path_lead_to_what_they_mean(tmp_path: Path) -> None:
    path = tmp_path / "a.soter"
    text = (
        "soter 1;\ntype Joint = { q: float, w: float };\ntopic arm: Joint[2];\n"
        "const LAST: int = 1;\nconst NEXT: int = 0;\n"
        "plant Arm period 10ms { drives arm = joints; state joints: Joint[2];\n"
        "  measured arm[LAST].q within 0.1; }\n"
        "rta R { verify { grid arm[NEXT].w in [0, 1] / 9, a.joints[LAST].w in [0, 1] / 9; } }\n"
        "system S { a: Arm; module R; }\n"
    )
    path.write_text(text)
    loaded = load(str(path), Diagnostics())
    assert loaded is not None
    index = index_of(loaded)
    (source,) = [f.source for f in index.files if f.path == path]
    found = {
        "measured arm[LAST].q": {"arm[": "arm:", "LAST": "LAST:", ".q": "q: f"},
        "grid arm[NEXT].w": {"arm[": "arm:", "NEXT": "NEXT:", ".w": "w: f"},
        "a.joints[LAST].w": {"joints[": "joints: J", "LAST": "LAST:", ".w": "w: f"},
    }
    for where, names in found.items():
        for used, declared in names.items():
            use = index.use_at(source, text.index(used, text.index(where)) + len(used.rstrip("[")))
            assert use is not None, (where, used)
            assert use.definition.span.start == text.index(declared), (where, used)


def meanings(path: Path, text: str) -> dict[int, tuple[str, str]]:
    """Start of each name of a text -> the kind and the name of what it means."""
    loaded = load(str(path), Diagnostics(), text)
    assert loaded is not None
    uses = index_of(loaded).uses_in(loaded.main.source)
    return {u.span.start: (u.definition.kind, u.definition.name) for u in uses}


@pytest.mark.parametrize("part", range(16))
def test_names_keep_their_meaning_while_a_line_is_missing(part: int) -> None:
    """A module without its AC, say: nothing else of it is unknown for that."""
    path = ROOT / "examples" / "wall" / "cart.soter"
    text = path.read_text(encoding="utf-8")
    whole, lines = meanings(path, text), text.splitlines(keepends=True)
    for k in range(part, len(lines), 16):
        start, line = sum(map(len, lines[:k])), lines[k]
        if "{" in line or "}" in line or line.startswith("topic"):
            continue  # bodies that do not end, and fields of what is not declared
        left = meanings(path, text[:start] + text[start + len(line) :])
        for at, meant in whole.items():
            declared_here = re.search(rf"\b{meant[1]}\b", line) is not None
            if not start <= at < start + len(line) and not declared_here:
                assert left.get(at if at < start else at - len(line)) == meant, (line, meant)
