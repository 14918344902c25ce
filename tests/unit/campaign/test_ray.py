"""Campaigns on a cluster: the same bytes as here, and nothing lost where workers die."""

from __future__ import annotations

import json
import os
import pickle
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, TypeVar

import pytest

import processes
from soter import SoterError, load
from soter.campaign import fly_campaign
from soter.campaign.batch_flights import Fleet, Flyer
from soter.campaign.fly_campaign import TRIES, WorkerReply, fly_batch, soter_digest
from soter.campaign.recipe import unpacked_recipe
from soter.diagnostics.diagnostic import Diagnostic
from soter.language.front_end import check_file, system_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from soter.campaign.result import Campaign

ROOT = Path(__file__).resolve().parents[3]
CART = ROOT / "examples" / "wall" / "cart.soter"
HOW: dict[str, Any] = {"flights": 100, "until": "4s", "arms": ("ac",)}
EXTERN = """soter 1;
topic a: float in [-1.0, 1.0];
extern fun twice(x: float): float from "c:code/pilot.c:twice";
node N period 100ms { publishes a; step { publish a = twice(choose [-1, 1] == 0 ? -0.2 : 0.3); } }
system S { node N; until 2s; never a > 0.5; }
"""
PILOT = """#include "../more/factor.h"
#include <stdlib.h>
#include <unistd.h>
double twice(double x) {
  if (access(MARK, F_OK) != 0) { abort(); }
  return FACTOR * x;
}
"""
HEADER = '#define FACTOR 2.0\n#define MARK "{mark}"\n'


Sent = TypeVar("Sent")


def sent(what: Sent) -> Sent:
    """What comes out at the other end."""
    copy: Sent = pickle.loads(pickle.dumps(what))  # noqa: S301 - its own
    return copy


class RayError(Exception):
    """What Ray raises where a worker is gone."""


class RayTaskError(RayError):
    """What Ray raises where a task did."""


class FakeRay(SimpleNamespace):
    """As much of Ray as is asked for; what it is sent is pickled, and some of its workers die."""

    def __init__(self, dies: Callable[[int], bool] = lambda _: False) -> None:
        exceptions = SimpleNamespace(RayError=RayError, RayTaskError=RayTaskError)
        super().__init__(exceptions=exceptions, dies=dies, tasks=0, cancelled=0, joined=False)

    def is_initialized(self) -> bool:
        return self.joined

    def init(self, **_: object) -> None:
        self.joined = True

    def shutdown(self) -> None:
        self.joined = False

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": 3.0}

    def put(self, value: object) -> object:
        return value

    def remote(self, **options: object) -> Callable[[Any], Any]:
        assert options == {"num_cpus": 1, "max_retries": 0}
        return lambda task: SimpleNamespace(remote=lambda *given: self.asked(task, given))

    def asked(
        self, task: Callable[..., WorkerReply], given: tuple[Any, ...]
    ) -> Callable[[], WorkerReply]:
        self.tasks += 1
        number = self.tasks

        def answer() -> WorkerReply:
            if self.dies(number):
                message = "\nthe worker died\nmore of it"
                raise RayError(message)
            return sent(task(*sent(given)))

        return answer

    def get(self, asked: Callable[[], WorkerReply]) -> WorkerReply:
        return asked()

    def cancel(self, _: object, *, force: bool) -> None:
        assert force
        self.cancelled += 1


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> Callable[..., FakeRay]:
    def made(dies: Callable[[int], bool] = lambda _: False) -> FakeRay:
        fake_ray = FakeRay(dies)
        monkeypatch.setitem(sys.modules, "ray", fake_ray)
        monkeypatch.setattr(fly_campaign, "find_spec", lambda _: True)
        monkeypatch.setattr(fly_campaign, "_flyers", {})
        return fake_ray

    return made


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("here") / "c"
    return load(CART).campaign("Protected", output=folder, workers="local", **HOW)


def same(actual: Path, wanted: Path) -> bool:
    """Whether all flights of two campaigns are, arms included, byte for byte."""
    files = sorted(p.relative_to(wanted) for p in wanted.rglob("flights.csv"))
    assert len(files) == 2
    return all((actual / p).read_bytes() == (wanted / p).read_bytes() for p in files)


def test_what_is_sent_flies_the_same() -> None:
    flat = system_of(check_file(str(CART)), "Unprotected")
    fleet = Fleet(flat, 10**9)
    assert Flyer(unpacked_recipe(sent(fleet.recipe))).fly(range(40), 3) == fleet.fly(range(40), 3)


def test_a_cluster_flies_the_same(
    ray: Callable[..., FakeRay], here: Campaign, tmp_path: Path
) -> None:
    fake = ray()
    campaign = load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    assert same(tmp_path / "c", here.folder)
    assert (campaign.result, campaign.workers, fake.joined) == (here.result, 3, False)
    assert {f.all_ac_s for f in campaign.arms[1].flights} == {4.0}


def test_what_the_caller_joined_is_not_left(ray: Callable[..., FakeRay], tmp_path: Path) -> None:
    fake = ray()
    fake.joined = True
    load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    assert fake.joined


@pytest.mark.parametrize("dies", [lambda k: k % 2 == 1, lambda k: 3 <= k < 3 + TRIES - 1])
def test_a_batch_whose_worker_dies_is_flown_again(
    dies: Callable[[int], bool], ray: Callable[..., FakeRay], here: Campaign, tmp_path: Path
) -> None:
    ray(dies)
    load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    assert same(tmp_path / "c", here.folder)


def test_where_all_workers_die_what_was_flown_is_kept(
    ray: Callable[..., FakeRay], here: Campaign, tmp_path: Path
) -> None:
    fake = ray(lambda k: k > 1)
    with pytest.raises(SoterError, match="flights 32 to 63") as caught:
        load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    (said,) = caught.value.diagnostics
    assert (said.code, said.notes) == ("D018", ("the worker died",))
    assert (fake.cancelled, fake.joined) == (3, False)
    assert fake.tasks == 4 + TRIES
    assert len((tmp_path / "c" / "flights.csv").read_text().splitlines()) == 1 + 32
    load(CART).campaign("Protected", output=tmp_path / "c", **HOW)
    assert same(tmp_path / "c", here.folder)


def test_what_a_worker_refuses_is_said(
    ray: Callable[..., FakeRay], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    ray()
    wrong = Diagnostic("X005", "no compiler")

    def refuse(_: object) -> None:
        raise SoterError((wrong,))

    monkeypatch.setattr(fly_campaign, "Flyer", refuse)
    with pytest.raises(SoterError) as caught:
        load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    assert caught.value.diagnostics == (wrong,)


def test_what_a_task_raises_is_said_and_not_tried_again(
    ray: Callable[..., FakeRay], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fake = ray()

    def fails(_: object) -> None:
        message = "Traceback\nModuleNotFoundError: No module named 'soter'"
        raise RayTaskError(message)

    monkeypatch.setattr(fake, "get", fails)
    with pytest.raises(SoterError, match="a worker cannot fly") as caught:
        load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    (said,) = caught.value.diagnostics
    assert said.notes == ("ModuleNotFoundError: No module named 'soter'",)
    assert fake.tasks == 4


def test_a_worker_with_another_soter_does_not_fly() -> None:
    told = fly_batch("key", b"", soter_digest()[:-1] + "?", [0], 1)
    assert (told.flights, [d.code for d in told.wrong]) == ([], ["D018"])
    assert "another Soter" in told.wrong[0].message


def test_a_cluster_that_cannot_be_joined(
    ray: Callable[..., FakeRay], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    fake = ray()

    def refuse(**_: object) -> None:
        message = "no such address"
        raise ConnectionError(message)

    monkeypatch.setattr(fake, "init", refuse)
    with pytest.raises(SoterError, match="cannot be joined") as caught:
        load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    assert caught.value.diagnostics[0].notes == ("no such address",)


def test_without_ray(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(fly_campaign, "find_spec", lambda _: None)
    with pytest.raises(SoterError, match="D007") as caught:
        load(CART).campaign("Protected", output=tmp_path / "c", workers="ray", **HOW)
    assert "pip install 'soter-rta[cluster]'" in caught.value.diagnostics[0].helps[0]
    assert not (tmp_path / "c").exists()


def test_workers_are_a_number_local_or_ray(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from soter.cli.main import main

    with pytest.raises(SoterError, match="many workers cannot fly"):
        load(CART).campaign("Protected", output=tmp_path / "c", workers="many", **HOW)
    arguments = ["campaign", str(CART), "--flights", "3", "--until", "1s"]
    arguments += ["--system", "Protected", "-o", str(tmp_path / "c"), "--workers"]
    assert main([*arguments, "many"]) == 2
    assert main([*arguments, "0"]) == 2
    capsys.readouterr()
    assert main([*arguments, "local", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["workers"] >= 1


# ---------------------------------------------------------------- Ray itself


def extern(folder: Path, mark: Path) -> Path:
    """A program with a C extern and a header, which dies as long as `mark` is not there."""
    for name in ("code", "more"):
        (folder / name).mkdir(parents=True)
    (folder / "code" / "pilot.c").write_text(PILOT)
    (folder / "more" / "factor.h").write_text(HEADER.format(mark=mark))
    (folder / "program.soter").write_text(EXTERN)
    return folder / "program.soter"


@pytest.mark.long
def test_the_c_of_externs_is_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ray: Callable[..., FakeRay]
) -> None:
    ray()
    (tmp_path / "mark").touch()
    path = extern(tmp_path / "p", tmp_path / "mark")
    wanted = load(path).campaign(flights=40, output=tmp_path / "here")
    flyers: list[Flyer] = []

    def made(recipe: Any) -> Flyer:
        assert not any(str(tmp_path / "p") in s for s in recipe.unit.c_sources)
        flyers.append(Flyer(recipe))
        return flyers[-1]

    monkeypatch.setattr(fly_campaign, "Flyer", made)
    campaign = load(path).campaign(flights=40, output=tmp_path / "there", workers="ray")
    assert (campaign.result, len(flyers)) == (wanted.result, 1)
    assert wanted.result.violations > 0


SCRIPT = """
import sys, threading, time, pathlib
import ray, soter
ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="error")
cart, out, program, mark = map(pathlib.Path, sys.argv[1:])
said = (out / "said").open("w")
found = soter.load(cart).campaign("Protected", flights=100, until="4s", arms=("ac",),
                                  output=out / "cart", workers="ray")
print(found.workers, file=said)
try:
    soter.load(program).campaign(flights=100, output=out / "extern", workers="ray")
except soter.SoterError as error:
    print(error.diagnostics[0].code, file=said)
mark.touch()
soter.load(program).campaign(flights=100, output=out / "extern", workers="ray")
print(ray.is_initialized(), file=said)
"""


@pytest.mark.skipif(find_spec("ray") is None, reason="the extra `cluster` is absent")
def test_ray_flies_the_same_and_survives_workers_that_die(tmp_path: Path, here: Campaign) -> None:
    mark = tmp_path / "mark"
    path = extern(tmp_path / "p", mark)
    command = [sys.executable, "-c", SCRIPT, str(CART), str(tmp_path), str(path), str(mark)]
    done = processes.run(command, capture_output=True, text=True)
    assert (tmp_path / "said").read_text().split() == ["2", "D018", "True"], done.stderr
    assert same(tmp_path / "cart", here.folder)
    load(path).campaign(flights=100, output=tmp_path / "local")
    assert (tmp_path / "extern" / "flights.csv").read_bytes() == (
        tmp_path / "local" / "flights.csv"
    ).read_bytes()


DYING_RAY = """import os
from types import SimpleNamespace
class exceptions:
    class RayError(Exception): pass
    class RayTaskError(RayError): pass
def is_initialized(): return False
def init(**_): pass
def shutdown(): pass
def cluster_resources(): return {"CPU": 1.0}
def put(value): return value
def remote(**_): return lambda task: SimpleNamespace(remote=lambda *given: None)
def get(asked):
    os.write(2, b"the head is gone")
    os._exit(1)  # as Ray's C++ does when it has been looking for its head for a minute
def cancel(*_, **__): pass
"""
CRASHING = PILOT.replace("access(MARK, F_OK) != 0", "x > 0.0")


@pytest.mark.parametrize("workers", ["ray", "1"])
def test_the_end_of_the_process_that_flies_is_told(tmp_path: Path, workers: str) -> None:
    """Ray whose head is gone ends it, and so does C that crashes."""
    (tmp_path / "ray.py").write_text(DYING_RAY)
    (tmp_path / "s.soter").write_text(EXTERN)
    for name, text in (("code/pilot.c", CRASHING), ("more/factor.h", HEADER.format(mark="none"))):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
    words = ("campaign", "s.soter", "--flights", "3", "--workers", workers, "--json")
    done = processes.run(
        [sys.executable, "-m", "soter.cli.main", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
    )
    document = json.loads(done.stdout)
    assert (done.returncode, document["exit"]) == (1, 1)
    (problem,) = document["diagnostics"]
    assert problem["code"] == "X011"
    assert "what was flown is kept" in problem["notes"][-1]
    assert ("Ray ends" in problem["notes"][-1]) == (workers == "ray")
