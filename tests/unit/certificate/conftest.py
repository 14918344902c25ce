"""One small certificate for all tests of the re-checker, made without the prover."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from bench.recheck.corruptions import Sealed, read
from bench.recheck.models import Cart

from unit.certificate import small_proofs

if TYPE_CHECKING:
    from collections.abc import Callable

CART = Cart()


@pytest.fixture(scope="session")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a certificate that is right; not to be changed."""
    folder = tmp_path_factory.mktemp("proved")
    path = folder / "cart.soter"
    path.write_text(CART.text())
    facts = small_proofs.facts_of(path, "Track", "SafeCart")
    made = small_proofs.prove(facts, ((CART.cells_x, CART.cells_v),), 20)
    made["entry"]["system"] = "Track"
    program = {"cart.soter": CART.text()}
    small_proofs.write(folder / "cert", program, "cart.soter", [made["entry"]], made["sets"])
    return folder / "cert"


@pytest.fixture
def copied(proved: Path, tmp_path: Path) -> Path:
    """A copy to be changed."""
    return Path(shutil.copytree(proved, tmp_path / "cert"))


@pytest.fixture(scope="session")
def sealed(proved: Path) -> Sealed:
    """The same in memory."""
    return read(proved, CART)


@pytest.fixture
def changed(copied: Path) -> Callable[[Callable[[dict[str, object]], None]], Path]:
    """Change the manifest and seal it again."""

    def change(how: Callable[[dict[str, object]], None]) -> Path:
        manifest = json.loads((copied / "manifest.json").read_text())
        how(manifest)
        small_proofs.seal(copied, manifest)
        return copied

    return change


@pytest.fixture(autouse=True)
def _one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tests run beside each other already."""
    monkeypatch.setattr(os, "cpu_count", lambda: 1)
