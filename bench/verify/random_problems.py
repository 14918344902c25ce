"""Random verification problems: a Soter text, and the same plant and law in NumPy.

Purpose: `problem(number)`: double integrators, lags, a pole, maps, one to three states; random
gains, delays, errors, disturbances, periods and jitters, all of them declared in the text. The
NumPy side is exact for linear plants (zero-order hold a tick) and RK4 for the others; it
knows nothing of the engine.
Non-goals: being easy to prove; many are not, and then nothing is claimed about them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

FAMILIES = ("integrator", "tank", "lag", "pole", "chain", "map1", "map2", "swing")


@dataclass
class RandomProblem:
    """One problem. Times in ticks (1 ms for flows, one step for maps)."""

    number: int
    family: str
    states: int
    is_map: bool
    a: Array
    """(n, n): the linear part of x' or of next x."""
    bend: Array
    """(n,): the nonlinear term on the last state is bend[i] * x0 * (1 - x0^2 / 6)."""
    drag: float
    """-drag * x_last * |x_last| on the last state."""
    b: Array
    gain: Array
    """u = clamp(-gain y, -force, force)."""
    force: float
    control: float
    wind: Array
    """Bound of the disturbance on each state; 0: none."""
    error: Array
    box: Array
    """C is |x_i| < box_i."""
    cells: tuple[int, ...]
    sc_period: int
    dm_period: int
    plant_period: int
    age: int
    late_dm: int
    late_sc: int
    response_dm: int
    response_sc: int
    acts: int
    horizon: int = 0
    """Declared H in ns; 0: H*."""
    _steps: dict[int, tuple[Array, Array]] = field(default_factory=dict, init=False)

    @property
    def d(self) -> int:
        """How old the state may be that a command answers."""
        return self.age + self.response_sc + self.acts

    @property
    def j(self) -> int:
        """Jitter of acting."""
        return self.late_sc + self.response_sc + self.acts

    # ------------------------------------------------------------ NumPy

    def move(self, x: Array, u: Array, w: Array, ticks: int = 1) -> Array:
        """States (n, runs) a tick later (`ticks` = -1: earlier) under u (runs,) and w (n, runs)."""
        if self.is_map:
            return np.clip(self._rate(x, u, w), -1e6, 1e6)
        h = 1e-3 * ticks
        if self.drag == 0.0 and not self.bend.any():
            phi, gamma = self._exact(ticks)
            return phi @ x + gamma @ (self.b[:, None] * u + w)
        k1 = self._rate(x, u, w)
        k2 = self._rate(x + 0.5 * h * k1, u, w)
        k3 = self._rate(x + 0.5 * h * k2, u, w)
        k4 = self._rate(x + h * k3, u, w)
        return np.clip(x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4), -1e6, 1e6)

    def _rate(self, x: Array, u: Array, w: Array) -> Array:
        rate = self.a @ x + self.b[:, None] * u + w
        if self.drag or self.bend.any():
            last = x[-1]
            bent = self.bend[-1] * x[0] * (1.0 - x[0] * x[0] / 6.0)
            rate[-1] += bent - self.drag * last * np.abs(last)
        return rate

    def _exact(self, ticks: int) -> tuple[Array, Array]:
        if ticks not in self._steps:
            h, n = 1e-3 * ticks, self.states
            phi, gamma, term = np.eye(n), np.eye(n) * h, np.eye(n)
            for k in range(1, 25):
                term = term @ self.a * (h / k)
                phi = phi + term
                gamma = gamma + term * (h / (k + 1))
            self._steps[ticks] = (phi, gamma)
        return self._steps[ticks]

    def law(self, y: Array) -> Array:
        """SC's command on estimates (n, runs)."""
        return np.clip(-(self.gain @ y), -self.force, self.force)

    def safe(self, x: Array, slack: float = 1e-9) -> npt.NDArray[np.bool_]:
        """Whether states lie in C."""
        inside: npt.NDArray[np.bool_] = np.all(np.abs(x) < self.box[:, None] + slack, axis=0)
        return inside

    def surely_lost(self, x: Array) -> npt.NDArray[np.bool_]:
        """Closed form: no law whatever keeps these in C against the worst disturbance.

        Only for the double integrator: braking as hard as the set of controls allows.
        """
        if self.family != "integrator" or self.wind[0]:
            return np.zeros(x.shape[1], dtype=bool)
        brake = self.control - self.wind[1]
        stop = x[1] * x[1] / (2.0 * brake) if brake > 0.0 else np.full(x.shape[1], np.inf)
        lost: npt.NDArray[np.bool_] = np.sign(x[1]) * x[0] + stop > self.box[0] + 1e-9
        return lost

    # ------------------------------------------------------------ text

    @property
    def text(self) -> str:
        """The program."""
        n = range(self.states)
        unit = "s" if self.is_map else "ms"
        age = " max_age 900ms" if self.is_map else f" max_age {self.age}ms"
        fields = ", ".join(f"x{i}: float" for i in n)
        values = ", ".join(f"x{i}: x{i}" for i in n)
        rates = "\n".join(
            f"  {'next' if self.is_map else 'der'} x{i} = {self._rate_text(i)};" for i in n
        )
        wind = "\n".join(
            f"  disturbance w{i}: float in [{-float(self.wind[i])!r}, {float(self.wind[i])!r}];"
            for i in n
            if self.wind[i]
        )
        measured = ", ".join(f"y.x{i} within {float(self.error[i])!r}" for i in n if self.error[i])
        grid = ", ".join(
            f"y.x{i} in [{-float(self.box[i])!r}, {float(self.box[i])!r}] / {self.cells[i]}"
            for i in n
        )
        delays = f"\n    horizon {self.horizon}ns;" if self.horizon else ""
        delays += (
            ""
            if self.is_map
            else f"""
    late dm {self.late_dm}ms, sc {self.late_sc}ms;
    response dm {self.response_dm}ms, sc {self.response_sc}ms;
    acts within {self.acts}ms;"""
        )
        return f"""soter 1;
topic y: {{ {fields} }}{age};
topic u: float in [{-self.control!r}, {self.control!r}] = 0.0;
plant P period {self.plant_period}{unit} {{
  reads u;
  drives y = {{ {values} }};
{chr(10).join(f"  state x{i}: float = 0.0;" for i in n)}
{wind}
{rates}
{f"  measured {measured};" if measured else ""}
}}
node Ac period {self.sc_period}{unit} {{ publishes u; step {{ publish u = {self.control!r}; }} }}
node Sc period {self.sc_period}{unit} {{
  subscribes y;
  publishes u;
  step {{ publish u = clamp({self._law_text()}, {-self.force!r}, {self.force!r}); }}
}}
rta M {{
  ac Ac;
  sc Sc;
  period {self.dm_period}{unit};
  safe {" && ".join(f"abs(y.x{i}) < {float(self.box[i])!r}" for i in n)};
  verify {{
    grid {grid};{delays}
  }}
}}
system S {{ p: P; module M; until 10s; }}
"""

    def _rate_text(self, i: int) -> str:
        terms = [f"{float(self.a[i, k])!r} * x{k}" for k in range(self.states) if self.a[i, k]]
        terms += [f"{float(self.b[i])!r} * u"] if self.b[i] else []
        terms += [f"w{i}"] if self.wind[i] else []
        if i == self.states - 1:
            if self.bend[i]:
                terms.append(f"{float(self.bend[i])!r} * x0 * (1.0 - x0 * x0 / 6.0)")
            if self.drag:
                terms.append(f"-{self.drag!r} * x{i} * abs(x{i})")
        return " + ".join(terms) or "0.0"

    def _law_text(self) -> str:
        return "-(" + " + ".join(f"{float(k)!r} * y.x{i}" for i, k in enumerate(self.gain)) + ")"


def problem(number: int) -> RandomProblem:
    """Problem number `number`."""
    rng = np.random.default_rng([2026, number])
    family = FAMILIES[number % len(FAMILIES)]
    return replace(_MAKERS[family](rng), number=number, family=family)


# ---------------------------------------------------------------- families


def _round(x: float) -> float:
    return float(f"{x:.3g}")


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return _round(float(np.exp(rng.uniform(np.log(low), np.log(high)))))


def _drawn(
    rng: np.random.Generator,
    a: list[list[float]],
    b: list[float],
    gain: list[float],
    control: float,
    wind: list[float],
    box: list[float],
    cells: tuple[int, ...],
    bend: float = 0.0,
    drag: float = 0.0,
    *,
    is_map: bool = False,
) -> RandomProblem:
    """A problem of this plant, with errors and times at random; its family is filled in later."""
    n = len(a)
    sc = 1 if is_map else int(rng.choice([10, 20, 40]))
    error = [_round(x * rng.choice([0.0, 0.002, 0.01])) for x in box]
    weaker = 1.0 if is_map or rng.random() < 0.7 else 0.8
    times = (1, int(rng.choice([1, 2, 3])), 1, 0, 0, 0, 0, 0, 0) if is_map else _times(rng, sc)
    return RandomProblem(
        0,
        "",
        n,
        is_map,
        np.array(a),
        np.array([0.0] * (n - 1) + [bend]),
        drag,
        np.array(b),
        np.array([_round(k) for k in gain]),
        _round(weaker * control),
        control,
        np.array(wind),
        np.array(error),
        np.array(box),
        cells,
        *times,
    )


def _times(rng: np.random.Generator, sc: int) -> tuple[int, ...]:
    """The times of a flow, in the order of `RandomProblem`."""
    tiny = [0, 1, 2] if sc <= 10 else [0, 1, 3]
    plant = int(rng.choice([5, 10]))
    dm, age = sc * int(rng.choice([1, 2, 5])), plant + int(rng.choice([0, 5, 20, 100]))
    late = (int(rng.choice(most)) for most in (tiny, tiny, tiny, [0, 1], [0, 1]))
    return (sc, dm, plant, age, *late)


def _integrator(rng: np.random.Generator) -> RandomProblem:
    control = _between(rng, 1.0, 8.0)
    speed = _between(rng, 0.8, 4.0)
    wind = _round(control * rng.choice([0.02, 0.1, 0.2]))
    p, v = 1.5, _round(np.sqrt(3.0 * control) * 1.05)
    return _drawn(
        rng,
        [[0.0, 1.0], [0.0, 0.0]],
        [0.0, 1.0],
        [speed * speed, 2.0 * rng.uniform(0.7, 1.6) * speed],
        control,
        [0.0, wind],
        [p, v],
        (80, 80),
    )


def _tank(rng: np.random.Generator) -> RandomProblem:
    control = _between(rng, 0.2, 2.0)
    wind = _round(control * rng.choice([0.1, 0.4, 0.8]))
    gain = _between(rng, 0.5, 20.0)
    return _drawn(rng, [[0.0]], [1.0], [gain], control, [wind], [1.0], (400,))


def _lag(rng: np.random.Generator) -> RandomProblem:
    rate = _between(rng, 2.0, 20.0)
    control = _between(rng, 0.5, 2.0)
    wind = _round(0.3 * control * rng.uniform(0.1, 1.0))
    return _drawn(
        rng,
        [[0.0, 1.0], [0.0, -rate]],
        [0.0, rate],
        [_between(rng, 0.3, 3.0), _round(rng.uniform(-0.2, 0.6))],
        control,
        [wind, 0.0],
        [1.0, _round(1.1 * control)],
        (100, 60),
    )


def _pole(rng: np.random.Generator) -> RandomProblem:
    bend = _between(rng, 0.5, 6.0)
    control = _round(bend + _between(rng, 1.0, 8.0))
    kp = bend * rng.uniform(1.0, 3.0) + 2.0
    return _drawn(
        rng,
        [[0.0, 1.0], [0.0, 0.0]],
        [0.0, 1.0],
        [kp, 2.0 * np.sqrt(kp) * rng.uniform(0.5, 1.2)],
        control,
        [0.0, _round(0.1 * rng.uniform(0.1, 1.0) * control)],
        [0.8, _round(1.1 * np.sqrt(1.6 * control))],
        (80, 80),
        bend=bend,
        drag=_between(rng, 0.05, 0.5),
    )


def _swing(rng: np.random.Generator) -> RandomProblem:
    bend = -_between(rng, 1.0, 9.0)
    control = _between(rng, 1.0, 4.0)
    return _drawn(
        rng,
        [[0.0, 1.0], [0.0, -_between(rng, 0.05, 0.5)]],
        [0.0, 1.0],
        [0.0, _between(rng, 0.5, 5.0)],
        control,
        [0.0, _round(0.2 * rng.uniform(0.1, 1.0) * control)],
        [1.0, _round(1.2 * np.sqrt(-bend))],
        (80, 80),
        bend=bend,
        drag=_between(rng, 0.05, 0.3),
    )


def _chain(rng: np.random.Generator) -> RandomProblem:
    """Position, speed, lagged acceleration."""
    rate = _between(rng, 8.0, 25.0)
    control = _between(rng, 1.0, 4.0)
    speed = _between(rng, 0.6, 1.6)
    return _drawn(
        rng,
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -rate]],
        [0.0, 0.0, rate],
        [speed**2, 2.2 * speed, 0.1],
        control,
        [0.0, _round(0.05 * control), 0.0],
        [3.0, _round(np.sqrt(6.0 * control)), _round(1.05 * control)],
        (60, 60, 20),
    )


def _map1(rng: np.random.Generator) -> RandomProblem:
    grow = _round(rng.uniform(0.7, 1.3))
    control = _between(rng, 0.1, 0.5)
    wind = _round(0.3 * rng.uniform(0.1, 1.0) * control)
    gain = grow * rng.uniform(0.5, 1.3)
    return _drawn(rng, [[grow]], [1.0], [gain], control, [wind], [1.0], (400,), is_map=True)


def _map2(rng: np.random.Generator) -> RandomProblem:
    keep = _round(rng.uniform(0.6, 1.0))
    control = _between(rng, 0.05, 0.2)
    bend = float(rng.choice([0.0, 0.0, 0.02, -0.05]))
    kp = rng.uniform(0.05, 0.3)
    return _drawn(
        rng,
        [[1.0, 0.5], [0.0, keep]],
        [0.0, 1.0],
        [kp, keep - rng.uniform(0.2, 0.6)],
        control,
        [0.0, _round(0.2 * rng.uniform(0.1, 1.0) * control)],
        [1.0, _round(0.9 * np.sqrt(4.0 * control))],
        (100, 100),
        bend=bend,
        is_map=True,
    )


_MAKERS = {
    "integrator": _integrator,
    "tank": _tank,
    "lag": _lag,
    "pole": _pole,
    "chain": _chain,
    "map1": _map1,
    "map2": _map2,
    "swing": _swing,
}
