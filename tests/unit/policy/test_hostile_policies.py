"""Damaged, hostile and unread files are X014 with a reason, and nothing in them is run."""

from __future__ import annotations

import io
import os
import pickle
import zipfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from policy_files import FILES, change_pickle, changed, onnx_of, random_layers, renamed, zipped  # type: ignore[import-not-found]

from soter.diagnostics.diagnostic import SoterError
from soter.policy.onnx_file import read_onnx
from soter.policy.sb3_file import read_sb3

if TYPE_CHECKING:
    from collections.abc import Callable

PPO = (FILES / "ppo.zip").read_bytes()
STATISTICS = (FILES / "ppo_vecnormalize.pkl").read_bytes()
MARK = "hostile_was_run"


class Hostile:
    """What a pickle calls when somebody unpickles it."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (MARK,)


def _ppo(**how: object) -> bytes:
    """The file with settings, tensors or parts changed."""
    made: bytes = changed("ppo.zip", **how)
    return made


def _pickled(which: str, change: Callable[[bytes], bytes]) -> bytes:
    return _ppo(settings=lambda said: change_pickle(said, which, change))


def _tensors(change: Callable[[dict[str, bytes]], object]) -> bytes:
    return _ppo(tensors=change)


def _pickle_of_tensors(change: Callable[[bytes], bytes]) -> bytes:
    def at(parts: dict[str, bytes]) -> None:
        parts["archive/data.pkl"] = change(parts["archive/data.pkl"])

    return _tensors(at)


def _kwargs(**more: object) -> bytes:
    return _ppo(settings=lambda said: said.update(policy_kwargs=more))


def _large() -> bytes:
    """A part of 65 MiB in a few kilobytes."""
    parts = zipfile.ZipFile(io.BytesIO(PPO))
    data = {n: parts.read(n) for n in parts.namelist()}
    made: bytes = zipped({**data, "policy.pth": bytes(65 * 2**20)}, zipfile.ZIP_DEFLATED)
    return made


def _bomb() -> bytes:
    """Six parts of 60 MiB in some hundred kilobytes."""
    parts = {f"{k}": bytes(60 * 2**20) for k in range(5)}
    made: bytes = zipped({**parts, "data": b"{}"}, zipfile.ZIP_DEFLATED)
    return made


def _nan() -> bytes:
    not_a_number = np.full(16, np.nan, "<f4").tobytes()
    return _tensors(lambda parts: parts.update({"archive/data/1": not_a_number}))


SB3: dict[str, tuple[bytes | Callable[[], bytes], str]] = {
    "empty": (b"", "it is no zip"),
    "noise": (bytes(range(256)) * 9, "it is no zip"),
    "cut": (PPO[: len(PPO) // 2], "it is no zip"),
    "torn": (PPO[:600] + b"\0" * 60 + PPO[660:], "is damaged"),
    "not of save": (zipped({"readme": b""}), "no part `data`"),
    "large": (_large, "larger than 64 MiB"),
    "many large parts": (_bomb, "unpacked it is larger than 256 MiB"),
    "many parts": (
        lambda: zipped({f"{k}": b"" for k in range(10_001)}),
        "more than 10,000 parts",
    ),
    "data no JSON": (changed("ppo.zip", parts=lambda p: p.update(data=b"{")), "is no JSON"),
    "data deep": (changed("ppo.zip", parts=lambda p: p.update(data=b"[" * 10**6)), "is no JSON"),
    "data a list": (changed("ppo.zip", parts=lambda p: p.update(data=b"[]")), "no JSON object"),
    "no class": (changed("ppo.zip", lambda s: s.pop("policy_class")), "its policy class is"),
    "hostile class": (
        _pickled("policy_class", lambda _: pickle.dumps(Hostile())),
        "its policy class is `of its own`",
    ),
    "images": (
        _pickled("policy_class", lambda p: renamed(p, "ActorCriticPolicy", "ActorCriticCnnPolicy")),
        "ActorCriticCnnPolicy`",
    ),
    "hostile space": (
        _pickled("observation_space", lambda _: pickle.dumps(Hostile())),
        "it does not say its observation space",
    ),
    "dict space": (
        _pickled("observation_space", lambda p: renamed(p, "Box", "Dict")),
        "its observations by name have no names",
    ),
    "no pickle": (_pickled("action_space", lambda _: b"!!"), "it is no pickle"),
    "cut pickle": (_pickled("action_space", lambda p: p[:90]), "it is no pickle"),
    "old opcodes": (_pickled("action_space", lambda _: b"(I1\nI2\no."), "the opcode INT"),
    "calls a value": (_pickled("action_space", lambda _: b"\x80\x02K\x01)R."), "it calls what is"),
    "huge memo": (
        _pickled("action_space", lambda _: b"\x80\x02Kxr\xff\xff\xff\x7f."),
        "does not say its action space",
    ),
    "long bytes": (
        _pickled("action_space", lambda _: b"\x80\x05\x96" + b"\xff" * 7 + b"\x7f."),
        "it is no pickle",
    ),
    "nested": (
        _pickled("action_space", lambda _: b"\x80\x02)" + b"\x85" * 100_000 + b"."),
        "does not say its action space",
    ),
    "no base64": (
        changed("ppo.zip", lambda s: s["action_space"].update({":serialized:": "?"})),
        "no base64",
    ),
    "other bounds": (
        _pickled("action_space", lambda p: renamed(p, "f4", "f8")),
        "there is no array where one belongs",
    ),
    "no tensors": (changed("ppo.zip", parts=lambda p: p.pop("policy.pth")), "no part `policy.pth`"),
    "tensors no zip": (
        changed("ppo.zip", parts=lambda p: p.update({"policy.pth": b"x"})),
        "is no zip of `torch.save`",
    ),
    "hostile tensors": (
        _pickle_of_tensors(lambda _: pickle.dumps(Hostile())),
        "layer `action_net`",
    ),
    "storage gone": (_tensors(lambda p: p.pop("archive/data/1")), "no part `archive/data/1`"),
    "storage short": (
        _tensors(lambda p: p.update({"archive/data/1": b"\0" * 8})),
        "does not lie in its part row by row",
    ),
    "half precision": (
        _pickle_of_tensors(lambda p: p.replace(b"FloatStorage", b"HalfStorage")),
        "`torch.HalfStorage`: float32 is read",
    ),
    "big-endian": (_tensors(lambda p: p.update({"archive/byteorder": b"big"})), "big-endian"),
    "not a number": (_nan(), "holds a number that is not finite"),
    "layer gone": (
        _pickle_of_tensors(lambda p: renamed(p, "action_net.bias", "action_net.bies")),
        "its layer `action_net` is no matrix",
    ),
    "layers do not follow": (
        _pickle_of_tensors(
            lambda p: renamed(
                renamed(
                    p, "mlp_extractor.policy_net.2.weight", "mlp_extractor.policy_net.3.weight"
                ),
                "mlp_extractor.policy_net.2.bias",
                "mlp_extractor.policy_net.3.bias",
            )
        ),
        "no linear ones with activations",
    ),
    "other activation": (_kwargs(activation_fn="torch.nn.ELU"), "its activation is `torch.nn.ELU`"),
    "other features": (_kwargs(features_extractor_class="mine"), "`features_extractor_class`"),
    "kwargs a list": (
        changed("ppo.zip", lambda s: s.update(policy_kwargs=[])),
        "`policy_kwargs` are no dict",
    ),
}
NORMALISED: dict[str, tuple[bytes, str]] = {
    "noise": (b"\x00\x01", "it is no pickle"),
    "hostile": (pickle.dumps(Hostile()), "it is no VecNormalize"),
    "another class": (renamed(STATISTICS, "VecNormalize", "VecMonitor"), "it is no VecNormalize"),
    "no mean": (renamed(STATISTICS, "mean", "mode"), "there is no array"),
    "whole numbers": (renamed(STATISTICS, "f8", "i8"), "no lists of float64"),
    "of another policy": ((FILES / "a2c_vecnormalize.pkl").read_bytes(), "it is of 3 numbers"),
    "a truth that is a number": (
        STATISTICS.replace(b"norm_obs\x94\x88", b"norm_obs\x94K\x01"),
        "its `norm_obs` is neither True nor False",
    ),
    "somebody's own": (
        renamed(STATISTICS, "stable_baselines3.common.vec_env.vec_normalize", "my_own.normalize"),
        "it is no VecNormalize",
    ),
    "no limit": (renamed(STATISTICS, "clip_obs", "clip_abs"), "no positive numbers"),
}


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refusal(path: Path, statistics: Path | None = None) -> str:
    with pytest.raises(SoterError) as caught:
        read_sb3(path, statistics)
    (problem,) = caught.value.diagnostics
    assert problem.code == "X014"
    assert not Path(MARK).exists()
    assert len(problem.message) < 500
    return problem.message


@pytest.mark.whole
@pytest.mark.parametrize("name", SB3)
def test_a_zip_that_cannot_be_read_says_why(name: str) -> None:
    data, said = SB3[name]
    Path("policy.zip").write_bytes(data() if callable(data) else data)
    assert said in refusal(Path("policy.zip"))


@pytest.mark.parametrize("name", NORMALISED)
def test_statistics_that_cannot_be_read_say_why(name: str) -> None:
    data, said = NORMALISED[name]
    Path("statistics.pkl").write_bytes(data)
    assert said in refusal(FILES / "ppo.zip", Path("statistics.pkl"))


def codes_of(path: Path, statistics: Path | None = None) -> list[str]:
    """Codes of what reading raises; none where it is read."""
    try:
        read_sb3(path, statistics)
    except SoterError as error:
        return [d.code for d in error.diagnostics]
    return []


@pytest.mark.whole
def test_bytes_that_are_changed_anywhere_are_read_or_refused() -> None:
    """A reader that raises anything else than a diagnostic fails here."""
    rng = np.random.default_rng(3)
    for whole, statistics in ((PPO, False), (STATISTICS, True)):
        refused = 0
        for _ in range(300):
            data = bytearray(whole)
            for at in rng.integers(0, len(data), 3):
                data[at] = rng.integers(0, 256)
            Path("changed").write_bytes(data)
            changed_file = Path("changed")
            codes = (
                codes_of(FILES / "ppo.zip", changed_file) if statistics else codes_of(changed_file)
            )
            assert codes in ([], ["X014"])
            refused += bool(codes)
        assert refused > 50
    assert not Path(MARK).exists()


# ---------------------------------------------------------------- ONNX


def _onnx(name: str) -> tuple[bytes, str, str]:
    """A file, and what reading it as layers and asking it by onnxruntime say."""
    import onnx
    from onnx import TensorProto, helper

    layers = random_layers(1, 2, 4, 1)
    model = onnx_of(layers, "Tanh")
    graph = model.graph
    whole = model.SerializeToString()
    if name == "empty":
        return b"", "it has 0 inputs", "onnxruntime does not load it"
    if name == "noise":
        return b"\x99policy" * 40, "it is no ONNX file", "onnxruntime does not load it"
    if name == "cut":
        return whole[: len(whole) // 2], "", "onnxruntime does not load it"
    if name == "two inputs":
        graph.input.append(helper.make_tensor_value_info("state", TensorProto.FLOAT, ["n"]))
        graph.node.append(helper.make_node("Add", ["z1", "state"], ["sum"]))
        graph.output[0].name = "sum"
        return model.SerializeToString(), "it has 2 inputs", "its input `state` is a"
    if name == "another file":
        tensor = graph.initializer[0]
        onnx.external_data_helper.set_external_data(tensor, "/etc/passwd")
        tensor.ClearField("raw_data")
        return model.SerializeToString(), *["is said to lie in `/etc/passwd`"] * 2
    if name == "open axis":
        graph.input[0].type.tensor_type.shape.dim[1].dim_param = "n"
        return model.SerializeToString(), "no float32 of a fixed last axis", "its input `obs` is a"
    if name == "unknown operator":
        graph.node[1].op_type = "Wonder"
        return model.SerializeToString(), "it has the operator Wonder", "does not load it"
    assert name == "sizes"
    return (
        onnx_of([layers[0], layers[0]], "Tanh").SerializeToString(),
        "takes 2 numbers",
        "not load",
    )


@pytest.mark.parametrize(
    "name",
    [
        "empty",
        "noise",
        "cut",
        "two inputs",
        "another file",
        "open axis",
        "unknown operator",
        "sizes",
    ],
)
def test_an_onnx_file_that_cannot_be_read_says_why(name: str) -> None:
    pytest.importorskip("onnx", reason="the extra is absent: soter-rta[learn]")
    pytest.importorskip("onnxruntime", reason="the extra is absent: soter-rta[learn]")
    from soter.policy.onnx_file import read_onnx
    from soter.policy.onnx_session import OnnxSession

    data, read, asked = _onnx(name)
    path = Path("policy.onnx")
    path.write_bytes(data)
    for what, said in ((read_onnx, read), (OnnxSession, asked)):
        with pytest.raises(SoterError) as caught:
            what(path)
        (problem,) = caught.value.diagnostics
        assert problem.code == "X014"
        assert said in problem.message


NOT_FILES: dict[str, Callable[[Path], object]] = {
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "/dev/stdin": lambda path: path.symlink_to("/dev/stdin"),
    "/proc/self/mem": lambda path: path.symlink_to("/proc/self/mem"),
    "a pipe": os.mkfifo,
    "a folder": Path.mkdir,
    "20 GB of holes": lambda path: _with_holes(path, 20 * 2**30),
}


def _with_holes(path: Path, size: int) -> None:
    path.touch()
    os.truncate(path, size)


@pytest.mark.parametrize("kind", NOT_FILES)
@pytest.mark.parametrize("name", ["p.zip", "p.onnx", "p.pkl"])
def test_only_an_ordinary_file_is_read(tmp_path: Path, kind: str, name: str) -> None:
    NOT_FILES[kind](tmp_path / name)
    reads: Callable[[Path], object]
    if name == "p.pkl":
        reads = partial(read_sb3, FILES / "ppo.zip")
    else:
        reads = read_onnx if name == "p.onnx" else read_sb3
    with pytest.raises(SoterError) as caught:
        reads(tmp_path / name)
    assert caught.value.diagnostics[0].code == "X003"
