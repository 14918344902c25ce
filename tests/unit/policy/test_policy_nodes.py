"""A node that a policy's file answers: numbers in order, counts that are compared, processes."""

from __future__ import annotations

import pickle
import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest
from policy_files import FILES, onnx_of, random_layers  # type: ignore[import-not-found]

import soter
from soter.cli.terminal.console import Console
from soter.cli.terminal.run_summary import run_summary
from soter.core.layout import decode_from, encode_into
from soter.diagnostics.diagnostic import SoterError
from soter.policy.network import prepare_network
from soter.policy.sb3_file import read_sb3
from soter.simulate.externs.extern_process import RealTimeResponder, write_spec
from soter.workers.exchange import make_exchange

if TYPE_CHECKING:
    from pathlib import Path

PROGRAM = """soter 1;
type Motion = {{ place: Vec2, speed: float }};
topic motion: Motion;
topic goal: float[2] = [0.5, -0.25];
{topics}
plant World period 10ms {{
  drives motion = {{ place: vec2(p, 2.0 * p), speed: 3.0 * p }};
  drives goal = [4.0 * p, -p];
  state p: float;
  disturbance draw: float in [-1.0, 1.0];
  next p = draw;
}}
extern node Pilot period 10ms from "{source}" {{
  subscribes {reads};
  publishes {writes};
}}
system S {{ w: World; node Pilot; until 200ms; }}
"""


def loaded(
    folder: Path,
    source: str,
    topics: str = "topic push: float;",
    writes: str = "push",
    reads: str = "motion, goal",
) -> soter.Program:
    text = PROGRAM.format(source=source, topics=topics, writes=writes, reads=reads)
    (folder / "p.soter").write_text(text, encoding="utf-8")
    return soter.load(folder / "p.soter")


def refusal(program: soter.Program, *, apart: bool = False) -> str:
    with pytest.raises(SoterError) as caught:
        program.simulate(apart=apart)
    (problem,) = caught.value.diagnostics
    assert problem.code == "X014"
    assert problem.primary is not None
    return problem.message


@pytest.fixture
def onnx_file(tmp_path: Path) -> Path:
    """5 numbers in, 1 out."""
    pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
    pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")
    path = tmp_path / "policy.onnx"
    path.write_bytes(onnx_of(random_layers(1, 5, 16, 1), "Tanh").SerializeToString())
    return path


@pytest.mark.parametrize("engine", ["native", "interp"])
@pytest.mark.parametrize("apart", [False, True])
def test_records_and_arrays_are_the_observation_in_declared_order(
    tmp_path: Path, onnx_file: Path, engine: str, *, apart: bool
) -> None:
    import onnxruntime

    run = loaded(tmp_path, "onnx:policy.onnx").simulate(engine=engine, apart=apart)
    session = onnxruntime.InferenceSession(onnx_file, providers=["CPUExecutionProvider"])
    seen = np.hstack([run.array("motion"), run.array("goal")]).astype(np.float32)
    assert np.ptp(seen) > 1.0
    wanted = [session.run(None, {"obs": x[None, :]})[0][0, 0] for x in seen]
    assert run.array("push").tolist() == [float(y) for y in wanted]
    (note,) = run.notes
    order = "motion.place.x, motion.place.y, motion.speed, goal (2 numbers)"
    order += "; observations are not normalised, unless the file does it"
    assert note == f"Pilot assumes, as its file does not say: its observation is {order}"


def test_an_index_chooses_a_member(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
    pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")
    layers = random_layers(2, 5, 8, 3)
    chosen = onnx_of(layers, "Relu", [("ArgMax", {"axis": 1, "keepdims": 0})])
    (tmp_path / "c.onnx").write_bytes(chosen.SerializeToString())
    (tmp_path / "n.onnx").write_bytes(onnx_of(layers, "Relu").SerializeToString())
    topic = "type Gear = enum { LOW, MIDDLE, HIGH };\ntopic gear: Gear;"
    gears = loaded(tmp_path, "onnx:c.onnx", topic, "gear").simulate().topic("gear")
    numbers = loaded(tmp_path, "onnx:n.onnx", "topic n: float[3];", "n").simulate().array("n")
    assert gears.tolist() == numbers.argmax(axis=1).tolist()
    assert len(set(gears.tolist())) > 1
    assert "numbers with fractions" in refusal(
        loaded(tmp_path, "onnx:n.onnx", "topic a: int; topic b: int; topic c: int;", "a, b, c")
    )


def test_a_number_that_is_none_is_the_gates_business(tmp_path: Path) -> None:
    pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
    pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")
    layers = random_layers(1, 5, 1)
    layers[0][0][0, 2] = np.nan
    (tmp_path / "nan.onnx").write_bytes(onnx_of(layers, "Relu").SerializeToString())
    run = loaded(tmp_path, "onnx:nan.onnx").simulate()
    assert run.violations > 0  # a node that is no advanced controller published no number
    assert run.array("push").tolist() == [0.0] * len(run.array("push"))


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize(
    ("source", "more", "said"),
    [
        ("sb3:ppo.zip", {}, "it takes 2 numbers, the node reads 5 (`motion`, `goal`)"),
        (
            "sb3:ppo.zip",
            {"reads": "goal", "topics": "topic push: Vec2;"},
            "it answers 1 number, the node publishes 2 (`push`)",
        ),
        ("sb3:sac.zip:ppo_vecnormalize.pkl", {"reads": "motion"}, "it is of 2 numbers"),
        (
            "sb3:ppo.zip",
            {"reads": "words", "topics": "input topic words: float[<=2]; topic push: float;"},
            "`words` is a `float[<=2]`, of which no numbers in a fixed order",
        ),
    ],
)
def test_a_file_that_does_not_fit_the_node_is_refused(
    tmp_path: Path, source: str, more: dict[str, str], said: str, *, apart: bool
) -> None:
    for file in FILES.iterdir():
        shutil.copy(file, tmp_path)
    assert said in refusal(loaded(tmp_path, source, **more), apart=apart)


def test_frames_are_stacked_where_the_policy_takes_a_multiple(tmp_path: Path) -> None:
    for file in FILES.iterdir():
        shutil.copy(file, tmp_path)
    source = "sb3:a2c_of_frames.zip:a2c_vecnormalize.pkl"
    run = loaded(tmp_path, source, reads="motion").simulate()
    (note,) = run.notes
    assert note.endswith("3 frames are stacked, the oldest first, zeros before the first")
    assert run.extern_failures == {}
    assert len(set(run.array("push").tolist())) > 3


def test_the_process_of_real_time_answers_what_the_engine_would(tmp_path: Path) -> None:
    shutil.copy(FILES / "sac.zip", tmp_path)
    program = loaded(tmp_path, "sb3:sac.zip", reads="motion")
    system = program.simulate(until="10ms").system
    (node,) = [x for x in system.components if x.extern]
    write_spec(system, node, 1, tmp_path / "spec")
    server = RealTimeResponder(pickle.loads((tmp_path / "spec").read_bytes()))  # noqa: S301 - ours
    exchange = make_exchange(system, node)
    request = bytearray(exchange.request.size)
    (member,) = exchange.request.members
    encode_into(request, member.offset, member.type, ((0.5, -0.25), 3.0))
    answer = server.step(bytes(request))
    assert answer is not None
    (sent,) = [m for m in exchange.answer.members if m.name == "push"]
    given, run, _ = prepare_network(read_sb3(tmp_path / "sac.zip").network)
    given[:] = 0.5, -0.25, 3.0
    assert decode_from(bytearray(answer), sent.offset, sent.type) == float(run()[0])


def test_a_package_in_c_says_how_a_policy_gets_into_it(tmp_path: Path) -> None:
    shutil.copy(FILES / "sac.zip", tmp_path)
    package = loaded(tmp_path, "sb3:sac.zip", reads="motion").build("c", tmp_path / "out")
    told = "its policy is left out, as the package is C: `soter policy {} -o sac.soter` writes"
    assert any(told.format(tmp_path / "sac.zip") in note for note in package.notes)


def test_what_a_binding_may_say(tmp_path: Path) -> None:
    for source in ("onnx:a.onnx:b", "sb3:a:b:c", "onnx:", "sb3"):
        assert [d.code for d in loaded(tmp_path, source).diagnostics] == ["X009"]
    program = loaded(tmp_path, "sb3:absent.zip:gone.pkl")
    (warning,) = program.check().warnings
    assert (warning.code, "there is no file" in warning.message) == ("W007", True)
    with pytest.raises(SoterError) as caught:
        program.simulate()
    assert [d.code for d in caught.value.diagnostics] == ["X003"]
    with pytest.raises(SoterError) as caught:
        program.bind("Pilot", f"sb3:{FILES / 'ppo.zip'}:gone.pkl")
    assert [d.code for d in caught.value.diagnostics] == ["X003"]


def test_policies_answer_nodes_and_nothing_else(tmp_path: Path) -> None:
    text = PROGRAM.replace(
        "plant World period 10ms {{", 'extern plant World period 10ms from "sb3:w.zip" {{'
    )
    text = text.replace("  disturbance draw: float in [-1.0, 1.0];\n  next p = draw;\n", "")
    (tmp_path / "p.soter").write_text(
        text.format(source="sb3:p.zip", topics="topic push: float;", reads="goal", writes="push")
    )
    with pytest.raises(SoterError) as caught:
        soter.load(tmp_path / "p.soter").simulate()
    assert "X008" in [d.code for d in caught.value.diagnostics]


def test_a_run_says_how_answers_of_onnx_are_put_into_their_set(onnx_file: Path) -> None:
    """Once they are beyond it, and only where that would help."""
    told = []
    for source, topic in (
        ("onnx:policy.onnx", "float in [-0.001, 0.001]"),
        ("onnx:policy.onnx:clip", "float in [-0.001, 0.001]"),
        ("onnx:policy.onnx", "float"),
    ):
        run = loaded(onnx_file.parent, source, f"topic push: {topic};").simulate()
        with Console(json=False) as console:
            told.append("policy.onnx:clip` puts" in run_summary(run, "p.soter", console))
    assert told == [True, False, False]


@pytest.mark.parametrize(
    ("topics", "writes", "told"),
    [
        ("topic push: float in [-1.0, 1.0];", "push", "`push` takes [-1.0, 1.0]"),
        ("topic push: float in [-2.0, 2.0];", "push", ""),
        ("topic push: float;", "push", ""),
        ("topic push: int in [0, 3];", "push", "`push` takes [0, 3]"),
    ],
)
def test_check_warns_of_actions_that_a_topic_does_not_take(
    tmp_path: Path, topics: str, writes: str, told: str
) -> None:
    """Such an answer is a step fault: SC would fly, and nobody would know why."""
    shutil.copy(FILES / "sac.zip", tmp_path)
    program = loaded(tmp_path, "sb3:sac.zip", topics, writes, reads="motion")
    found = [d.message for d in program.check().warnings if d.code == "W037"]
    assert len(found) == bool(told)
    assert all("all of [-2.0, 2.0], the action space of" in m and told in m for m in found)
    other = tmp_path / "other.zip"
    other.write_bytes(b"no zip")
    (warning,) = program.bind("Pilot", f"sb3:{other}").check().warnings
    assert (warning.code, "it is no zip" in warning.message) == ("W007", True)


def test_each_number_of_several_topics_is_compared_with_its_own_set(tmp_path: Path) -> None:
    shutil.copy(FILES / "ppo_sde.zip", tmp_path)
    found = []
    for at in range(2):
        sets = ["[-1.0, 3.0]", "[-1.0, 3.0]"]
        sets[at] = "[-1.0, 2.5]"
        topics = "".join(f"topic {n}: float in {s};\n" for n, s in zip("ab", sets, strict=True))
        program = loaded(tmp_path, "sb3:ppo_sde.zip", topics, "a, b", reads="motion")
        (warning,) = [d for d in program.check().warnings if d.code == "W037"]
        found.append("`b` takes" in warning.message)
    assert found == [False, True]
