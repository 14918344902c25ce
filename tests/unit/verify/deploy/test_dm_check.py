"""The check that comes with a generated DM: it passes on what is emitted, and on nothing else."""

from dataclasses import replace
from pathlib import Path

import pytest

from soter.language.front_end import check_file, system_of
from soter.language.model.system import System
from soter.verify.command import verify
from soter.verify.deploy.dm_check import DMCheck, check_decisions, check_module, expected_mode
from soter.verify.deploy.dm_test_cases import AC, SC
from soter.verify.deploy.level_tables import GroupTable, pairs_of, tables_of_groups
from soter.verify.deploy.missing_predicates import complete, install_predicates

EXAMPLES = Path(__file__).parents[4] / "examples"
MUTANTS = {
    "a gate fault is forgotten": ("ttf || stale || gate_fault ?", "ttf || stale ?"),
    "ttf is forgotten": ("ttf || stale || gate_fault ?", "stale || gate_fault ?"),
    "a stale read is good enough to return": ("safer && !stale && clean", "safer && clean"),
    "no clean outputs are asked for": ("safer && !stale && clean", "safer && !stale"),
    "ttf returns control": ("safer && !stale && clean", "!ttf && !stale && clean"),
    "modes are swapped": ("mode == SOTER_AC", "mode == SOTER_SC"),
    "at max_age is stale": ("> 20000000", ">= 20000000"),
    "ages are not looked at": ("> 20000000", "> INT64_C(20000000000000000)"),
    "facts are swapped": ("m->mode, stale, ttf, safer", "m->mode, stale, safer, ttf"),
    "the gate's latch is negated": ("m->gate_fault != 0U", "m->gate_fault == 0U"),
    "clean is negated": ("m->clean_needed == 0U", "m->clean_needed != 0U"),
    "what was seen is not noted": ("m->ttf = ttf ? 1U : 0U", "m->ttf = 0U"),
    "a predicate is negated": ("ttf = cart_SafeCart_ttf(state)", "ttf = !cart_SafeCart_ttf(state)"),
}


def system(path: Path, name: str = "Protected") -> System:
    return system_of(check_file(str(path)), name)


@pytest.fixture(scope="module")
def cart() -> System:
    return system(EXAMPLES / "wall" / "cart.soter")


def test_what_is_emitted_for_the_cart_is_the_switching_logic(cart: System) -> None:
    (check,) = check_decisions(cart)
    assert check.verdict == "proved", check.failures
    assert check.facts == 64
    assert check.states > 2000


def test_only_facts_and_cells_are_said_to_be_all_there_are() -> None:
    text = DMCheck("M", facts=64, states=4360, cells=8000).summary
    every, tried = text.split("; ")
    assert every.endswith("all 64 combinations of facts and all 8,000 cells")
    assert tried == "4,360 inputs tried"
    assert DMCheck("M", facts=64, states=7).summary.endswith(
        "combinations of facts; 7 inputs tried"
    )


def test_computed_predicates_are_checked_alike(open_cart: Path) -> None:
    flat = system(open_cart)
    complete(flat)
    (check,) = check_decisions(flat)
    assert check.verdict == "proved", check.failures


def test_a_module_whose_predicates_are_missing_never_trusts_ac(open_cart: Path) -> None:
    (check,) = check_decisions(system(open_cart))
    assert check.verdict == "proved", check.failures


@pytest.mark.parametrize("name", MUTANTS)
def test_a_changed_dm_is_refuted(cart: System, name: str) -> None:
    old, new = MUTANTS[name]

    def change(source: str) -> str:
        assert old in source
        return source.replace(old, new)

    (check,) = check_decisions(cart, change=change)
    assert check.verdict == "refuted"
    assert check.failures


def test_the_logic_is_that_of_the_paper() -> None:
    fine = {"stale": False, "gate_fault": False, "clean": True}
    assert expected_mode(AC, ttf=False, safer=False, **fine) == AC
    assert expected_mode(AC, ttf=True, safer=True, **fine) == SC
    assert expected_mode(SC, ttf=False, safer=False, **fine) == SC
    assert expected_mode(SC, ttf=False, safer=True, **fine) == AC


@pytest.mark.long
def test_one_wrong_entry_of_a_table_is_found(open_cart: Path) -> None:
    (module,) = verify(check_file(str(open_cart)), refute=False).modules
    assert check_module(module).cells == 200 * 160
    problem = module.problem
    decision_tables = tables_of_groups(problem, [pairs_of(module.cases[0])])
    flat = replace(problem.system, modules=(replace(problem.module),))
    install_predicates(flat, flat.modules[0], problem, decision_tables)
    table = decision_tables[0]
    assert isinstance(table, GroupTable)
    table.entries[137, 59] ^= 1
    (check,) = check_decisions(flat, None, decision_tables, problem.topic_leaf_of_state)
    assert check.verdict == "refuted"
    assert len(check.failures) == 1
