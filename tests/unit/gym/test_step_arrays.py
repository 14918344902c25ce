"""Arrays of a step: C reads those that it can where they lie, Python converts the others."""

from __future__ import annotations

import array
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import pytest
from gym_cart import CART, Cart  # type: ignore[import-not-found]

from soter.diagnostics.diagnostic import SoterError
from soter.gym import Protected
from soter.gym.session import NO_NUMBERS
from tables import all_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    Made = Callable[[npt.NDArray[np.float32]], Any]

READ: dict[str, Made] = {
    "float32": lambda a: a,
    "float64": np.float64,
    "a class of its own": lambda a: a.view(np.recarray),
    "gaps": lambda a: np.repeat(a, 3)[::3],
    "backwards": lambda a: a[::-1].copy()[::-1],
    "read-only": lambda a: np.frombuffer(a.tobytes(), a.dtype),
    "array.array": lambda a: array.array("f", a),
    "memoryview": lambda a: memoryview(a.data),
}
CONVERTED: dict[str, Made] = {
    "unaligned": lambda a: np.frombuffer(b"x" + a.tobytes(), a.dtype, offset=1),
    "bytes swapped": lambda a: a.astype(a.dtype.newbyteorder()),
    "long double": np.longdouble,
    "objects": lambda a: a.astype(object),
    "list": lambda a: a.tolist(),
    "tuple": tuple,
}


class Shows(Cart):  # type: ignore[misc]
    """A cart whose observations are `made` of float32."""

    def __init__(self, made: Made) -> None:
        super().__init__()
        self.made = made

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        seen, *others = super().step(action)
        return (self.made(np.float32(seen)), *others)


@all_rows("made", [*READ.values(), *CONVERTED.values()], ids=[*READ, *CONVERTED])
def test_arrays_mean_their_numbers_however_they_lie(made: Made) -> None:
    env, plain = (Protected(CART, Shows(m), alarm=False) for m in (made, np.float64))
    env.reset(seed=3)
    plain.reset(seed=3)
    for wish in np.random.default_rng(1).uniform(-3.1, 3.1, (300, 1)).astype(np.float32):
        seen, *_, info = env.step(made(wish))
        expected, *_, other = plain.step(np.float64(wish))
        assert np.asarray(seen, dtype=np.float64).tolist() == expected.tolist()
        assert env.session.state.tobytes() == plain.session.state.tobytes()
        assert (info["cause"], info["margin"]) == (other["cause"], other["margin"])


@pytest.mark.parametrize(("arrays", "read"), [(READ, True), (CONVERTED, False)])
def test_what_c_does_not_read_has_no_effect(arrays: dict[str, Made], read: bool) -> None:
    for name, made in arrays.items():
        session = fresh()
        before = session.state.tobytes()
        due = session.act_directly(made(np.array([1.5], dtype=np.float32)))
        assert (due != NO_NUMBERS) == read, name
        assert (session.state.tobytes() != before) == read, name
        assert session.action.tolist() == [1.5 if read else 0.0], name


@all_rows(
    "other",
    [
        None,
        1.0,
        "1.0",
        b"12345678",
        object,
        np.float32(1.0),
        np.zeros(0),
        np.zeros(3),
        np.zeros((1, 1)),
        np.array(1.0),
        np.ones(1, dtype=np.int64),
        np.ones(1, dtype=np.float16),
        np.ones(1, dtype=np.complex128),
        np.zeros(1, dtype=[("f", np.float64)]),
    ],
    ids=repr,
)
def test_anything_else_is_not_read_and_leaves_no_error_behind(other: Any) -> None:
    session = fresh()
    before = session.state.tobytes()
    assert session.act_directly(other) == NO_NUMBERS
    assert session.move_directly(other) == NO_NUMBERS
    assert session.state.tobytes() == before


@pytest.mark.parametrize("numbers", [[1.5], [1.5, 1.5, 1.5]])
def test_arrays_are_let_go_of(numbers: list[float]) -> None:
    given = array.array("d", numbers)
    session = fresh()
    session.act_directly(given)
    given.append(2.0)  # BufferError, were it still looked at


def test_a_view_that_was_closed_is_an_error() -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    closed = memoryview(np.ones(1).data)
    closed.release()
    with pytest.raises(ValueError, match="released memoryview"):
        env.step(closed)


def test_an_observation_of_another_length_is_said_after_steps_that_fitted() -> None:
    wide = [False]

    class Widens(Cart):  # type: ignore[misc]
        def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
            seen, *others = super().step(action)
            return (np.append(seen, 0.0) if wide[0] else seen, *others)

    env = Protected(CART, Widens())
    env.reset(seed=1)
    for _ in range(5):
        env.step(np.ones(1))
    wide[0] = True
    with pytest.raises(SoterError, match="3 numbers"):
        env.step(np.ones(1))


def fresh() -> Any:
    """A session whose agent is due."""
    env = Protected(CART, Cart())
    env.reset(seed=1)
    return env.guard.session


NO_NUMBER: dict[str, Any] = {
    "text": "left",
    "a number as text": ["0.5"],
    "a mapping": {"accel": 0.5},
    "complex": [0.5 + 1j],
    "too large": [10**400],
    "ragged": [[1.0], [1.0, 2.0]],
    "a date": np.array(["2026-01-01"], dtype="datetime64[D]"),
}


@pytest.mark.parametrize("action", NO_NUMBER.values(), ids=NO_NUMBER.keys())
def test_what_is_no_array_of_numbers_is_the_callers_mistake(action: Any) -> None:
    env = Protected(CART, Cart())
    env.reset(seed=1)
    with pytest.raises(SoterError, match="an action is no array of numbers") as raised:
        env.step(action)
    assert raised.value.diagnostics[0].code == "U001"
    assert env.step(np.ones(1))[-1]["cause"] is None, "the step was not taken"


@pytest.mark.filterwarnings("ignore:.*Traceback:UserWarning")
@pytest.mark.filterwarnings("ignore:.*Received the following error:UserWarning")
@pytest.mark.filterwarnings("ignore:.*Raising the last exception:UserWarning")
def test_a_mistake_in_a_process_is_the_same_mistake_outside() -> None:
    env = gymnasium.vector.AsyncVectorEnv([lambda: Protected(CART, Cart())] * 2)
    env.reset(seed=1)
    with pytest.raises(SoterError, match="2 numbers"):
        env.step(np.zeros((2, 2), dtype=np.float32))
    env.close(terminate=True)
