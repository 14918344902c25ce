"""Every help that is an edit is applied to its program, which then is rid of the error.

What the others say in code is read: it must be Soter, with `...` for what the user knows.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

from generators.file_listing import files_in
from soter.diagnostics.diagnostic import Diagnostics, Severity, Source
from soter.diagnostics.fixes import apply_fix
from soter.language.front_end import CheckResult, check_file
from soter.language.syntax.parsing.parser import parse
from tables import all_rows

if TYPE_CHECKING:
    from soter.diagnostics.diagnostic import Diagnostic, Fix, Span

FOLDER = Path(__file__).parent
PROGRAMS = [p.name for p in files_in(FOLDER, "*.soter")]

#: What an error hid, and its fix shows: the next step is the user's.
SHOWN_BY_A_FIX = {
    "N001_instance_that_cannot_be_made.soter": {"M013", "T002"},
    "T014_duration_argument.soter": {"T002"},
}


def after(name: str, fix: Fix) -> CheckResult | None:
    """The program checked with a fix; None where the fix is of another file."""
    texts = {source.name: text for source, text in apply_fix(fix).items()}
    return check_file(name, texts[name]) if set(texts) == {name} else None


def same(one: Diagnostic, other: Diagnostic) -> bool:
    return (one.code, one.message) == (other.code, other.message)


@all_rows("name", PROGRAMS)
def test_a_help_that_is_an_edit_removes_the_error_and_brings_no_other(name: str) -> None:
    diagnostics = check_file(name).diagnostics.items
    for d in diagnostics:
        for fix in d.fixes:
            assert fix.title in d.helps
            assert fix.edits
            mended = after(name, fix)
            if mended is None:
                continue
            left = mended.diagnostics.items
            assert not any(same(d, x) for x in left), (fix, [x.message for x in left])
            told = {(x.code, x.message) for x in diagnostics}
            errors = [x for x in left if x.severity is Severity.ERROR]
            new = [x for x in errors if (x.code, x.message) not in told]
            assert {x.code for x in new} <= SHOWN_BY_A_FIX.get(name, set()), (fix, new)


# ---------------------------------------------------------------- code in the other helps

#: Where a piece of code of a help may stand.
PLACES = (
    "{}",
    "const A: float = {};",
    "const A: {} = b;",
    "topic t: float {};",
    "fun f(): float {{ {} }}",
    "fun f(): float {{ let {}; }}",
    "node N period 10ms {{ {} step {{ }} }}",
    "node N period 10ms {{ publishes {}; step {{ }} }}",
    "node N period 10ms {{ step {{ {} }} }}",
    "node N period 10ms {{ step {{ let a = {}; }} }}",
    "plant P period 10ms {{ {} }}",
    "rta M {{ {} }}",
    "rta M {{ verify {{ {} }} }}",
    "system S {{ {} }}",
    "system S {{ a: B {}; }}",
    "system S {{ {}; }}",
    "system S {{ input t {} every 1s; }}",
    "node N period 10ms {{ step {{ {} {{ }} }} }}",
    "{}: float;",
    "test T {{ {} }}",
    "import {} as a;",
    "extern node N period 1ms from {} {{ }}",
)
#: What the dots of a help stand for.
FILLINGS = (
    ("{ ... }", "{ }"),
    ("{ ... }", "{ step { } }"),
    ("...", "b"),
    ("...", "b: a"),
    ("= ...", "= b"),
    ("...", "1"),
)
WORD = re.compile(r"[.\w]+|[-+*/%<>=!&|]+|[\w./-]+\.(soter|json|csv|npy)|\[<=[\w.]+\]|in \{ \}")


def is_soter(code: str) -> bool:
    """Whether it can stand somewhere in a program, with something in place of its dots."""
    if WORD.fullmatch(code):
        return True
    written = {code}
    for dots, filling in FILLINGS:
        written |= {w.replace(dots, filling) for w in list(written)}
    return any(_parses(place.format(w)) for place in PLACES for w in sorted(written))


def _parses(text: str) -> bool:
    diagnostics = Diagnostics()
    parse(Source("help.soter", f"soter 1;\n{text}\n"), diagnostics)
    return not diagnostics.has_errors


def helps() -> list[tuple[str, str]]:
    os.chdir(FOLDER)
    name_by_help: dict[str, str] = {}
    for name in PROGRAMS:
        for d in check_file(name).diagnostics.items:
            titles = {f.title for f in d.fixes}
            name_by_help |= {h: name for h in d.helps if h not in titles and "`" in h}
    return sorted(name_by_help.items())


def test_code_in_a_help_is_soter() -> None:
    wrong = [
        (help_, code, name)
        for help_, name in helps()
        for code in re.findall(r"`([^`]+)`", help_)
        if not is_soter(code)
    ]
    assert not wrong


# ---------------------------------------------------------------- the other helps, carried out

PROPOSAL = re.compile(
    r"(?:^|[,:;] )(write|did you mean|(?:declare|call|convert|compare|name) it:|by components:|"
    r"indices begin at 0:) `([^`]+)`"
)
#: Proposals for another place than that of the error, and a file whose name is near: what it holds
#: is seen when it is read.
FOR_ANOTHER_PLACE = {
    "did you mean `files/boxes.json`?",
    "write `external topic pair;`",
    "write `replace Fast by ...;`",
    "write `replace g by ...;`",
    "write `ttf ...;` and `safer ...;`",
    "write `safer` too, or leave both out: then they are computed",
}


def carried_out(text: str, span: Span, verb: str, code: str) -> list[tuple[str, int, int]]:
    """(program, first and last offset to look at): where the token, or its item, is replaced.

    What is declared stands at the end, so that nothing moves.
    """
    if verb.startswith("declare"):
        return [(f"{text}\n{code}\n", span.start, span.end)]
    item = max(text.rfind(c, 0, span.start) for c in ";{}") + 1
    stop = text.find(";", span.end) + 1 or len(text)
    quoted = span.text.startswith('"') and not code.startswith('"')
    written = f'"{code}"' if quoted else code
    return [
        (text[:a] + written + text[b:], a, a + len(written))
        for a, b in ((span.start, span.end), (item, stop))
    ]


def still_wrong(name: str, d: Diagnostic, verb: str, code: str) -> list[str]:
    """What is said about the token when the code of a help stands there; [] where all is well.

    What stands for the dots of a help may be wrong.
    """
    assert d.primary is not None
    span = d.primary.span
    written = {code}
    for dots, filling in FILLINGS:
        written |= {w.replace(dots, filling) for w in list(written)}
    said: list[str] = []
    for w in sorted(written):
        for text, low, high in carried_out(span.source.text, span, verb, w):
            errors = [
                (x.message, x.primary.span)
                for x in check_file(name, text).diagnostics.items
                if x.severity is Severity.ERROR and x.primary is not None
            ]
            about = [m for m, s in errors if s.start < high and s.end > low]
            filled = {s.text for _, s in errors} <= {"a", "b", "1"} and w != code
            if not about or filled:
                return []
            said += about
    return said


@all_rows("name", PROGRAMS)
def test_a_proposal_that_is_carried_out_leads_to_no_other_error_there(name: str) -> None:
    for d in check_file(name).diagnostics.items:
        titles = {f.title for f in d.fixes}
        for help_ in d.helps:
            proposed = PROPOSAL.search(help_)
            if help_ in titles | FOR_ANOTHER_PLACE or proposed is None or d.primary is None:
                continue
            assert not still_wrong(name, d, *proposed.groups()), help_


def test_a_proposal_in_a_circle_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "circle.soter"
    text = "soter 1;\nnode A period 1s { subscribes wind; step { } }\nsystem S { node A; }\n"
    path.write_text(text, encoding="utf-8")
    (d,) = check_file(str(path)).diagnostics.items
    assert still_wrong(str(path), d, "declare", "topic wind: float;")
    assert not still_wrong(str(path), d, "declare", "input topic wind: float;")


def test_code_that_is_none_is_noticed() -> None:
    assert is_soter("state x: float;")
    assert is_soter("for i in 0..10 { ... }")
    assert not is_soter("for (i = 0; i < 9; i++) { ... }")
    assert not is_soter("state float x;")
