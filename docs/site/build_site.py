"""Build the site: `make docs`.

    .venv/bin/python docs/site/build_site.py -o build/site [--no-playground] [--pyodide PATH]

Purpose: every page of `docs/`, the README, a page for each diagnostic code and for each file or
folder that a page links to, as HTML that opens from a disk; `front.md` is the landing page, and the
playground opens in it. The search has every word of the pages, in a script that is read at need.
Strict: a link that leads nowhere, a missing anchor or a page that is not in the menu ends it
with 1.
Non-goals: hosting. The generator is markdown-it-py under a template of our own: in 2026 MkDocs is
unmaintained, its theme in its last year, and what follows them still changes weekly.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import sys
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from site_menu import NAV, README, TARGETS
from site_text import Rendered, coloured, render

from soter.diagnostics.codes import explain

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
LANGUAGES = {
    ".soter": "soter", ".py": "python", ".c": "c", ".h": "c", ".json": "json", ".toml": "toml",
    ".md": "markdown", ".sh": "sh", ".cff": "yaml", ".ebnf": "ebnf",
}  # fmt: skip
PICTURES = {".svg", ".png"}
SHOWN_MAX_BYTES = 300_000
"""Larger files are told of, not shown."""
PLAYGROUND = "playground.html"
PLACE = "<!-- playground -->"
IN_PLACE = (
    '<details class="try"><summary>Open the playground here</summary><iframe title="playground" '
    f'data-src="{PLAYGROUND}"></iframe></details><p><a href="{PLAYGROUND}">On a page of its own</a>'
    " (9 MB, some seconds).</p>"
)
NOT_MADE = "<p>This copy of the site was made without it: it needs npm.</p>"


@dataclass
class Page:
    """A page of the site: where it came from, where it goes, what it says."""

    source: Path
    target: str
    menu: str
    done: Rendered | None = None
    wanted: list[tuple[str, str, str]] = field(default_factory=list)
    """Links with anchors: as written, target, anchor."""


class Site:
    """The site in the making. `problems`: what is wrong with it."""

    def __init__(self, root: Path, output: Path) -> None:
        self.root = root
        self.output = output
        self.problems: list[str] = []
        self.pages: dict[Path, Page] = {}
        self.files: dict[Path, str] = {}
        self.codes: list[Page] = []

    def build(self, *, playground: bool = False, pyodide: str | None = None) -> None:
        """Write everything into the folder."""
        self._collect()
        for page in self.pages.values():
            self._render(page)
        self.codes = self._read_codes()
        for page in (*self.pages.values(), *self.codes):
            self._check_anchors(page)
        if self.problems:
            return
        self.output.mkdir(parents=True, exist_ok=True)
        for name in ("site.css", "site.js"):
            shutil.copy(HERE / name, self.output / name)
        self._write(
            "search.js", f"const PAGES = {json.dumps(self._index(), ensure_ascii=False)};\n"
        )
        if playground:
            self._playground(pyodide)
        for page in self.pages.values():
            assert page.done is not None
            page.done.html = page.done.html.replace(PLACE, IN_PLACE if playground else NOT_MADE)
            self._write(page.target, self._framed(page.target, page.menu, page.done))
        self._write_files()
        self._codes()

    # ------------------------------------------------------------ which pages

    def _collect(self) -> None:
        listed = [(name, menu) for _, _, pages in NAV for name, menu in pages]
        for name, menu in listed:
            source = self._source(name)
            if not source.is_file():
                self.problems.append(f"site_menu.py: there is no {name}")
                continue
            self.pages[source] = Page(source, TARGETS.get(name, f"{source.stem}.html"), menu)
        for source in sorted((self.root / "docs").glob("*.md")):
            if source not in self.pages:
                self.problems.append(f"site_menu.py: {source.name} is not in the menu")

    def _source(self, name: str) -> Path:
        return self.root / name if name == README else self.root / "docs" / name

    def _index(self) -> list[tuple[str, str, str, str]]:
        """What the search knows: page, address, heading and text of every part of a page."""
        entries = []
        for page in (*self.pages.values(), *self.codes):
            assert page.done is not None
            for (_, anchor, heading), text in zip(page.done.headings, page.done.texts, strict=True):
                of_code = page.target == "codes.html"
                name, at = ("Diagnostic codes", page.menu) if of_code else (page.menu, anchor)
                entries.append((name, f"{page.target}#{at}", heading, text))
        return entries

    # ------------------------------------------------------------ links

    def _render(self, page: Page) -> None:
        text = page.source.read_text(encoding="utf-8")
        page.done = render(text, lambda link: self._resolved(page, link))

    def _resolved(self, page: Page, link: str) -> str:
        """Where a link goes on the site; what leads nowhere is a problem."""
        if re.match(r"[a-z]+:", link):
            return link
        path, _, anchor = link.partition("#")
        source = (page.source.parent / path).resolve() if path else page.source
        if source in self.pages:
            target = self.pages[source].target
            if anchor:
                page.wanted.append((link, str(source), anchor))
            return f"{target}#{anchor}" if anchor else target
        if not source.exists() or not source.is_relative_to(self.root):
            self.problems.append(f"{page.source.name}: `{link}` leads nowhere")
            return link
        name = source.relative_to(self.root).as_posix()
        target = f"files/{name}" if source.suffix in PICTURES else f"files/{name}.html"
        self.files[source] = target
        return target

    def _check_anchors(self, page: Page) -> None:
        for link, source, anchor in page.wanted:
            other = self.pages[Path(source)].done
            assert other is not None
            if anchor not in other.anchors:
                self.problems.append(f"{page.source.name}: `{link}`: there is no such heading")

    # ------------------------------------------------------------ writing

    def _write(self, name: str, text: str) -> None:
        path = self.output / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")

    def _framed(self, target: str, title: str, done: Rendered) -> str:
        up = "../" * target.count("/")
        inside = "".join(
            f'<li><a href="#{anchor}">{escape(text)}</a></li>'
            for level, anchor, text in done.headings
            if level == 2
        )
        contents = f"<nav class=contents><ul>{inside}</ul></nav>" if inside else ""
        template = (HERE / "page.html").read_text(encoding="utf-8")
        parts = {"up": up, "title": escape(title), "menu": self._menu(target, up)}
        for name, text in {**parts, "contents": contents, "body": done.html}.items():
            template = template.replace(f"[[{name}]]", text)
        return template

    def _menu(self, target: str, up: str) -> str:
        sections = []
        for kind, what_for, pages in NAV:
            items = []
            for name, menu in pages:
                address = self.pages[self._source(name)].target
                here = ' aria-current="page"' if address == target else ""
                items.append(f'<li><a href="{up}{address}"{here}>{escape(menu)}</a></li>')
            if kind == "Reference":
                here = ' aria-current="page"' if target == "codes.html" else ""
                items.append(f'<li><a href="{up}codes.html"{here}>Diagnostic codes</a></li>')
            sections.append(f"<h2>{kind} <small>{what_for}</small></h2><ul>{''.join(items)}</ul>")
        return "".join(sections)

    def _write_files(self) -> None:
        """What pages link to: pictures as they are, files in colour, folders as lists."""
        todo, seen = sorted(self.files), set[Path]()
        while todo:
            source = todo.pop()
            if source in seen:
                continue
            seen.add(source)
            name = source.relative_to(self.root).as_posix()
            if source.suffix in PICTURES:
                path = self.output / "files" / name
                path.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(source, path)
                continue
            if source.is_dir():
                inside = [p for p in sorted(source.iterdir()) if not p.name.startswith(("_", "."))]
                todo += inside
                links = "".join(
                    f'<li><a href="{escape(source.name)}/{escape(p.name)}'
                    f'{"" if p.suffix in PICTURES else ".html"}">{escape(p.name)}</a></li>'
                    for p in inside
                )
                body = f"<ul>{links}</ul>"
            else:
                body = _shown(source)
            html = f"<h1>{escape(name)}</h1>{body}"
            target = f"files/{name}.html"
            self._write(target, self._framed(target, name, Rendered(html, name)))

    def _read_codes(self) -> list[Page]:
        """The pages of the diagnostic codes, which stand on one page of the site."""
        folder = self.root / "src" / "soter" / "diagnostics" / "pages"
        pages = [Page(path, "codes.html", path.stem) for path in sorted(folder.glob("*.md"))]
        for page in pages:
            text = re.sub(r"^# ", "## ", explain(page.menu) or "")
            page.done = render(text, lambda link, page=page: self._resolved(page, link))  # type: ignore[misc]
        return pages

    def _codes(self) -> None:
        """A page with every diagnostic code."""
        parts = [
            f'<section id="{page.menu}">{page.done.html}</section>'
            for page in self.codes
            if page.done is not None
        ]
        head = "<h1>Diagnostic codes</h1><p>The same as <code>soter explain CODE</code>.</p>"
        html = head + "".join(parts)
        self._write("codes.html", self._framed("codes.html", "Codes", Rendered(html, "Codes")))

    def _playground(self, pyodide: str | None) -> None:
        from soter.playground.write import write_playground  # noqa: PLC0415 - only then

        examples = self.root / "examples" / "wall"
        back = '<p><a href="index.html" target="_top">all pages</a></p>'
        write_playground(self.output, pyodide, examples, back).rename(self.output / PLAYGROUND)


def _shown(path: Path) -> str:
    if path.stat().st_size > SHOWN_MAX_BYTES:
        return f"<p>{path.stat().st_size:,} bytes: in the repository.</p>"
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return f"<p>{path.stat().st_size:,} bytes that are no text.</p>"
    return coloured(text, LANGUAGES.get(path.suffix, "text"))


def main() -> int:
    """Build; 1 where something leads nowhere."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "build" / "site")
    parser.add_argument("--no-playground", action="store_true", help="where there is no npm")
    parser.add_argument("--pyodide", help="the npm package `pyodide`, or its folder")
    given = parser.parse_args()
    site = Site(ROOT, given.output)
    site.build(playground=not given.no_playground, pyodide=given.pyodide)
    for problem in site.problems:
        print(problem, file=sys.stderr)
    if site.problems:
        return 1
    count = len(site.pages) + len(site.files)
    print(
        f"site  {given.output / 'index.html'}  {count} pages and files, every link leads somewhere"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
