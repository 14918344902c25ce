"""`soter show`: where the picture goes, and what it says otherwise."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    Soter = Callable[..., Any]


def test_a_picture_is_written_where_it_was_asked_for(soter: Soter, here: Path) -> None:
    done = soter("show", "cart.soter", "-o", "deep/cart.svg")
    assert (done.exit, done.out) == (0, "diagram  deep/cart.svg\n")
    text = (here / "deep" / "cart.svg").read_text()
    assert text.startswith("<svg")
    assert ">Careful</text>" in text
    again = soter("show", "cart.soter", "-o", "deep/cart.svg", "--set", "A=2", "--json")
    assert again.exit == 2  # A is a constant
    assert again.codes == ["U004"]


def test_by_default_it_is_named_after_program_and_system(soter: Soter, here: Path) -> None:
    assert soter("show", "cart.soter", "--system", "Unprotected").exit == 0
    text = (here / ".soter" / "cart-Unprotected.svg").read_text()
    assert "SafeCart (always AC)" in text


def test_on_standard_output_it_is_the_svg_and_nothing_else(soter: Soter) -> None:
    plain = soter("show", "cart.soter", "-o", "-")
    assert plain.out.startswith("<svg")
    assert plain.out.endswith("</svg>\n")
    document = soter("show", "cart.soter", "-o", "-", "--json").document
    assert document["svg"] == plain.out
    assert document["diagram"] is None


def test_core_is_printed_in_place_of_a_picture(soter: Soter, here: Path) -> None:
    plain = soter("show", "cart.soter", "--core", "--system", "Unprotected")
    assert plain.exit == 0
    assert plain.out.startswith("system Unprotected\n")
    assert "  publish 0 = clamp\n" in plain.out
    document = soter("show", "cart.soter", "--core", "--system", "Unprotected", "--json").document
    assert (document["core"], document["svg"], document["diagram"]) == (plain.out, None, None)
    assert not (here / ".soter").exists()


def test_what_is_no_picture_is_not_lost(soter: Soter, here: Path) -> None:
    (here / "notes.txt").write_text("mine")
    assert soter("show", "cart.soter", "-o", "notes.txt", "--json").codes == ["D006"]
    assert (here / "notes.txt").read_text() == "mine"


def test_a_program_with_errors_has_no_picture(soter: Soter, here: Path) -> None:
    (here / "wrong.soter").write_text("soter 1;\nnode A period 0ms { step { } }\n")
    done = soter("show", "wrong.soter", "--json")
    assert done.exit == 1
    assert done.codes == ["C001"]
    assert not (here / ".soter").exists()


def test_replaying_a_log_is_refused_with_what_to_do(soter: Soter, here: Path) -> None:
    for line in (("--log", "cart.mcap"), ("--log=cart.mcap", "-o", "cart.svg")):
        done = soter("show", "cart.soter", *line, "--json")
        assert (done.exit, done.codes) == (2, ["U001"])
    said = soter("show", "cart.soter", "--log", "cart.mcap").err
    assert "`--log` is gone" in said
    assert "`soter run --report`" in said
    assert not (here / "cart.svg").exists()
