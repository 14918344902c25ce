"""The editors that we say how to set up: the settings themselves, in the editor where it is had."""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path

import pytest

import processes
from soter.editor.requests import TERMINAL

ROOT = Path(__file__).resolve().parents[3]
EDITORS = ROOT / "editors"
SOTER = Path(sys.executable).with_name("soter")
TRIAL_LUA = """
vim.g.soter_command = {soter}
vim.cmd("luafile " .. {settings})
vim.cmd("edit cart.soter")
vim.api.nvim_buf_set_lines(0, 4, 4, false, {{ "const B: float = WALLS;" }})
vim.wait(600000, function() return #vim.diagnostic.get(0) > 0 end, 50)
for _, d in ipairs(vim.diagnostic.get(0)) do
  io.stdout:write("told " .. d.lnum .. " " .. d.col .. " " .. d.message:gsub("\\n", " ") .. "\\n")
end
vim.api.nvim_win_set_cursor(0, {{ 32, 20 }})
local asked = vim.lsp.util.make_position_params()
for _, r in pairs(vim.lsp.buf_request_sync(0, "textDocument/hover", asked, 30000)) do
  io.stdout:write("hover " .. r.result.contents.value:gsub("\\n", " ") .. "\\n")
end
vim.cmd("qa!")
"""
TRIAL_EL = """
(require 'package) (package-initialize)
(dolist (d (file-expand-wildcards "/usr/share/emacs/site-lisp/elpa/eglot-*"))
  (add-to-list 'load-path d))
(setq soter-command {soter} eglot-sync-connect 60)
(load {settings})
(remove-hook 'soter-mode-hook #'eglot-ensure)
(find-file "cart.soter")
(apply #'eglot (eglot--guess-contact))
(goto-char (point-min)) (search-forward "soter 1;\\n") (insert "const B: float = WALLS;\\n")
(eglot--signal-textDocument/didChange)
(flymake-start)
(let ((n 0)) (while (and (< n 300) (null (flymake-diagnostics)))
  (accept-process-output nil 0.1) (setq n (1+ n))))
(dolist (d (flymake-diagnostics)) (message "told %s" (flymake-diagnostic-text d)))
(set-buffer-modified-p nil)
(kill-emacs)
"""


def output(command: list[str], folder: Path) -> str:
    done = processes.run(command, cwd=folder, capture_output=True, text=True)
    return str(done.stdout) + str(done.stderr)


@pytest.mark.skipif(shutil.which("nvim") is None, reason="there is no Neovim")
def test_neovim_tells_what_is_wrong(wall: Path) -> None:
    trial = wall / "trial.lua"
    places = {
        "soter": json.dumps(str(SOTER)),
        "settings": json.dumps(str(EDITORS / "neovim/soter.lua")),
    }
    trial.write_text(TRIAL_LUA.format(**places), encoding="utf-8")
    said = output(["nvim", "--headless", "-u", "NONE", "-c", f"luafile {trial}"], wall)
    assert "told 4 17 unknown name `WALLS`: not declared help: did you mean `WALL`?" in said
    assert "fun clamp(x: float, lo: float, hi: float): float" in said


@pytest.mark.skipif(shutil.which("emacs") is None, reason="there is no Emacs")
def test_emacs_tells_what_is_wrong(wall: Path) -> None:
    eglot_folders = list(Path("/usr/share/emacs/site-lisp/elpa").glob("eglot-*"))
    if not eglot_folders and "t" not in output(
        ["emacs", "-Q", "--batch", "--eval", "(princ (fboundp 'eglot))"], wall
    ):
        pytest.skip("there is no Eglot")
    trial = wall / "trial.el"
    places = {
        "soter": json.dumps(str(SOTER)),
        "settings": json.dumps(str(EDITORS / "emacs/soter-mode.el")),
    }
    trial.write_text(TRIAL_EL.format(**places), encoding="utf-8")
    said = output(["emacs", "-Q", "--batch", "-l", str(trial)], wall)
    assert "told soter [N001]: unknown name `WALLS`: not declared" in said


def test_every_editor_knows_the_command_of_a_lens() -> None:
    for path in ("vscode/src/extension.js", "neovim/soter.lua"):
        assert f'"{TERMINAL}"' in (EDITORS / path).read_text(encoding="utf-8"), path


def test_the_extension_s_parts_are_there() -> None:
    folder = EDITORS / "vscode"
    manifest = json.loads((folder / "package.json").read_text(encoding="utf-8"))
    contributes = manifest["contributes"]
    assert (folder / contributes["languages"][0]["configuration"]).is_file()
    json.loads((folder / "language-configuration.json").read_text(encoding="utf-8"))
    built = (folder / "build.mjs").read_text(encoding="utf-8")
    for made in (manifest["main"], contributes["grammars"][0]["path"]):
        assert made.removeprefix("./") in built
    grammar = json.loads((EDITORS / "soter.tmLanguage.json").read_text(encoding="utf-8"))
    assert contributes["grammars"][0]["scopeName"] == grammar["scopeName"]
    code = (folder / "src" / "extension.js").read_text(encoding="utf-8")
    for command in contributes["commands"]:
        assert f'"{command["command"]}"' in code
    lock = (folder / "package-lock.json").read_text(encoding="utf-8")
    assert not re.search(r'"resolved"', lock), "the lock file names a registry's host"


@pytest.mark.skipif(
    not (EDITORS / "vscode" / "node_modules").is_dir(), reason="`make vscode` has not been run"
)
def test_the_extension_is_built(tmp_path: Path) -> None:
    shutil.copytree(EDITORS / "vscode", tmp_path / "vscode", ignore=shutil.ignore_patterns("dist"))
    shutil.copy(EDITORS / "soter.tmLanguage.json", tmp_path)
    processes.run(["npm", "run", "--silent", "build"], cwd=tmp_path / "vscode", check=True)
    assert (tmp_path / "vscode" / "dist" / "extension.js").stat().st_size > 100_000
