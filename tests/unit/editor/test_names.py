"""Names in the editor: hover, definition, references, rename, symbols."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest
from lsprotocol import types as lsp
from pygls.exceptions import JsonRpcInvalidRequest

from editor_client import Editor, edited, place
from soter.language.front_end import check_file

if TYPE_CHECKING:
    from pathlib import Path


def count(name: str, text: str) -> int:
    return len(re.findall(rf"\b{name}\b", text))


class Cart:
    """The cart, open in an editor."""

    def __init__(self, served: Editor, folder: Path) -> None:
        self.path = folder / "cart.soter"
        self.text = self.path.read_text(encoding="utf-8")
        self.editor, self.client = served, served.client
        self.uri, diagnostics = served.checked(self.path)
        assert diagnostics == []
        self.document = lsp.TextDocumentIdentifier(self.uri)

    def at(self, words: str, behind: int = 0) -> dict[str, Any]:
        """Where a question is asked."""
        return {"text_document": self.document, "position": place(self.text, words, behind)}

    def hover(self, words: str, behind: int = 0) -> str:
        """What is said there; empty where nothing is."""
        params = lsp.HoverParams(**self.at(words, behind))
        hover = self.editor.ask(self.client.text_document_hover_async(params))
        return "" if hover is None else hover.contents.value

    def rename(self, words: str, name: str, behind: int = 0) -> dict[str, Any]:
        """The edits by file."""
        params = lsp.RenameParams(new_name=name, **self.at(words, behind))
        edit = self.editor.ask(self.client.text_document_rename_async(params))
        return {} if edit is None else dict(edit.changes)


@pytest.fixture
def cart(served: Editor, wall: Path) -> Cart:
    return Cart(served, wall)


def test_a_topic_is_told_with_type_age_and_who_speaks_and_listens(cart: Cart) -> None:
    said = cart.hover("motion.x) - 1.0")
    assert "topic motion: Motion max_age 20ms;" in said
    assert "fresh for 20ms" in said
    assert "published by `Cart`; read by `Fast`, `Careful`" in said


def test_a_topic_is_told_with_its_set_in_numbers(cart: Cart) -> None:
    assert "`accel` in [-3.0, 3.0]" in cart.hover("publishes accel", 10)


def test_fields_locals_functions_and_periods_are_told(cart: Cart) -> None:
    assert "(field) x: float" in cart.hover("motion.x) - 1.0", 7)
    assert "(let) v: float" in cart.hover("v * v")
    assert "fun Need(speed: float, tau: float): float" in cart.hover("Need(m.v")
    assert "Clearance that any controller may use up" in cart.hover("Need(m.v")
    assert "period: 50ms" in cart.hover("rta SafeCart", 4)
    assert "value: `10.0`" in cart.hover("WALL] / 400")


def test_words_are_told_where_they_are_words(cart: Cart) -> None:
    assert "SC must take over now" in cart.hover("ttf Room")
    assert "larger of two" in cart.hover("max(speed")
    assert cart.hover("must not touch the walls") == ""  # a comment


def test_what_was_known_is_told_of_a_program_that_is_broken(cart: Cart) -> None:
    cart.text = cart.text.replace("-2.0 * motion.x", "-2.0 * motion. ) nonsense +")
    cart.editor.type(cart.uri, cart.text)
    assert cart.editor.diagnostics(cart.uri)
    said = cart.hover("subscribes motion, goal", 11)
    assert "topic motion: Motion max_age 20ms;" in said
    assert "published by `Cart`" in said


def test_a_use_leads_to_its_declaration(cart: Cart) -> None:
    ask = cart.client.text_document_definition_async
    location = cart.editor.ask(ask(lsp.DefinitionParams(**cart.at("Careful;"))))
    assert (location.uri, location.range.start) == (cart.uri, place(cart.text, "Careful period"))
    location = cart.editor.ask(ask(lsp.DefinitionParams(**cart.at("clamp("))))
    assert location.uri.endswith("/prelude/math.soter")


def test_a_use_in_another_file_is_a_reference(cart: Cart, wall: Path) -> None:
    context = lsp.ReferenceContext(include_declaration=False)
    params = lsp.ReferenceParams(context=context, **cart.at("rta SafeCart", 4))
    references = cart.editor.ask(cart.client.text_document_references_async(params))
    assert {f.uri for f in references} == {p.as_uri() for p in wall.iterdir()}
    assert place(cart.text, "SafeCart {") not in [
        f.range.start for f in references if f.uri == cart.uri
    ]


@pytest.mark.parametrize(
    ("words", "behind", "new"),
    [
        ("topic motion", 6, "whereabouts"),
        ("SafeCart {", 0, "Guard"),
        ("let v", 4, "fastest"),
        ("const WALL", 6, "END"),
        ("c: Cart", 0, "trolley"),
        ("node Fast", 5, "Rash"),
    ],
)
def test_a_program_with_another_name_is_the_same_program(
    cart: Cart, wall: Path, words: str, behind: int, new: str
) -> None:
    old = words[behind:].split(" ", maxsplit=1)[0].rstrip(":,")
    before = {p.name: p.read_text(encoding="utf-8") for p in wall.iterdir()}
    for path in wall.iterdir():
        assert check_file(str(path)).diagnostics.items == ()
    changes = cart.rename(words, new, behind)
    assert cart.uri in changes
    for uri, edits in changes.items():
        path = wall / uri.rpartition("/")[2]
        path.write_text(edited(before[path.name], edits), encoding="utf-8")
    for path in wall.iterdir():
        assert check_file(str(path)).diagnostics.items == ()
    after = cart.path.read_text(encoding="utf-8")
    assert count(new, after) == count(old, before["cart.soter"]) - count(old, after) > 1


@pytest.mark.parametrize(
    ("words", "new", "why"),
    [
        ("topic motion", "accel", "something else"),
        ("topic motion", "node", "word of the language"),
        ("topic motion", "1st", "no name"),
        ("fun Need", "max", "something else"),
        ("let v", "tau", "something else"),
        ("state x", "position", "the checker would say"),  # then `c.truth` is no Motion
    ],
)
def test_a_name_that_would_change_the_meaning_is_refused(
    cart: Cart, words: str, new: str, why: str
) -> None:
    with pytest.raises(JsonRpcInvalidRequest, match=why):
        cart.rename(words, new, words.index(" ") + 1)


def test_the_prelude_keeps_its_names(cart: Cart) -> None:
    ask = cart.client.text_document_prepare_rename_async
    assert cart.editor.ask(ask(lsp.PrepareRenameParams(**cart.at("clamp(")))) is None
    placeholder = cart.editor.ask(ask(lsp.PrepareRenameParams(**cart.at("Need("))))
    assert placeholder.placeholder == "Need"


def test_the_outline_has_what_declarations_have_inside(cart: Cart) -> None:
    params = lsp.DocumentSymbolParams(cart.document)
    symbols = cart.editor.ask(cart.client.text_document_document_symbol_async(params))
    inside = {s.name: [c.name for c in s.children or ()] for s in symbols}
    assert inside["Motion"] == ["x", "v"]
    assert inside["Cart"] == ["x", "v", "wind"]
    assert inside["Protected"] == ["c", "SafeCart"]
    assert list(inside)[:3] == ["A", "WALL", "FAST"]


def test_declarations_are_found_in_every_open_file(cart: Cart) -> None:
    params = lsp.WorkspaceSymbolParams("sfcrt")
    symbols = cart.editor.ask(cart.client.workspace_symbol_async(params))
    assert ("SafeCart", cart.uri) in [(s.name, s.location.uri) for s in symbols]
