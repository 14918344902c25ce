"""Diagnostics as one types, over standard input and output, by a client that knows the protocol."""

from __future__ import annotations

from typing import TYPE_CHECKING

from editor_client import editor

if TYPE_CHECKING:
    from pathlib import Path

    from lsprotocol import types as lsp

    from editor_client import Editor

GOOD = "soter 1;\nconst A: float = 1.0;\n"


def places(diagnostics: list[lsp.Diagnostic]) -> list[tuple[object, int, int, int, int]]:
    """Code and range of each."""
    return [
        (
            d.code,
            d.range.start.line,
            d.range.start.character,
            d.range.end.line,
            d.range.end.character,
        )
        for d in diagnostics
    ]


def test_what_is_typed_is_told(served: Editor, tmp_path: Path) -> None:
    uri, diagnostics = served.checked(tmp_path / "a.soter", GOOD)
    assert diagnostics == []
    version = served.type(uri, "soter 1;\nconst A: float = B + C;\n")
    diagnostics = served.diagnostics(uri, version)
    assert places(diagnostics) == [("N001", 1, 17, 1, 18), ("N001", 1, 21, 1, 22)]
    assert diagnostics[0].message.startswith("unknown name `B`: not declared")
    assert diagnostics[0].source == "soter"
    assert served.diagnostics(uri, served.type(uri, GOOD)) == []


def test_ranges_count_in_units_of_utf_16(served: Editor, tmp_path: Path) -> None:
    text = "soter 1;\nfun f(): int { /* 𝄞é */ return B; }\n"
    _, diagnostics = served.checked(tmp_path / "a.soter", text)
    assert places(diagnostics) == [("N001", 1, 32, 1, 33)]


def test_ranges_count_in_the_units_that_the_client_prefers(tmp_path: Path) -> None:
    text = "soter 1;\nfun f(): int { /* 𝄞é */ return B; }\n"
    with editor(tmp_path, encodings=("utf-8",)) as bytes_:
        _, diagnostics = bytes_.checked(tmp_path / "a.soter", text)
        assert places(diagnostics) == [("N001", 1, 35, 1, 36)]


def test_imports_that_are_not_saved_count(served: Editor, tmp_path: Path) -> None:
    (tmp_path / "lib.soter").write_text(GOOD, encoding="utf-8")
    main = 'soter 1;\nimport "lib.soter" as lib;\nfun f(): float { return lib.A + lib.B; }\n'
    uri, diagnostics = served.checked(tmp_path / "main.soter", main)
    assert [d.code for d in diagnostics] == ["N001"]
    lib, _ = served.checked(tmp_path / "lib.soter")
    served.type(lib, GOOD + "const B: float = 2.0;\n")
    while served.diagnostics(uri):
        pass
    served.close(lib)  # the disk has no B
    while not (diagnostics := served.diagnostics(uri)):
        pass
    assert [d.code for d in diagnostics] == ["N001"]


def test_a_mistake_in_an_import_is_told_there(served: Editor, tmp_path: Path) -> None:
    lib = tmp_path / "lib.soter"
    lib.write_text("soter 1;\nconst A: float = B;\n", encoding="utf-8")
    main = 'soter 1;\nimport "lib.soter" as lib;\nfun f(): float { return lib.A; }\n'
    uri, diagnostics = served.checked(tmp_path / "main.soter", main)
    assert diagnostics == []
    assert places(served.diagnostics(lib.as_uri())) == [("N001", 1, 17, 1, 18)]
    served.close(uri)
    assert served.diagnostics(lib.as_uri()) == []


def test_one_mistake_in_many_places_is_marked_in_each(served: Editor, tmp_path: Path) -> None:
    text = "soter 1;\nfun f(): float {\n  return B\n    + B;\n}\n"
    _, diagnostics = served.checked(tmp_path / "a.soter", text)
    assert places(diagnostics) == [("N001", 2, 9, 2, 10), ("N001", 3, 6, 3, 7)]


def test_a_client_that_says_nothing_sensible_ends_nothing(served: Editor, tmp_path: Path) -> None:
    uri, diagnostics = served.checked(tmp_path / "a.soter", "\0\ud7ff}}}\u2028 soter \r\n\x0c{")
    assert diagnostics
    served.close(uri)
    served.diagnostics(uri)
    served.close(uri)
    assert served.checked(tmp_path / "a.soter", GOOD)[1] == []
