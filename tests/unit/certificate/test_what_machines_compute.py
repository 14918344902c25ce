"""Ints, bools and doubles of SC as a machine has them: edits that once were accepted.

A re-sealed certificate of a right module whose SC was edited: what the edited program computes is
not what real numbers would say.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from bench.recheck.overstated import Base, sealed
from bench.recheck.small_modules import PROGRAMS, Edit

import soter
from soter.api import recheck

TEXT = PROGRAMS["written"]
STEP = "step { publish u = clamp(-GAIN * x, -1.0, 1.0); }"
NINE = "\n".join(f"  var f{i}: bool = true;" for i in range(9))
BIG = "(x + 2.0) * 1.0e200 * 1.0e200 * 1.0e-200 * 1.0e-200"
TEN = "var k: int = 9; if x > 0.0 { k = -9; } var m: int = 10; if x > 1.05 { m = 11; }"

WRONG = {
    "ints that were joined are divided as ints": f"step {{ {TEN} "
    "publish u = clamp(float(k / m) * min(2.2 * abs(x), 1.1), -1.0, 1.0); }",
    "ints that were negated are divided as ints": "step { "
    "let k = int(floor(x > 0.0 ? 9.5 : -9.5)); "
    "let m = int(floor(min(abs(x), 0.5) + 10.0)); "
    "publish u = clamp(float(-k / -(-m)) * min(2.2 * abs(x), 1.1), -1.0, 1.0); }",
    "a sum of ints overflows": "step { var z: int = 4000000000000000000; "
    "if x > 0.0 { z = -4000000000000000000; } "
    "publish u = clamp(-GAIN * x + float(z + z + z) * 0.0, -1.0, 1.0); }",
    "a truth that may be false": NINE + " step { var v = -GAIN * x; "
    "if x > 1.02 || f8 { v = -GAIN * x; } else { v = GAIN * x; } "
    "publish u = clamp(v, -1.0, 1.0); }",
    "an assertion that may fail": NINE + " step { assert f8; "
    "publish u = clamp(-GAIN * x, -1.0, 1.0); }",
    "an overflow to infinity": f"step {{ let z = {BIG}; "
    "publish u = clamp(-GAIN * (z - 2.0), -1.0, 1.0); }",
    "nothing times infinity": "step { let z = (x + 2.0) * 1.0e200 * 1.0e200 * 0.0; "
    "publish u = clamp(-GAIN * x + z, -1.0, 1.0); }",
    "nothing times a prelude function that overflows": "step { let z = exp(1000.0 * abs(x)); "
    "publish u = clamp(-GAIN * x + 0.0 * z, -1.0, 1.0); }",
    "no number in a table": "step { let big = 1.0e200 * 1.0e200; let n = big - big; "
    "let t = [1.0, n, 2.0]; let i = int(floor(abs(x))) + 1; "
    "publish u = t[i] > 0.0 ? clamp(-GAIN * x, -1.0, 1.0) : 0.0; }",
}
RIGHT = {
    "nine truths": NINE + " step { var v = -GAIN * x; if f8 { v = -GAIN * x; } "
    "publish u = clamp(v, -1.0, 1.0); }",
    "a row of a table": "step { let t = [[-1.0, 0.9], [-0.5, 0.4]]; "
    "let i = int(floor(min(abs(x), 1.9))); let r = x > 0.0 ? t[i] : t[0]; "
    "publish u = clamp(-GAIN * x + 0.0 * r[0], -1.0, 1.0); }",
}


@lru_cache
def base() -> Base:
    with TemporaryDirectory() as at:
        path = Path(at) / "small.soter"
        path.write_text(TEXT)
        soter.load(path).verify(cert=Path(at) / "cert", refute=False)
        manifest = json.loads((Path(at) / "cert" / "manifest.json").read_text())
        contents = {n: (Path(at) / "cert" / n).read_bytes() for n in manifest["files"]}
    return Base("written", TEXT, manifest, contents, (), (), {})


def edited(step: str) -> str:
    assert STEP in TEXT
    return TEXT.replace(STEP, step)


@pytest.mark.parametrize("step", WRONG.values(), ids=list(WRONG))
def test_what_a_machine_computes_otherwise_is_not_accepted(step: str, tmp_path: Path) -> None:
    sealed(tmp_path / "cert", base(), Edit("program", "", None, None, edited(step), None))
    assert not recheck(tmp_path / "cert").accepted


@pytest.mark.parametrize("step", RIGHT.values(), ids=list(RIGHT))
def test_what_is_proved_with_truths_and_tables_is_accepted(step: str, tmp_path: Path) -> None:
    path = tmp_path / "right.soter"
    path.write_text(edited(step))
    verify_report = soter.load(path).verify(cert=tmp_path / "cert", refute=False)
    assert verify_report.verdict in ("proved", "assumed")
    report = recheck(tmp_path / "cert")
    assert report.accepted, report.reason
