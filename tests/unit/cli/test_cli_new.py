"""`soter new`: a folder, whole or not at all."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from soter.cli import new
from soter.version import pip_command

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]
    Golden = Callable[[str, str], None]


def test_what_it_says(soter: Soter, golden: Golden, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new, "find_spec", lambda _: True)
    golden("cli/new.txt", soter("new", "rover").out)


def test_where_nothing_re_checks_it_says_first_what_to_install(
    soter: Soter, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(new, "find_spec", lambda _: None)
    steps = soter("new", "rover", "--json").document["commands"]
    assert steps[0] == pip_command("prove")
    assert steps[1].startswith("soter verify ")


@pytest.mark.long
def test_what_it_makes_is_laid_out_and_sound(soter: Soter, here: Path) -> None:
    document = soter("new", "my-rover", "--json").document
    assert document["files"] == [
        ".gitignore",
        "README.md",
        "my-rover.soter",
        "policy.c",
        "policy.py",
        "test_my_rover.py",
    ]
    assert soter("fmt", "--check", "my-rover/my-rover.soter").exit == 0
    checked = soter("check", "my-rover/my-rover.soter")
    assert checked.exit == 0
    assert checked.err == ""
    assert soter("verify", "my-rover/my-rover.soter").exit == 0
    assert soter("run", "my-rover/my-rover.soter").exit == 0
    tested = soter("test", "my-rover/my-rover.soter", "--json")
    assert (tested.exit, tested.document["tests"][0]["coverage"]["switches"]["unreached"]) == (
        0,
        [],
    )
    path = here / "my-rover" / "my-rover.soter"
    late = path.read_text().replace("Spare(motion, 0.25) < 0.1", "Spare(motion, 0.05) < -0.4")
    (here / "late.soter").write_text(late.replace("policy.py", "my-rover/policy.py"))
    assert soter("test", "late.soter", "--json").exit == 3, (
        "the test finds a guard that is too late"
    )
    assert soter("run", "my-rover/my-rover.soter", "--system", "Unguarded").exit == 3
    bound = soter(
        "run", "my-rover/my-rover.soter", "--bind", "Learned=c:my-rover/policy.c:policy_step"
    )
    assert bound.exit == 0


@pytest.mark.parametrize(
    "name", ["", "1st", "a b", "-x", "ä", "a/", "..", "a.b", "x" * 65, "\x1b[31m", "a\n"]
)
def test_names_that_cannot_be(soter: Soter, here: Path, name: str) -> None:
    before = sorted(here.iterdir())
    done = soter("new", "--", name)
    assert done.exit in (1, 2) or name == "a/"
    if name != "a/":
        assert sorted(here.iterdir()) == before
    assert "\x1b" not in done.err


def test_nothing_is_overwritten(soter: Soter, here: Path) -> None:
    (here / "rover").mkdir()
    (here / "link").symlink_to("nowhere")
    for name in ("rover", "link", "cart.soter"):
        assert soter("new", name).exit in (1, 2)
    assert soter("new", "rover", "--json").codes == ["D008"]
    assert list((here / "rover").iterdir()) == []


def test_a_folder_that_is_not_there(soter: Soter) -> None:
    assert soter("new", "nowhere/rover", "--json").codes == ["D001"]


def test_half_a_folder_isnever_left(
    soter: Soter, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.rename", full)
    before = sorted(here.iterdir())
    done = soter("new", "rover")
    assert done.exit == 1
    assert "no space left" in done.err
    assert sorted(here.iterdir()) == before
