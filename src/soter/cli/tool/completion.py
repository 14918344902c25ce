"""`soter completion SHELL`: prints a script by which bash, zsh or fish complete command lines.

Purpose: reads commands, options, the words that an option takes, and places of files off parsers.
Non-goals: names inside of a program (systems, tests): a shell would check it at every key.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from soter.cli.terminal.command_outcome import CommandOutcome
from soter.diagnostics.command_records import choice, option

if TYPE_CHECKING:
    import argparse
    from collections.abc import Iterator

    from soter.cli.terminal.console import Console

EXAMPLES = """\
  eval "$(soter completion bash)"          in ~/.bashrc
  soter completion zsh > "${fpath[1]}/_soter"
  soter completion fish > ~/.config/fish/completions/soter.fish
"""
FILES = re.compile(r"FILE|DIR|PATH|LOG|TRACE")
"""Matches the metavar of an option or argument that takes a path."""


@dataclass(frozen=True)
class Option:
    """An option. `names`: its flags; `values`: the words that it allows, () for any word."""

    names: tuple[str, ...]
    about: str
    takes: bool
    values: tuple[str, ...]
    path: bool


@dataclass(frozen=True)
class CommandWords:
    """The options of a command, the words its first argument may be, and whether it takes paths."""

    name: str
    about: str
    options: tuple[Option, ...]
    first: tuple[str, ...]
    path: bool


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print what a shell needs to complete command lines."""

    shell: str = option("SHELL", ..., "bash, zsh or fish", choice("bash", "zsh", "fish"))


def run(args: argparse.Namespace, console: Console) -> CommandOutcome:
    """Prints the script for the shell."""
    from soter.cli.main import COMMANDS, command_parser  # noqa: PLC0415 - it imports this file by name

    words = [
        words_of_command(name, about, command_parser(name) if name != "help" else None, COMMANDS)
        for name, about in COMMANDS.items()
    ]
    text = "\n".join(SHELLS[args.shell](words))
    console.say(text)
    return CommandOutcome(fields={"shell": args.shell, "script": text})


def words_of_command(
    name: str, about: str, made: argparse.ArgumentParser | None, commands: dict[str, str]
) -> CommandWords:
    """The words of a command, read from its parser; `help`, without a parser, takes `commands`."""
    if made is None:
        return CommandWords(name, about, (), tuple(commands), path=False)
    options: list[Option] = []
    first: list[str] = []
    path = False
    for action in made._actions:  # noqa: SLF001 - argparse has no other way to ask
        values = tuple(str(c) for c in action.choices or ())
        is_path = bool(FILES.fullmatch(str(action.metavar or "")))
        if action.option_strings:
            text = (action.help or "").replace("%%", "%")
            takes = action.nargs != 0
            options.append(Option(tuple(action.option_strings), text, takes, values, is_path))
        else:
            first += values
            path = path or is_path
    return CommandWords(name, about, tuple(options), tuple(first), path)


# ---------------------------------------------------------------- bash


BASH_HEAD = """\
# bash completion of soter; made by `soter completion bash`
_soter() {
  local cur=${COMP_WORDS[COMP_CWORD]} prev="" command="" word words="" files=""
  (( COMP_CWORD > 0 )) && prev=${COMP_WORDS[COMP_CWORD-1]}
  for word in "${COMP_WORDS[@]:1:COMP_CWORD-1}"; do
    [[ $word != -* ]] && { command=$word; break; }
  done
  COMPREPLY=()
  case "$command:$prev" in"""
BASH_TAIL = """\
  esac
  COMPREPLY=($(compgen -W "$words" -- "$cur"))
  [[ -n $files ]] && COMPREPLY+=($(compgen -f -- "$cur"))
}
complete -o filenames -F _soter soter"""


def bash_script(commands: list[CommandWords]) -> Iterator[str]:
    """The lines of a completion script for bash 4 and later."""
    yield BASH_HEAD
    for c in commands:
        for o in c.options:
            if o.takes:
                at = "|".join(f"{c.name}:{n}" for n in o.names)
                yield f"    {at}) {_bash_reply_command(o.values, path=o.path)}; return ;;"
    names = " ".join(c.name for c in commands)
    yield '  esac\n  case "$command" in'
    yield f'    "") words="{names} --help --version -V --json" ;;'
    for c in commands:
        options = " ".join(n for o in c.options for n in o.names)
        first = " ".join(c.first)
        files = "; files=1" if c.path else ""
        yield f'    {c.name}) if [[ $cur == -* ]]; then words="{options}";'
        yield f'      else words="{first}"{files}; fi ;;'
    yield BASH_TAIL


def _bash_reply_command(values: tuple[str, ...], *, path: bool) -> str:
    if values:
        return f'COMPREPLY=($(compgen -W "{" ".join(values)}" -- "$cur"))'
    return 'COMPREPLY=($(compgen -f -- "$cur"))' if path else ":"


# ---------------------------------------------------------------- zsh


ZSH_HEAD = """\
#compdef soter
# zsh completion of soter; made by `soter completion zsh`
_soter() {
  local -a commands
  commands=("""
ZSH_OPTIONS = """\
  )
  if (( CURRENT == 2 )); then _describe command commands; return; fi
  local command=$words[2]
  shift words; (( CURRENT-- ))
  case "$command" in"""
ZSH_TAIL = """\
  esac
}
if [ "$funcstack[1]" = "_soter" ]; then _soter "$@"; else compdef _soter soter; fi"""


def zsh_script(commands: list[CommandWords]) -> Iterator[str]:
    """The lines of a completion function for zsh, to be put into a folder of `fpath`."""
    yield ZSH_HEAD
    for c in commands:
        yield f"    {_zsh_quoted(f'{c.name}:{_zsh_text(c.about)}')}"
    yield ZSH_OPTIONS
    for c in commands:
        rows = [r for o in c.options for r in _zsh_option_lines(o)]
        if c.first:
            rows.append(_zsh_quoted(f"*:word:({' '.join(c.first)})"))
        elif c.path:
            rows.append(_zsh_quoted("*:file:_files"))
        if rows:
            yield f"    {c.name}) _arguments \\"
            yield from (f"      {row} \\" for row in rows[:-1])
            yield f"      {rows[-1]} ;;"
    yield ZSH_TAIL


def _zsh_option_lines(option: Option) -> Iterator[str]:
    about = _zsh_text(option.about)
    for name in option.names:
        takes = ""
        if option.takes:
            how = f"({' '.join(option.values)})" if option.values else "_files" * option.path
            takes = f":value:{how or ' '}"
        yield _zsh_quoted(f"{name}[{about}]{takes}")


def _zsh_text(text: str) -> str:
    """A description in which characters that have a meaning in zsh are blanks."""
    return re.sub(r"[\[\]:\\]", " ", text)


def _zsh_quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


# ---------------------------------------------------------------- fish


FISH_HEAD = """\
# fish completion of soter; made by `soter completion fish`
complete -c soter -f
complete -c soter -n __fish_use_subcommand -s V -l version -d 'the version'"""


def fish_script(commands: list[CommandWords]) -> Iterator[str]:
    """The lines of a completion script for fish."""
    yield FISH_HEAD
    for c in commands:
        yield f"complete -c soter -n __fish_use_subcommand -a {c.name} -d {_fish_quoted(c.about)}"
    for c in commands:
        seen = f"complete -c soter -n '__fish_seen_subcommand_from {c.name}'"
        if c.first:
            yield f"{seen} -a {_fish_quoted(' '.join(c.first))}"
        if c.path:
            yield f"{seen} -F"
        for o in c.options:
            names = " ".join(
                f"-l {n[2:]}" if n.startswith("--") else f"-s {n[1:]}" for n in o.names
            )
            takes = ""
            if o.takes:
                takes = f" -r -a {_fish_quoted(' '.join(o.values))}" if o.values else " -r"
                takes += " -F" if o.path else ""
            yield f"{seen} {names}{takes} -d {_fish_quoted(o.about)}"


def _fish_quoted(text: str) -> str:
    return "'" + text.replace("\\", "\\\\").replace("'", "\\'") + "'"


SHELLS = {"bash": bash_script, "zsh": zsh_script, "fish": fish_script}
