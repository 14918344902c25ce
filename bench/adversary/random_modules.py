"""Random modules: a Soter text and, from the same numbers, the adversary's closed loop.

Purpose: `Module`, its text, its `Machine`; nothing of what is simulated is read off the text or
comes from the prover, but for computed predicates, which are tables of the program.
Non-goals: which numbers (`module_families.py`), verdicts (`against_proofs.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from bench.adversary.closed_loop import AXES, Machine, N, U

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]
    Levels = npt.NDArray[np.uint8]

DRAG, BEND = 1, 2
"""Terms k x|x| and k x (1 - x^2 / 6)."""
SUBSTEPS = 2


@dataclass(frozen=True)
class Times:
    """All in ticks; phases of plant and DM are zero in the language."""

    dm: int
    sc: int
    sensor: int
    max_age: int
    sc_phase: int = 0
    late_dm: int = 0
    late_sc: int = 0
    response_dm: int = 0
    response_sc: int = 0
    acts: int = 0
    dropout: int = 0

    @property
    def jitter(self) -> int:
        """An upper bound of j, waiting for the DM at any phase included."""
        hand_over = max(self.late_sc, self.late_dm + self.response_dm)
        return hand_over + self.response_sc + self.acts


@dataclass(frozen=True)
class PathNode:
    """A node between sensor and module; in ticks."""

    period: int
    phase: int = 0
    late: int = 0
    response: int = 0


@dataclass(frozen=True)
class Face:
    """|a x + bend x1|x1|| < limit."""

    a: tuple[float, ...]
    bend: float
    limit: float

    def text(self) -> str:
        """The bounded expression."""
        terms = [f"{v!r} * y.x{i}" for i, v in enumerate(self.a) if v]
        if self.bend:
            terms.append(f"{self.bend!r} * y.x1 * abs(y.x1)")
        return f"abs({' + '.join(terms)})"


@dataclass(frozen=True)
class Module:
    """One module. `gain[l][k]`: law l, control k; laws take turns in a bounded local of SC."""

    seed: int
    family: str
    a: tuple[tuple[float, ...], ...]
    b: tuple[tuple[float, ...], ...]
    gain: tuple[tuple[tuple[float, ...], ...], ...]
    force: tuple[float, ...]
    control: tuple[float, ...]
    wind: tuple[float, ...]
    error: tuple[float, ...]
    box: tuple[float, ...]
    times: Times
    cells: tuple[int, ...] = ()
    terms: tuple[tuple[int, int, int, float], ...] = ()
    """(kind, of state, to state, factor)."""
    first: tuple[float, ...] = ()
    """Defaults of the controls."""
    start: tuple[float, ...] = ()
    """The start is anywhere in +- this."""
    ttf: tuple[Face, ...] = ()
    """Empty: computed."""
    safer: tuple[Face, ...] = ()
    nodes: tuple[PathNode, ...] = ()
    drivers: tuple[PathNode, ...] = ()
    """Nodes between the module and the plant that flies."""
    bias: tuple[float, ...] = ()
    """What SC adds to each control, so that it answers zero by something else."""
    is_map: bool = False
    tick_us: int = 1000
    levels: int = 3
    shield: int = 0
    """Cells of each command; 0: no shield."""
    toward: bool = False
    """Whether commands are moved toward SC's."""
    apart: bool = False
    """Every state has a grid of its own."""
    in_step: bool = False
    """Nodes behind the module run in its thread, look at the sensor, and show what they pass on."""

    @property
    def n(self) -> int:
        """States."""
        return len(self.a)

    @property
    def m(self) -> int:
        """Controls."""
        return len(self.force)

    @property
    def defaults(self) -> tuple[float, ...]:
        """Of the controls."""
        return self.first or (0.0,) * self.m

    @property
    def starts(self) -> tuple[float, ...]:
        """Half-widths of the start."""
        return self.start or (0.0,) * self.n

    # ------------------------------------------------------------ text

    def _shield(self) -> str:
        toward = " toward sc" if self.toward else ""
        return f"  shield {self.shield}{toward};" if self.shield else ""

    def ticks(self, k: int) -> str:
        """A time as text."""
        return f"{k * self.tick_us}us"

    @property
    def text(self) -> str:
        """The program."""
        n = range(self.n)
        fields = ", ".join(f"x{i}: float" for i in n)
        t = self.times
        flies = self._plant("P", "z0" if self.nodes else "y", f"v{len(self.drivers)}_")
        raw = "\n".join(f"topic z{k}: {{ {fields} }};" for k in range(len(self.nodes)))
        chain = "\n".join(self._node(k) for k in range(len(self.nodes)))
        beside = "".join(f" node N{k};" for k in range(len(self.nodes)))
        beside += "".join(f" node D{k};" for k in range(len(self.drivers)))
        chain += "\n".join(self._driver(k) for k in range(len(self.drivers)))
        # a map's state is read in the instant in which it is published
        age = f"{self.tick_us // 2}us" if self.is_map else self.ticks(t.max_age)
        return f"""soter 1;
{raw}
topic y: {{ {fields} }} max_age {age};
{self._controls()}
{flies}
{self._plant("Q", "y") if self.abstract else ""}
{chain}
node Ac period {self.ticks(1)} {{ publishes {self._us()}; step {{ {self._publish("ac")} }} }}
{self._sc()}
rta M {{
  ac Ac;
  sc Sc;
  period {self.ticks(t.dm)};
  safe {" && ".join(f"abs(y.x{i}) < {self.box[i]!r}" for i in n)};
{self._predicates()}{self._shield()}
  verify {{
    {self._grid()}
{self._delays()}  }}
}}
system S {{ p: P; module M;{beside} until 10s; }}
"""

    @property
    def abstract(self) -> bool:
        """Whether there are nodes on the way, and so another plant that is proved."""
        return bool(self.nodes or self.drivers)

    def _us(self, word: str = "u") -> str:
        return ", ".join(f"{word}{k}" for k in range(self.m))

    def _controls(self) -> str:
        words = ["u", *(f"v{i + 1}_" for i in range(len(self.drivers)))]
        return "\n".join(
            f"topic {w}{k}: float in [{-c!r}, {c!r}] = {self.defaults[k]!r};"
            for w in words
            for k, c in enumerate(self.control)
        )

    def _driver(self, i: int) -> str:
        node, read = self.drivers[i], f"v{i}_" if i else "u"
        phase = f" phase {self.ticks(node.phase)}" if node.phase else ""
        looks, seen = ("y.x0 > 1.0e9 ? 0.0 : ", ", y") if self.in_step else ("", "")
        step = " ".join(f"publish v{i + 1}_{k} = {looks}{read}{k};" for k in range(self.m))
        return (
            f"node D{i} period {self.ticks(node.period)}{phase} {{ "
            f"subscribes {self._us(read)}{seen}; "
            f"publishes {self._us(f'v{i + 1}_')}; step {{ {step} }} }}"
        )

    def _plant(self, name: str, topic: str, word: str = "u") -> str:
        u = "u" if word == "v0_" else word
        n = range(self.n)
        states = "\n".join(
            f"  state x{i}: float in [{-s!r}, {s!r}];" if s else f"  state x{i}: float = 0.0;"
            for i, s in enumerate(self.starts)
        )
        winds = "\n".join(
            f"  disturbance w{i}: float in [{-w!r}, {w!r}];" for i, w in enumerate(self.wind) if w
        )
        moves = "next" if self.is_map else "der"
        rates = "\n".join(f"  {moves} x{i} = {self._rate(i, u)};" for i in n)
        measured = ", ".join(f"{topic}.x{i} within {e!r}" for i, e in enumerate(self.error) if e)
        values = ", ".join(f"x{i}: x{i}" for i in n)
        return f"""plant {name} period {self.ticks(self.times.sensor)} {{
  reads {self._us(u)};
  drives {topic} = {{ {values} }};
{states}
{winds}
{rates}
{f"  measured {measured};" if measured else ""}
}}"""

    def _rate(self, i: int, u: str) -> str:
        summands = [f"{v!r} * x{k}" for k, v in enumerate(self.a[i]) if v]
        summands += [f"{v!r} * {u}{k}" for k, v in enumerate(self.b[i]) if v]
        summands += [f"w{i}"] if self.wind[i] else []
        for kind, of, to, factor in self.terms:
            if to == i:
                f = f"abs(x{of})" if kind == DRAG else f"(1.0 - x{of} * x{of} / 6.0)"
                summands.append(f"{factor!r} * x{of} * {f}")
        return " + ".join(summands) or "0.0"

    def _node(self, k: int) -> str:
        node, to = self.nodes[k], "y" if k + 1 == len(self.nodes) else f"z{k + 1}"
        phase = f" phase {self.ticks(node.phase)}" if node.phase else ""
        return (
            f"node N{k} period {self.ticks(node.period)}{phase} "
            f"{{ subscribes z{k}; publishes {to}; step {{ publish {to} = z{k}; }} }}"
        )

    def _publish(self, who: str) -> str:
        if who == "ac":
            return " ".join(f"publish u{k} = {c!r};" for k, c in enumerate(self.control))
        statements = []
        for k in range(self.m):
            bias = self.bias[k] if self.bias else 0.0
            laws = [self._law(law[k], self.force[k], bias) for law in self.gain]
            value = laws[0] if len(laws) == 1 else f"turn ? {laws[1]} : {laws[0]}"
            statements.append(f"publish u{k} = {value};")
        return " ".join(statements)

    def _law(self, row: tuple[float, ...], force: float, bias: float) -> str:
        terms = " + ".join(f"{v!r} * y.x{i}" for i, v in enumerate(row) if v) or "0.0"
        value = f"{bias!r} - ({terms})" if bias else f"-({terms})"
        return f"clamp({value}, {-force!r}, {force!r})"

    def _sc(self) -> str:
        phase = f" phase {self.ticks(self.times.sc_phase)}" if self.times.sc_phase else ""
        turns = len(self.gain) > 1
        return f"""node Sc period {self.ticks(self.times.sc)}{phase} {{
  subscribes y;
  publishes {self._us()};
{"  var turn: bool = false;" if turns else ""}
  step {{ {self._publish("sc")}{" turn = !turn;" if turns else ""} }}
}}"""

    def _predicates(self) -> str:
        if not self.ttf:
            return ""
        ttf = " || ".join(f"{f.text()} >= {f.limit!r}" for f in self.ttf)
        safer = " && ".join(f"{f.text()} < {f.limit!r}" for f in self.safer)
        return f"  ttf {ttf};\n  safer {safer};\n"

    def _grid(self) -> str:
        at = "q" if self.abstract else "y"
        both = enumerate(zip(self.box, self.cells, strict=True))
        ranges = [f"{at}.x{i} in [{-c!r}, {c!r}] / {n}" for i, (c, n) in both]
        clause = f"grid {', '.join(ranges)};"
        if self.apart:
            clause = " ".join(f"grid {r};" for r in ranges)
        if self.abstract:
            shown = " + 0.0 * v1_0" if self.in_step else ""
            values = ", ".join(f"x{i}: p.truth.x{i}{shown}" for i in range(self.n))
            clause += f"\n    abstracts p by q: Q = {{ {values} }};"
        return clause

    def _delays(self) -> str:
        if self.is_map:
            return ""
        t = self.times
        late = [f"dm {self.ticks(t.late_dm)}", f"sc {self.ticks(t.late_sc)}"]
        took = [f"dm {self.ticks(t.response_dm)}", f"sc {self.ticks(t.response_sc)}"]
        for k, node in enumerate(self.nodes):
            late.append(f"N{k} {self.ticks(node.late)}")
            took.append(f"N{k} {self.ticks(node.response)}")
        for k, node in enumerate(() if self.in_step else self.drivers):
            late.append(f"D{k} {self.ticks(node.late)}")
            took.append(f"D{k} {self.ticks(node.response)}")
        clauses = f"    late {', '.join(late)};\n    response {', '.join(took)};\n"
        clauses += f"    acts within {self.ticks(t.acts)};\n"
        clauses += f"    dropout {self.ticks(t.dropout)};\n" if t.dropout else ""
        clauses += f"    levels {self.levels};\n" if self.levels != 3 and not self.ttf else ""
        return clauses

    # ------------------------------------------------------------ the adversary's loop

    def exact(self, seconds: float) -> tuple[Array, Array]:
        """(e^{A h}, the integral of it) of the linear part."""
        a = np.array(self.a)
        pieces = max(1, int(np.ceil(np.abs(a).sum(axis=1).max() * seconds * 2)))
        h = seconds / pieces
        phi, gamma, term = np.eye(self.n), np.eye(self.n) * h, np.eye(self.n)
        for k in range(1, 22):
            term = term @ a * (h / k)
            phi = phi + term
            gamma = gamma + term * (h / (k + 1))
        whole: Array = np.eye(self.n)
        total: Array = np.zeros((self.n, self.n))
        for _ in range(pieces):
            total = gamma + phi @ total
            whole = phi @ whole
        return whole, total

    def machine(self) -> Machine:
        """The closed loop, predicates excepted where they are computed."""
        machine = Machine()
        c, t = machine.c, self.times
        seconds = self.tick_us * 1e-6
        c.n, c.m, c.linear, c.is_map = self.n, self.m, int(not self.terms), int(self.is_map)
        c.substeps, c.terms, c.laws, c.h = SUBSTEPS, len(self.terms), len(self.gain), seconds
        for i, (kind, of, to, factor) in enumerate(self.terms):
            c.term_kind[i], c.term_of[i], c.term_to[i], c.term_k[i] = kind, of, to, factor
        machine.fill("a", np.array(self.a), N)
        machine.fill("b", np.array(self.b), U)
        if not self.is_map:
            phi, gamma = self.exact(seconds)
            machine.fill("phi", phi, N)
            machine.fill("gam_u", gamma @ np.array(self.b), U)
            machine.fill("gam_w", gamma, N)
        machine.fill("u_low", [-v for v in self.control])
        machine.fill("u_high", self.control)
        machine.fill("u_first", self.defaults)
        machine.fill("wind", self.wind)
        machine.fill("error", self.error)
        machine.fill("low", [-v for v in self.box])
        machine.fill("high", self.box)
        machine.fill("force", self.force)
        machine.fill("bias", self.bias)
        for law, rows in enumerate(self.gain):
            for k, row in enumerate(rows):
                for i, v in enumerate(row):
                    c.gain[(law * U + k) * N + i] = v
        c.dm_period, c.sc_period, c.sc_phase, c.sensor_period = t.dm, t.sc, t.sc_phase, t.sensor
        c.j_dm, c.r_dm, c.j_sc, c.r_sc = t.late_dm, t.response_dm, t.late_sc, t.response_sc
        for k in range(self.m):
            c.acts[k] = t.acts
        c.drivers, c.in_step = len(self.drivers), int(self.in_step)
        for k, node in enumerate(self.drivers):
            c.driver_period[k], c.driver_phase[k] = node.period, node.phase
            c.driver_j[k], c.driver_r[k] = node.late, node.response
        c.max_age, c.dropout, c.nodes = t.max_age, t.dropout, len(self.nodes)
        for k, node in enumerate(self.nodes):
            c.node_period[k], c.node_phase[k] = node.period, node.phase
            c.node_j[k], c.node_r[k] = node.late, node.response
        for which, faces in enumerate((self.ttf, self.safer)):
            rows_of = [(*f.a, f.bend, f.limit) for f in faces]
            rows_of += [(*(-v for v in f.a), -f.bend, f.limit) for f in faces]
            c.faces[which] = len(rows_of)
            c.face[which] = machine.pointer(np.array(rows_of))
        self._directions(machine)
        return machine

    def _closed(self) -> Array:
        return np.asarray(np.array(self.a) - np.array(self.b) @ np.array(self.gain[0]))

    def _directions(self, machine: Machine) -> None:
        """Co-states of the faces over several times, and gradients of quadratic forms."""
        h = self.tick_us * 1e-6
        horizons = (0, self.times.sc, self.times.dm + self.times.sc, 4 * self.times.dm)
        rows = []
        for steps in horizons:
            if self.is_map:
                whole = np.linalg.matrix_power(np.array(self.a), steps)
            else:
                whole, _ = self.exact(steps * h)
            rows += [whole[i] / self.box[i] for i in range(self.n)]
        unique = [r for i, r in enumerate(rows) if not any(np.allclose(r, q) for q in rows[:i])]
        padded = np.zeros((len(unique), N))
        padded[:, : self.n] = unique
        machine.c.rows = len(unique)
        machine.c.row = machine.pointer(padded)
        grads = [g for a in (np.array(self.a), self._closed()) if (g := self._form(a)) is not None]
        grads.append(np.diag(1.0 / np.array(self.box) ** 2))
        full = np.zeros((len(grads), N, N))
        full[:, : self.n, : self.n] = grads
        machine.c.grads = len(grads)
        machine.c.grad = machine.pointer(full)

    def _form(self, a: Array) -> Array | None:
        """P of A'P + PA = -I for A moved far enough to the left; of the flow."""
        if self.is_map:
            return None
        n = self.n
        shift = max(0.0, float(np.linalg.eigvals(a).real.max())) + 0.05 * np.linalg.norm(a) + 1e-3
        a = a - shift * np.eye(n)
        big = np.kron(np.eye(n), a.T) + np.kron(a.T, np.eye(n))
        form = np.linalg.solve(big, -np.eye(n).ravel()).reshape(n, n)
        return np.asarray(form / np.linalg.norm(form))


@dataclass(frozen=True)
class GroupOfTables:
    """Computed predicates of a group: its states, the edges of its cells, S_0 and S_(m-2)."""

    states: tuple[int, ...]
    edges: list[Array]
    levels: Levels
    tops: Levels | None = None
    """What a shield permits of the commands `moved`."""
    moved: tuple[int, ...] = ()
    lasting: Levels | None = None
    """Which of them may act for longer."""


def with_tables(machine: Machine, groups: list[GroupOfTables]) -> None:
    """Computed predicates on grids."""
    c = machine.c
    c.pred_tables, c.groups = 1, len(groups)
    for g, group in enumerate(groups):
        c.axes[g], c.moving[g] = len(group.states), len(group.moved)
        for a, (state, e) in enumerate(zip(group.states, group.edges, strict=True)):
            c.axis[g * AXES + a], c.cells[g * AXES + a] = state, len(e) - 1
            c.edges[g * AXES + a] = machine.pointer(e)
        for a, control in enumerate(group.moved):
            c.moved[g * U + a] = control
        c.level[g] = machine.pointer(group.levels, "u1")
        if group.tops is not None:
            c.tops[g] = machine.pointer(group.tops, "u1")
        if group.lasting is not None:
            c.lasting[g] = machine.pointer(group.lasting, "u1")


def declared(module: Module, start: tuple[float, ...]) -> Module:
    """The module with another start."""
    return replace(module, start=start)
