"""Markdown as HTML: headings with anchors, code in colour, links that are checked.

Purpose: `Renderer`: one page at a time; what its links point to is asked of the site.
Non-goals: the frame around a page, which pages there are (`build_site.py`).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

from markdown_it import MarkdownIt
from pygments import highlight
from pygments.formatters.html import HtmlFormatter
from pygments.lexer import RegexLexer, words
from pygments.lexers import get_lexer_by_name
from pygments.token import Comment, Keyword, Name, Number, Operator, String, Text
from pygments.util import ClassNotFound

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pygments.lexer import Lexer

    Resolve = Callable[[str], str]

DECLARED = (
    "soter", "import", "as", "type", "enum", "const", "param", "fun", "extern", "topic", "node",
    "plant", "system", "test", "rta", "input", "external",
)  # fmt: skip
SAID = (
    "period", "phase", "subscribes", "publishes", "publish", "step", "var", "let", "if", "elseif",
    "else", "for", "in", "return", "assert", "state", "der", "next", "while", "choose", "ac", "sc",
    "safe", "safer", "ttf", "verify", "module", "until", "always", "never", "reads", "drives",
    "disturbance", "measured", "within", "max_age", "unit", "default", "deploys", "grid", "late",
)  # fmt: skip
SAYING = ("inline", "fence", "code_block")
"""What of a page is text, of which the search knows."""
STACKED_FROM = 4
"""Columns of a table that a phone shows one below the other."""
LONG = 24
"""Cells of more letters keep a width that is read well, where the window is narrow."""


class SoterLexer(RegexLexer):  # type: ignore[misc]
    """Soter for colouring: what looks like a word of the language."""

    name = "Soter"
    aliases: ClassVar[list[str]] = ["soter"]
    tokens: ClassVar[dict[str, list[Any]]] = {
        "root": [
            (r"//.*?$", Comment.Single),
            (r"/\*(.|\n)*?\*/", Comment.Multiline),
            (r'"[^"\n]*"', String),
            (r"\d[\d_]*(\.\d+)?([eE][-+]?\d+)?(ns|us|ms|s|min|h)?\b", Number),
            (words(("bool", "int", "float", "duration"), suffix=r"\b"), Keyword.Type),
            (words(("true", "false"), suffix=r"\b"), Keyword.Constant),
            (words(DECLARED, suffix=r"\b"), Keyword.Declaration),
            (words(SAID, suffix=r"\b"), Keyword),
            (r"[A-Z][A-Z0-9_]+\b", Name.Constant),
            (r"[A-Za-z_]\w*", Name),
            (r"[-+*/%<>=!&|?:]+", Operator),
            (r"[^\S\n]+|\n|.", Text),
        ]
    }


@dataclass
class Rendered:
    """A page: its HTML, its first heading, its headings, and what stands below each of them."""

    html: str
    title: str
    headings: list[tuple[int, str, str]] = field(default_factory=list)
    """Level, anchor, text."""
    texts: list[str] = field(default_factory=list)
    """Of each heading, code included: what the search looks through."""

    @property
    def anchors(self) -> set[str]:
        """What a link may point to."""
        return {anchor for _, anchor, _ in self.headings}


def slug(text: str, taken: set[str]) -> str:
    """The anchor of a heading, as the forges make it."""
    plain = re.sub(r"[^\w\- ]", "", re.sub(r"[`*_]", "", text).strip().lower()).replace(" ", "-")
    anchor, count = plain, 0
    while anchor in taken:
        count += 1
        anchor = f"{plain}-{count}"
    taken.add(anchor)
    return anchor


def render(text: str, resolve: Resolve) -> Rendered:
    """A page; `resolve` gives the address for each link and picture as it is written."""
    parser = MarkdownIt("commonmark", {"highlight": _coloured}).enable("table")
    tokens = parser.parse(text)
    done = Rendered("", "")
    taken: set[str] = set()
    for i, token in enumerate(tokens):
        if token.type == "heading_open":
            inline = tokens[i + 1]
            plain = "".join(c.content for c in inline.children or ())
            anchor = slug(plain, taken)
            token.attrSet("id", anchor)
            done.headings.append((int(token.tag[1]), anchor, plain))
            done.texts.append("")
            done.title = done.title or plain
        elif done.texts and token.type in SAYING and tokens[i - 1].type != "heading_open":
            inside = token.children or ()
            said = "".join("\n" if c.type == "softbreak" else c.content for c in inside)
            said = said or token.content
            done.texts[-1] = f"{done.texts[-1]} {' '.join(said.split())}".strip()
        if token.type == "td_open" and len(tokens[i + 1].content) > LONG:
            token.attrSet("class", "long")
        _links(token.children or (), resolve)
    _stacks(tokens)
    done.html = parser.renderer.render(tokens, parser.options, {})
    return done


def _stacks(tokens: Sequence[Any]) -> None:
    """Tables with long cells in many columns say in each cell of which: a phone stacks them."""
    table: Any = None
    heads: list[str] = []
    cells: list[tuple[Any, int]] = []
    column = 0
    for i, token in enumerate(tokens):
        if token.type == "table_open":
            table, heads, cells = token, [], []
        elif token.type == "tr_open":
            column = 0
        elif token.type == "th_open":
            heads.append(tokens[i + 1].content)
        elif token.type == "td_open":
            cells.append((token, column))
            column += 1
        elif token.type == "table_close":
            long = any(cell.attrGet("class") == "long" for cell, _ in cells)
            if long and len(heads) >= STACKED_FROM:
                table.attrSet("class", "stacks")
                for cell, number in cells:
                    cell.attrSet("data-head", heads[number])


def _links(tokens: Sequence[Any], resolve: Resolve) -> None:
    for token in tokens:
        name = {"link_open": "href", "image": "src"}.get(token.type)
        if name is not None:
            token.attrSet(name, resolve(str(token.attrGet(name))))


def _coloured(code: str, language: str, _: str) -> str:
    """Code in colour; what no lexer knows stays as it is."""
    name = language.split(",", maxsplit=1)[0].split(" ", maxsplit=1)[0]
    return coloured(code, name) if name else ""


def coloured(code: str, name: str) -> str:
    """Code of a language as HTML, in a `pre`; commands (`sh`) wrap on a phone."""
    lexer: Lexer
    if name == "soter":
        lexer = SoterLexer()
    else:
        try:
            lexer = get_lexer_by_name(name)
        except ClassNotFound:
            return f"<pre><code>{escape(code)}</code></pre>"
    inside = highlight(code, lexer, HtmlFormatter(nowrap=True, classprefix="t-"))
    kind = ' class="sh"' if name == "sh" else ""
    return f"<pre{kind}><code>{inside}</code></pre>"
