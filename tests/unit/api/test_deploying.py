"""What a deployed system inherits: tables, verdicts and a seal, and what is refused."""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING

import pytest

import soter
from soter.api.deploy.inheritance import FILE
from soter.certificate.report import Report
from soter.diagnostics.diagnostic import SoterError
from soter.diagnostics.render import render_all

if TYPE_CHECKING:
    from pathlib import Path

PROVED = """soter 1;
param TOP: float = 9.0 in [5.0, 9.5];
topic motion: float in [-20.0, 20.0] max_age 20ms;
topic push: float in [-1.0, 1.0];
input topic goal: float in [-9.0, 9.0];
plant Point period 10ms {
  reads push;
  drives motion = x;
  state x: float in [-1.0, 1.0];
  disturbance wind: float in [-0.1, 0.1];
  der x = push + wind;
  measured motion within 0.1;
}
node Fast period 10ms {
  subscribes motion, goal;
  publishes push;
  step { publish push = clamp(goal, -1.0, 1.0); }
}
node Back period 10ms {
  subscribes motion;
  publishes push;
  step { publish push = clamp(-motion, -1.0, 1.0); }
}
rta Keep {
  ac Fast;
  sc Back;
  period 50ms;
  safe abs(motion) < TOP;
  verify {
    grid motion in [-10.0, 10.0] / 200;
    late dm 1ms, sc 2ms;
    response dm 1ms, sc 1ms;
    acts within 1ms;
  }
}
system Protected default { p: Point; module Keep; input goal every 1s; until 10s; }
"""
VEHICLE = """soter 1;
import "point.soter" as point;
system Vehicle deploys point.Protected {
  external topic point.motion every 10ms delayed 4ms measured point.motion within 0.1;
  external topic point.goal;
  external topic point.push;
  module point.Keep;
}
"""


@pytest.fixture
def here(tmp_path: Path) -> Path:
    (tmp_path / "point.soter").write_text(PROVED)
    (tmp_path / "vehicle.soter").write_text(VEHICLE)
    return tmp_path


@pytest.fixture(scope="module")
def cert(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A certificate of the proved system, made where that lies alone."""
    folder = tmp_path_factory.mktemp("proved")
    (folder / "point.soter").write_text(PROVED)
    report = soter.load(folder / "point.soter").verify(cert=folder / "cert")
    open_ = {n for r in report.modules for n, f in r.findings.items() if f.verdict != "proved"}
    assert open_ == {"failsafe"}, "no law is declared: it is assumed"
    return folder / "cert"


def refused(folder: Path, **how: object) -> tuple[str, str]:
    """Code and text of the first error of a build."""
    with pytest.raises(SoterError) as caught:
        soter.load(folder / "vehicle.soter").build("c", folder / "out", **how)  # type: ignore[arg-type]
    assert not (folder / "out").exists(), "nothing is written"
    first = caught.value.diagnostics[0]
    return first.code, render_all(caught.value.diagnostics)


def changed(folder: Path, name: str, old: str, new: str) -> None:
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))


def test_without_a_certificate_nothing_is_said_to_be_proved(here: Path) -> None:
    made = soter.load(here / "vehicle.soter").build("c", here / "out")
    (module,) = json.loads((here / "out" / FILE).read_text())["modules"]
    assert module["inherited"] is False
    assert module["confirmed"] == []
    assert "no certificate" in module["why_not"]
    assert "CERTIFICATE" not in (here / "out" / "Vehicle_firmware.h").read_text()
    assert "nothing proved" in made.inherits[0]


def test_verdicts_and_seal_of_a_certificate_that_was_checked_again_are_carried(
    here: Path, cert: Path
) -> None:
    made = soter.load(here / "vehicle.soter").build("c", here / "out", cert=cert)
    told = json.loads((here / "out" / FILE).read_text())
    seal = (cert / "SEAL").read_text().strip()
    assert told["certificate"] == seal
    assert told["deploys"] == "point.Protected"
    (module,) = told["modules"]
    assert module["inherited"] is True
    assert {"P1c", "P2a", "P3", "ttf", "safer"} <= set(module["confirmed"])
    assert module["missing"] == []
    assert module["covered"] == [
        "point.motion: at most 16 ms old of 20 ms, point.motion within 0.1 of 0.1"
    ]
    assert any("before the first step" in a for a in module["assumptions"])
    assert f'Vehicle_CERTIFICATE "{seal}"' in (here / "out" / "Vehicle_firmware.h").read_text()
    assert made.inherited == told


def test_the_readme_of_a_deployed_package_says_what_works(here: Path) -> None:
    """Its command has nobody outside who publishes; the library is what it is for."""
    soter.load(here / "vehicle.soter").build("c", here / "out")
    soter.load(here / "point.soter").build("c", here / "model")
    told = (here / "out" / "README.md").read_text()
    header = (here / "out" / "Vehicle_firmware.h").read_text()
    first, _, command = told.partition("    make\n")
    assert "    make lib\n" in first
    assert "nobody outside" in first
    assert "--until" in command
    (library,) = re.findall(r"`(lib\S+\.a)`", first)
    assert f"\n{library}: " in (here / "out" / "Makefile").read_text()
    for name in re.findall(r"`(Vehicle_[a-z]+_?)[.]*`", first):
        assert f"{name}" in header, name
    assert "make lib" not in (here / "model" / "README.md").read_text()


def test_the_tables_that_were_computed_with_the_plants_are_those_of_the_deployed_system(
    here: Path,
) -> None:
    soter.load(here / "vehicle.soter").build("c", here / "out")
    soter.load(here / "point.soter").build("c", here / "model")
    own = (here / "out" / "vehicle.c").read_text()
    model = (here / "model" / "point.c").read_text()
    table = r"static const [^;{]*level[^;{]*\{[^}]*\}"
    tables = re.findall(table, model)
    assert tables, "the predicates were computed"
    assert [_plain(t) for t in re.findall(table, own)] == [_plain(t) for t in tables]


def _plain(text: str) -> str:
    return re.sub(r"\b(vehicle|point)_(point_)?", "", text)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (" measured point.motion within 0.1", "", "nothing says how exact"),
        ("within 0.1;", "within 0.11;", "within 0.11"),
        ("every 10ms ", "", "how often"),
        ("delayed 4ms", "delayed 9ms", "may be 21 ms old"),
        ("every 10ms", "every 15ms", "may be 21 ms old"),
        ("  external topic point.push;\n", "", "nobody takes it out"),
    ],
)
def test_what_comes_from_outside_is_no_worse_than_the_proof_allows(
    here: Path, old: str, new: str, says: str
) -> None:
    changed(here, "vehicle.soter", old, new)
    code, text = refused(here)
    assert code == "D019"
    assert says in text


def test_a_bound_is_met_exactly_and_not_passed(here: Path) -> None:
    changed(here, "vehicle.soter", "delayed 4ms", "delayed 8ms")
    soter.load(here / "vehicle.soter").build("c", here / "out")
    changed(here, "vehicle.soter", "delayed 8ms", "delayed 8000001ns")
    assert refused_after(here) == "D019"


def refused_after(folder: Path) -> str:
    with pytest.raises(SoterError) as caught:
        soter.load(folder / "vehicle.soter").build("c", folder / "out")
    return caught.value.diagnostics[0].code


def test_a_silence_is_not_used_up_by_what_is_always_so(here: Path) -> None:
    changed(here, "point.soter", "late dm", "dropout 10ms; late dm")
    changed(here, "vehicle.soter", "every 10ms", "every 15ms")
    code, text = refused(here)
    assert code == "D019"
    assert "may be 21 ms old" in text
    assert "silences" in text
    changed(here, "vehicle.soter", "every 15ms", "every 14ms")
    made = soter.load(here / "vehicle.soter").build("c", here / "out")
    assert "at most 20 ms old of 20 ms, and silences 10 ms longer" in " ".join(made.inherits)


def test_a_module_that_cannot_be_proved_inherits_nothing_and_is_built(here: Path) -> None:
    changed(here, "point.soter", " max_age 20ms", "")
    changed(
        here, "point.soter", "safe abs", "ttf abs(motion) > 5.0; safer abs(motion) < 4.0; safe abs"
    )
    made = soter.load(here / "vehicle.soter").build("c", here / "out")
    assert "nothing can be proved of it" in made.inherits[0]


# ---------------------------------------------------------------- certificates of something else


def test_a_certificate_of_another_text_is_refused(here: Path, cert: Path) -> None:
    changed(here, "point.soter", "-motion, -1.0", "-1.1 * motion, -1.0")
    code, text = refused(here, cert=cert)
    assert code == "D020"
    assert "point.soter" in text


def test_a_certificate_of_other_values_is_refused(here: Path, cert: Path) -> None:
    code, text = refused(here, cert=cert, params={"point.TOP": 8.0})
    assert code == "D020"
    assert "point.TOP" in text


def test_a_library_that_both_import_has_the_same_values_under_another_name(
    here: Path, tmp_path: Path
) -> None:
    """Who imports it first names it: `far` where the certificate is, `limits` here."""
    (here / "limits.soter").write_text("soter 1;\nparam TOP: float = 9.0 in [5.0, 9.5];\n")
    changed(
        here,
        "point.soter",
        "param TOP: float = 9.0 in [5.0, 9.5];",
        'import "limits.soter" as far;',
    )
    changed(here, "point.soter", "< TOP", "< far.TOP")
    changed(
        here, "vehicle.soter", 'import "point', 'import "limits.soter" as limits;\nimport "point'
    )
    soter.load(here / "point.soter").verify(cert=here / "cert")
    made = soter.load(here / "vehicle.soter").build("c", tmp_path / "out", cert=here / "cert")
    assert "checked again" in made.inherits[0]
    code, text = refused_there(here, tmp_path / "other", {"limits.TOP": 8.0})
    assert code == "D020"
    assert "limits.TOP" in text


def test_a_p1c_that_is_only_assumed_is_told(here: Path, tmp_path: Path) -> None:
    for line in ("    late dm 1ms, sc 2ms;\n", "    response dm 1ms, sc 1ms;\n"):
        changed(here, "point.soter", line, "")
    soter.load(here / "point.soter").verify(cert=here / "cert")
    made = soter.load(here / "vehicle.soter").build("c", tmp_path / "out", cert=here / "cert")
    assert made.inherits[0].endswith(
        "P1c is assumed, not proved: not all of its times are declared"
    )


def refused_there(folder: Path, out: Path, params: dict[str, object]) -> tuple[str, str]:
    with pytest.raises(SoterError) as caught:
        soter.load(folder / "vehicle.soter").build("c", out, cert=folder / "cert", params=params)
    return caught.value.diagnostics[0].code, render_all(caught.value.diagnostics)


def test_a_certificate_that_was_changed_is_refused(here: Path, cert: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    for path in cert.rglob("*"):
        if path.is_file():
            target = copy / path.relative_to(cert)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(path.read_bytes())
    manifest = (copy / "manifest.json").read_text()
    (copy / "manifest.json").write_text(manifest.replace('"undecided"', '"proved"') + " ")
    code, text = refused(here, cert=copy)
    assert code == "D020"
    assert "rejected" in text


@pytest.mark.parametrize(
    ("verdict", "said"), [("rejected", "it is rejected"), ("not re-checked", "was not re-checked")]
)
def test_a_certificate_that_is_not_accepted_is_refused_for_what_it_is(
    verdict: str, said: str, here: Path, cert: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = Report(verdict, reason="Keep: why")
    monkeypatch.setattr("soter.api.deploy.inheritance.recheck", lambda *_: report)
    code, text = refused(here, cert=cert)
    assert code == "D020"
    assert f"{said}: Keep: why" in text


def test_a_system_that_deploys_nothing_takes_no_certificate(here: Path, cert: Path) -> None:
    with pytest.raises(SoterError, match="deploys no other") as refusal:
        soter.load(here / "point.soter").build("c", here / "out", cert=cert)
    met = re.search(r"with `(external [^`]*)`", refusal.value.diagnostics[0].helps[1])
    assert met is not None
    text = (here / "point.soter").read_text("utf-8")
    copy = f"{text}\nsystem Copy deploys Protected {{ {met[1]} module Keep; }}\n"
    (here / "copy.soter").write_text(copy, encoding="utf-8")
    soter.load(here / "copy.soter").check()  # what is advised is a program


def test_a_deployed_system_is_not_verified_itself(here: Path) -> None:
    with pytest.raises(SoterError, match="has no plants"):
        soter.load(here / "vehicle.soter").verify(system="Vehicle")
