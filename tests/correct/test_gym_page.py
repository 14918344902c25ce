"""The page docs/gym.md says the truth: its blocks run, one after the other."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from soter.gym.vector import FACTS

ROOT = Path(__file__).resolve().parents[2]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.pages
def test_the_gym_page_runs_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path in (ROOT / "examples" / "mountain_car").iterdir():
        if path.is_file():
            shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    blocks = BLOCK.findall((ROOT / "docs" / "gym.md").read_text(encoding="utf-8"))
    assert len(blocks) == 8
    names: dict[str, object] = {}
    for number, text in enumerate(blocks):
        exec(compile(text, f"docs/gym.md, block {number + 1}", "exec"), names)  # noqa: S102


def test_training_in_torch_falls_alone_and_never_behind_the_module(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("torch", reason="the extra is absent: pip install 'soter-rta[learn]'")
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "mountain_car"))
    import train_torch  # type: ignore[import-not-found]

    alone, behind = (
        train_torch.train(system, worlds=32, steps=700, seed=1)
        for system in ("LearnedAdvanced", "LearnedProtected")
    )
    assert alone.steps == behind.steps == 22_400
    assert alone.falls > 0 == behind.falls
    assert behind.goals > 0


def test_every_key_of_info_is_on_the_page() -> None:
    page = (ROOT / "docs" / "gym.md").read_text(encoding="utf-8")
    gym = ROOT / "src" / "soter" / "gym"
    source = "".join((gym / n).read_text(encoding="utf-8") for n in ("guard.py", "step_info.py"))
    keys = set(re.findall(r'^ {8,12}"(\w+)": ', source, re.MULTILINE))
    keys |= set(re.findall(r'\binfo\["(\w+)"\] = ', source))
    keys |= {*FACTS, "final_obs", "final_info"}
    assert len(keys) >= 22
    assert sorted(k for k in keys if f"`{k}`" not in page) == []
