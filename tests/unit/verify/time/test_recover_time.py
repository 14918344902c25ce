"""T of P2b, from SC's first acting output until the verdict that gives control back is in force."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np
import pytest
from bench.recheck.models import Cart

import soter
from soter.api import recheck
from soter.language.front_end import check_file, system_of
from soter.verify.problem.extract import extract
from soter.verify.verify_module import verify_module

if TYPE_CHECKING:
    from pathlib import Path

    from soter.certificate.report import Report
    from soter.verify.claims.results import ModuleResult

ms = 1_000_000


def text_with(times: str) -> str:
    return re.sub(r"(late sc 2ms, dm 1ms;)", rf"\1 {times}", Cart().text())


def result_of(times: str) -> ModuleResult:
    checked = check_file("cart.soter", text_with(times))
    assert checked.ok, [d.message for d in checked.diagnostics.items]
    flat = system_of(checked, None)
    return verify_module(extract(flat, flat.modules[0]), refute=False)


def test_t_holds_the_response_of_the_dm() -> None:
    at_once, later = result_of(""), result_of("response dm 1ms;")
    assert at_once.recover_s is not None
    assert later.recover_s == pytest.approx(at_once.recover_s + 0.001, abs=1e-9)


def test_a_declared_t_without_the_response_of_the_dm_is_too_short() -> None:
    needed = result_of("").recover_s
    assert needed is not None
    enough = round(needed * 1000)
    module_result = result_of(f"response dm 1ms; recover within {enough + 1}ms;")
    assert module_result.findings["P2b"].verdict == "proved"
    module_result = result_of(f"response dm 1ms; recover within {enough}ms;")
    assert module_result.findings["P2b"].verdict == "undecided"


def rechecked(folder: Path, recover_ns: int) -> Report:
    """What the re-checker says of the cart with this T."""
    folder.mkdir()
    path = folder / "cart.soter"
    path.write_text(text_with(f"response dm 1ms; recover within {recover_ns // ms}ms;"))
    report = soter.load(path).verify(cert=folder / "cert", refute=False)
    assert report.modules[0].findings["P2b"].verdict == "proved"
    return recheck(folder / "cert")


@pytest.mark.long
def test_the_rechecker_holds_t_to_the_same_terms(tmp_path: Path) -> None:
    module_result = result_of("response dm 1ms;")
    (group,) = module_result.cases[0].groups
    assert group.rank is not None
    assert group.rank_holds is not None
    ranks = range(1, int(group.rank.max()) + 1)
    holds = sum(int(np.max(group.rank_holds, where=group.rank == r, initial=0)) for r in ranks)
    times = module_result.problem.times
    bound = holds * times.delta_sc + times.jitter_sc
    bound += times.delta_dm + times.age_dm + times.late_dm + times.response_dm
    assert rechecked(tmp_path / "enough", bound).accepted
    short = rechecked(tmp_path / "short", bound - 1 * ms)
    assert not short.accepted
    assert "longer to return" in short.reason
