"""The language server: shows in an editor what Soter knows of a program.

In reading order:
- `server.py` receives documents, `documents.py` checks them and publishes what was found.
- `requests.py` answers each request, or passes it to one of the files below.
- `name_resolution.py` asks the checker what each name means; `name_definitions.py` is the index
  that holds the answers.
- `language_words.py` explains the words of the language; `completion.py` offers them, `hover.py`
  describes a name, `symbols.py` lists declarations, `renaming.py` renames.
- `protocol_conversions.py` turns places and diagnostics into those of the protocol (LSP).
"""
