"""Command lines run inside the test's own process, in an empty folder."""

from __future__ import annotations

import copy
import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from json_documents import problems_of
from soter.cli.main import main
from soter.native.cache import digest

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.certificate.report import Report

    Soter = Callable[..., "Result"]

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"


@dataclass(frozen=True)
class Result:
    """What a command line left behind."""

    exit: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        """The one JSON document on standard output; it keeps to docs/json.md."""
        document: dict[str, Any] = json.loads(self.out)
        assert problems_of(document) == []
        assert document["exit"] == self.exit
        assert document["ok"] == (self.exit == 0)
        return document

    @property
    def codes(self) -> list[str]:
        """Codes of the document's diagnostics."""
        return [d["code"] for d in self.document["diagnostics"]]

    @property
    def errors(self) -> list[str]:
        """Those of errors: what the program has to be told of stands beside them."""
        told = self.document["diagnostics"]
        return [d["code"] for d in told if d["severity"] == "error"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder: empty but for the cart."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    shutil.copy(CART, tmp_path / "cart.soter")
    return tmp_path


@pytest.fixture
def soter(here: Path, capsys: pytest.CaptureFixture[str]) -> Soter:
    """`soter(*arguments)` runs a command line in the folder `here`."""

    def run(*arguments: str) -> Result:
        assert here.exists()
        capsys.readouterr()
        code = main(list(arguments))
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return Result(code, out, err)

    return run


@pytest.fixture(scope="module")
def reports() -> dict[str, Report]:
    """What the re-checker said of a certificate, by each of its bytes."""
    return {}


@pytest.fixture
def equal_certificates_are_checked_once(
    reports: dict[str, Report], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of tests of what is made of a report."""
    from soter.certificate import rechecker

    recheck = rechecker.recheck

    def once(folder: Path) -> Report:
        files = sorted(p for p in folder.rglob("*") if p.is_file())
        content = digest(f"{p.relative_to(folder)} {p.read_bytes().hex()}" for p in files)
        if content not in reports:
            reports[content] = recheck(folder)
        return copy.deepcopy(reports[content])

    monkeypatch.setattr(rechecker, "recheck", once)


ROBOT = """
soter 1;
topic pos: float max_age 500ms;
topic u: float in [-1.0, 1.0];
param LIMIT: float = 0.9 in [0.0, 10.0];
param EVERY: duration = 20ms in [10ms, 100ms];
param COUNT: int = 1;
param LOUD: bool = false;
plant Point period 10ms { reads u; drives pos = x; state x: float; der x = u; }
extern node Learned period EVERY { subscribes pos; publishes u; }
node Stay period 20ms {
  subscribes pos; publishes u;
  step { publish u = clamp(-(LOUD ? 2.0 : 1.0) * float(COUNT) * pos, -1.0, 1.0); }
}
rta Guard {
  ac Learned; sc Stay; period 100ms;
  safe abs(pos) < 1.0; ttf abs(pos) > LIMIT - 0.3; safer abs(pos) < LIMIT - 0.5;
}
system S { p: Point; module Guard; until 2s; always abs(p.truth.x) < 1.0; }
"""


@pytest.fixture
def robot(here: Path) -> Path:
    """A program whose AC is an extern that nothing is bound to, and a file of policies."""
    (here / "robot.soter").write_text(ROBOT)
    (here / "recovery.py").write_text(POLICIES)
    (here / "policy.c").write_text(POLICY_C)
    return here / "robot.soter"


POLICIES = """
import os
import sys
import time
import math


def good(inputs):
    return 0.8


def raises(inputs):
    raise ValueError("boom")


def nan(inputs):
    return math.nan


def beyond(inputs):
    return 1.5


def shape(inputs):
    return [1.0, 2.0]


def leaves(inputs):
    sys.exit(3)


def interrupts(inputs):
    raise KeyboardInterrupt


def prints(inputs):
    print("chatter")
    return 0.0


class Counting:
    def reset(self, seed):
        self.count = seed

    def step(self, inputs):
        self.count += 1
        return {"u": 0.5}


class Unmade:
    def __init__(self):
        raise RuntimeError("no model file")


class Stubborn:
    def reset(self, seed):
        raise RuntimeError("will not")

    def step(self, inputs):
        return 0.0


number = 3
"""

POLICY_C = """
#include "robot.h"
int policy_step(const robot_Guard_Learned_in *in, robot_Guard_Learned_out *out);
int policy_step(const robot_Guard_Learned_in *in, robot_Guard_Learned_out *out) {
  (void)in;
  out->u = 0.8;
  out->has_u = 1;
  return 0;
}
"""
