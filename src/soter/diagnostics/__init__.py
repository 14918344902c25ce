"""Spans, diagnostics, their rendering, and one page per code.

In reading order:

- `diagnostic.py` has `Source`, `Span`, `Diagnostic` and `SoterError`, with which all rooms report.
- `codes.py` lists the codes; `explain` finds the page of one in `pages/`.
- `pages/` has a page for each code, for P1a to P3, and, in `pages/words/`, for some words.
- `render.py` shows diagnostics on a terminal, as data for `--json`, and in tracebacks.
- `fixes.py` builds a `Fix` from spans; `system_texts.py` has texts of the operating system in
  words, and `legible_text.py` makes text harmless for a terminal.
- `similar_names.py` finds the name that somebody probably meant ("did you mean").

Two files serve commands. They stand here, below all rooms that use them:
- `command_records.py` describes an option once, for Python and the command line, and reports wrong
  values; a `JsonObject` makes JSON documents, and their schemas, from one list of fields.
- `current_phase.py` tells whoever waits which phase a long computation is in, and how far it is.
"""
