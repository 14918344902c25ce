"""Completion: where in a text the cursor is, and what could be written there.

Purpose: `cursor_at` finds the body around the cursor from the tokens before it, however broken the
rest is. `completion_items` offers words that can begin something here, visible names of fitting
kinds, and members after a dot.
Non-goals: ranking beyond what is near first.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from lsprotocol import types as lsp

from soter.diagnostics.diagnostic import Source
from soter.editor import language_words
from soter.editor.hover import declaration_head, type_text
from soter.language.syntax import tree
from soter.language.syntax.lexer import NAME, lex

if TYPE_CHECKING:
    from collections.abc import Iterator

    from soter.editor.name_definitions import Definition, NameIndex
    from soter.language.load.loader import LoadedFile


BODIES = {
    "node": "node", "rta": "rta", "verify": "verify", "view": "view", "plant": "plant",
    "system": "system", "test": "test", "faults": "faults", "fun": "block", "step": "block",
    "on": "block", "if": "block", "elseif": "block", "else": "block", "enum": "names",
}  # fmt: skip
"""Word that begins an item -> the kind of body in its braces."""


@dataclass(frozen=True)
class CursorContext:
    """The place of the cursor. `body`: the body around it, "file" at the top, "value" in a value.

    `head`: the words of the declaration around it (`node` and a name); `item`: the tokens of the
    present item, up to the word that is being written; `dotted`: the names with dots in front of
    that word; `word`: the part of the word before the cursor, from offset `start`.
    """

    body: str
    head: tuple[str, ...]
    item: tuple[str, ...]
    dotted: tuple[str, ...]
    word: str
    start: int
    quiet: bool = False
    """Whether it is in a comment or a string, where nothing is offered."""


def cursor_at(text: str, offset: int) -> CursorContext:
    """The context of the cursor at a character offset."""
    tokens = lex(Source("", text[:offset]))
    for start, end in tokens.comments:
        if start < offset <= end and not text[start:end].endswith("*/"):
            return CursorContext("", (), (), (), "", offset, quiet=True)
    texts, kinds = list(tokens.texts), tokens.kinds
    count = next((i for i, kind in enumerate(kinds) if kind == "EOF"), len(kinds))
    touched = texts[count - 1] if count and tokens.ends[count - 1] == offset else ""
    if tokens.truncated or touched.startswith('"'):
        return CursorContext("", (), (), (), "", offset, quiet=True)
    word, at = "", offset
    if touched and (kinds[count - 1] == NAME or touched.isidentifier()):
        count -= 1
        word, at = touched, tokens.starts[count]
    stack: list[tuple[str, list[str]]] = [("file", [])]
    for text_ in texts[:count]:
        _enter_token(stack, text_)
    body, item = stack[-1]
    return CursorContext(body, tuple(stack[0][1]), tuple(item), _names_before_dots(item), word, at)


def _names_before_dots(item: list[str]) -> tuple[str, ...]:
    """The names with dots after them at the end of an item, as `a`, `b` for `a.b.`."""
    dotted: list[str] = []
    i = len(item)
    while i >= 2 and item[i - 1] == "." and item[i - 2].isidentifier():
        dotted.insert(0, item[i - 2])
        i -= 2
    return tuple(dotted)


def _enter_token(stack: list[tuple[str, list[str]]], text: str) -> None:
    body, item = stack[-1]
    if text == "{":
        stack.append((_body_kind(body, item), []))
        item.append(text)
    elif text == "}":
        if len(stack) > 1:
            stack.pop()
            outer = stack[-1][1]
            if body not in {"value", "names", "wires"}:
                outer.clear()
            else:
                outer.append("}")
    elif text == ";":
        item.clear()
    else:
        item.append(text)


def _body_kind(body: str, item: list[str]) -> str:
    """The kind of the body that opens with a brace after an item."""
    words = [w for w in item if w != "extern"]
    first = words[0] if words else ""
    if "=" in item and first not in BODIES:
        return "value"
    if first == "for":
        return "block" if body == "block" else body
    if body == "system" and (first in {"module", "node"} or (len(item) > 2 and item[-2] == ":")):
        return "wires"
    if body == "system" and ":" in item:
        return "wires"
    return BODIES.get(first, "value")


KIND = lsp.CompletionItemKind
ICONS = {
    "type": KIND.Struct,
    "constant": KIND.Constant,
    "parameter": KIND.Property,
    "function": KIND.Function,
    "topic": KIND.Event,
    "node": KIND.Class,
    "module": KIND.Interface,
    "plant": KIND.Class,
    "system": KIND.Module,
    "test": KIND.Module,
    "import": KIND.Module,
    "field": KIND.Field,
    "member": KIND.EnumMember,
    "instance": KIND.Value,
}
VALUES = {"constant", "parameter", "function", "topic", "type", "import", "instance"}
AFTER: dict[str, set[str]] = {
    "publish": {"topic"},
    "subscribes": {"topic"},
    "publishes": {"topic"},
    "reads": {"topic"},
    "drives": {"topic"},
    "failsafe": {"topic"},
    "after": {"topic"},
    "moves": {"topic"},
    "ac": {"node"},
    "sc": {"node"},
    "module": {"module"},
    "node": {"node"},
    "force": {"module", "instance"},
    "deploys": {"system"},
    "system": {"system"},
    "by": {"node", "plant"},
    "set": {"parameter", "instance"},
    "replace": {"node", "plant", "instance", "module"},
    "inline": {"node", "instance", "module"},
    "input": {"topic", "instance"},
    "mode": {"module", "instance"},
    "margin": {"module", "instance"},
    "invariant": {"module", "instance"},
    "age": {"topic", "instance"},
}
"""Word before the cursor -> kinds of names that can follow; imports always can."""
LISTS = {"subscribes", "publishes", "reads", "rest"}
NAMING = {"let", "var", "const", "param", "fun", "topic", "state", "rta", "plant", "type"}
NAMING_IN_FILE = {"node", "system", "test", "as"}
TYPED = {"let", "var", "const", "param", "topic", "input", "state", "disturbance", "type", "extern"}
"""Words that lead an item in which a type follows the first `:`."""


def completion_items(
    text: str, offset: int, file: LoadedFile, index: NameIndex, good: NameIndex | None
) -> list[lsp.CompletionItem]:
    """Proposals for the cursor; `good`: names of the last text that parsed, for its locals."""
    cursor = cursor_at(text, offset)
    if cursor.quiet:
        return []
    item_by_label: dict[str, lsp.CompletionItem] = {}
    for item in _cursor_items(cursor, offset, file, index, good):
        item_by_label.setdefault(item.label, item)
    return list(item_by_label.values())


def _cursor_items(
    cursor: CursorContext, offset: int, file: LoadedFile, index: NameIndex, good: NameIndex | None
) -> Iterator[lsp.CompletionItem]:
    names = _visible_names(cursor, offset, file, index, good)
    wanted = _wanted_kinds(cursor) if cursor.item else None
    if not cursor.item:
        yield from (_word_item(w, cursor.body) for w in language_words.PLACES.get(cursor.body, ()))
        kinds = {"variable", "state"} if cursor.body == "block" else set()
        yield from _items_of_kinds(names, kinds, "0")
    elif cursor.item[-1] == ".":
        yield from _member_items(cursor, names, index)
    elif wanted == {"a type"}:
        yield from (_word_item(w, "type") for w in language_words.TYPES)
        yield from _items_of_kinds(names, {"type", "import"}, "1")
    elif wanted is None:
        yield from (_name_item(d, _sort_key(d, file)) for d in names.values() if _is_value(d))
        words = (*language_words.BUILTINS, *language_words.SPECIALS, *language_words.VALUES)
        yield from (_word_item(word, "value") for word in words)
    elif wanted != {"new"}:
        yield from _items_of_kinds(names, {*wanted, "import"}, "0")


def _items_of_kinds(
    names: dict[str, Definition], kinds: set[str], rank: str
) -> Iterator[lsp.CompletionItem]:
    return (_name_item(d, rank) for d in names.values() if d.kind in kinds)


def _wanted_kinds(cursor: CursorContext) -> set[str] | None:
    """The kinds of names that fit here; None if any value fits; {"new"} if only a new name fits."""
    last, first = cursor.item[-1], cursor.item[0]
    before = cursor.item[-2] if len(cursor.item) > 1 else ""
    if last in NAMING or (cursor.body == "file" and last in NAMING_IN_FILE):
        return {"new"}
    if last == "(" and before in AFTER:
        return AFTER[before]
    if last == ":":
        return _kinds_after_colon(cursor)
    if last == "," and first in LISTS:
        return {"topic"}
    if last in AFTER and (last, first) != ("by", "rest"):
        return AFTER[last]
    return None


def _kinds_after_colon(cursor: CursorContext) -> set[str] | None:
    first = cursor.item[0]
    if cursor.body == "system":
        return {"plant", "module", "system", "node"}
    typed = first == "fun" or (first in TYPED and "=" not in cursor.item)
    return {"a type"} if typed else None


def _visible_names(
    cursor: CursorContext, offset: int, file: LoadedFile, index: NameIndex, good: NameIndex | None
) -> dict[str, Definition]:
    """By name: the visible definitions; for equal names, the innermost definition."""
    definition_by_name: dict[str, Definition] = {}
    for prelude in index.files:
        if prelude.prelude:
            declared = index.declared_in(prelude)
            definition_by_name |= {n: d for n, d in declared.items() if not n.startswith("_")}
    definition_by_name |= index.declared_in(file)
    if good is not None:
        home, decl = _enclosing_declaration(cursor, good, file)
        definition_by_name |= _instances_by_name(good, decl)
        reached = [] if home is None or decl is None else good.reach.get(id(home.source), [])
        definition_by_name |= {d.name: d for _, _, d in reached if d.owner is decl}
    definition_by_name |= _instances_by_name(index, _enclosing_declaration(cursor, index, file)[1])
    return definition_by_name | index.locals_at(file.source, offset)


def _enclosing_declaration(
    cursor: CursorContext, index: NameIndex, file: LoadedFile
) -> tuple[LoadedFile | None, Definition | None]:
    """The file in the index, and the declaration around the cursor; each is None if unknown."""
    home = next((f for f in index.files if f.path == file.path), None)
    declared = {} if home is None else index.declared_in(home)
    return home, next((declared[w] for w in cursor.head if w in declared), None)


def _instances_by_name(index: NameIndex, decl: Definition | None) -> dict[str, Definition]:
    """By name: the instances of a system; {} if `decl` is None."""
    instances = {} if decl is None else index.instances.get(id(decl.node), {})
    return {name: definition for name, (definition, _) in instances.items()}


def _is_value(d: Definition) -> bool:
    return d.kind in VALUES or not isinstance(d.node, tree.Decl)


def _sort_key(d: Definition, file: LoadedFile) -> str:
    """A sort key: locals come first, then names of this file, then all other names."""
    if not isinstance(d.node, tree.Decl):
        return "0"
    return "1" if d.file is file else "2"


# ---------------------------------------------------------------- behind dots


def _member_items(
    cursor: CursorContext, names: dict[str, Definition], index: NameIndex
) -> Iterator[lsp.CompletionItem]:
    if not cursor.dotted:
        return
    first, *rest = cursor.dotted
    members = index.members
    assert members is not None
    of = names[first].of if first in names else None
    if first == "Mode" and first not in names:
        yield from (lsp.CompletionItem(m, kind=KIND.EnumMember) for m in ("AC", "SC"))
    for name in rest:
        of = members.meaning_of_member(of, name)
    wanted = _kinds_in_import(cursor)
    for name, detail, kind in members.members_of(of):
        if wanted is None or kind in wanted or kind in {"field", "member", "state", "len"}:
            yield lsp.CompletionItem(name, kind=ICONS.get(kind, KIND.Field), detail=detail)


def _kinds_in_import(cursor: CursorContext) -> set[str] | None:
    """The kinds of names that fit behind `import.` at the cursor."""
    item = cursor.item[: len(cursor.item) - 2 * len(cursor.dotted)]
    if not item:
        return None
    return _wanted_kinds(CursorContext(cursor.body, cursor.head, item, (), "", cursor.start))


# ---------------------------------------------------------------- items


def _word_item(word: str, body: str) -> lsp.CompletionItem:
    parts = word.split()
    first = parts[-1] if parts[0] in {"on", "order"} else parts[0]
    builtin = word in language_words.BUILTINS
    return lsp.CompletionItem(
        word,
        kind=KIND.Function if builtin else KIND.Keyword,
        detail=language_words.word_meaning(first),
        sort_text=f"{'0' if body not in {'value', 'type'} else '3'}{word}",
    )


def _name_item(d: Definition, near: str) -> lsp.CompletionItem:
    detail = type_text(d) if not isinstance(d.node, tree.Decl) else _one_line(declaration_head(d))
    return lsp.CompletionItem(
        d.name, kind=ICONS.get(d.kind, KIND.Variable), detail=detail, sort_text=f"{near}{d.name}"
    )


def _one_line(text: str) -> str:
    first = " ".join(text.split())
    return first if len(first) <= 100 else first[:97] + "..."
