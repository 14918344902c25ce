"""A quadrotor in MuJoCo as an extern plant: what mujoco_quad.soter is answered by.

Purpose: the Iris of iris.soter (mass, inertia, rotors, lags, wind) in somebody else's physics:
MuJoCo's contact-free rigid body, its integrator and its own 1 ms. `QuadInAir` adds what the plant
of the proof has not: MuJoCo's drag of the body's inertia box in air.
Non-goals: errors of the estimate (Soter adds them), ground contact, rendering.

Everything comes from the state that Soter holds, so a copied state goes on identically; the wind
comes from the seed and the number of steps since the reset.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from types import SimpleNamespace

MASS = 1.5
INERTIA = (0.029125, 0.029125, 0.055225)
THRUST = 5.84e-6
MOMENT = 0.06
LAG_UP, LAG_DOWN = 0.0125, 0.025
WIND, WIND_HOLD_STEPS = 0.3, 100
ROTORS = {
    "front_right": (0.13, -0.22, -1.0),
    "rear_left": (-0.13, 0.20, -1.0),
    "front_left": (0.13, 0.22, 1.0),
    "rear_right": (-0.13, -0.20, 1.0),
}
"""Where they are, m, and the sense of their moment."""
PERIOD_S = 0.005
SUBSTEPS = 5
AIR = 1.2
"""kg/m^3"""
VISCOSITY = 1.8e-5


def model_xml(density: float, viscosity: float) -> str:
    """The MJCF of the vehicle: a free body with a motor at each rotor."""
    sites = "".join(f'<site name="{n}" pos="{x} {y} 0"/>' for n, (x, y, _) in ROTORS.items())
    motors = "".join(
        f'<motor site="{n}" gear="0 0 1 0 0 {sense * MOMENT}"/>'
        for n, (_, _, sense) in ROTORS.items()
    )
    inertia = " ".join(map(str, INERTIA))
    return f"""
    <mujoco model="iris">
      <option timestep="{PERIOD_S / SUBSTEPS}" integrator="RK4" gravity="0 0 -9.81"
              density="{density}" viscosity="{viscosity}">
        <flag contact="disable" constraint="disable"/>
      </option>
      <worldbody>
        <body name="iris">
          <freejoint/>
          <inertial pos="0 0 0" mass="{MASS}" diaginertia="{inertia}"/>
          {sites}
        </body>
      </worldbody>
      <actuator>{motors}</actuator>
    </mujoco>"""


class Quad:
    """The vehicle's next state from its state and the rotor commands, 5 ms later."""

    density, viscosity = 0.0, 0.0

    def __init__(self) -> None:
        try:
            import mujoco  # noqa: PLC0415 - the extra `simulators`
        except ImportError as error:
            raise ImportError("MuJoCo is missing: pip install 'soter-rta[simulators]'") from error

        self._step = mujoco.mj_step
        self.model = mujoco.MjModel.from_xml_string(model_xml(self.density, self.viscosity))
        self.data = mujoco.MjData(self.model)
        self._up = 1.0 - math.exp(-PERIOD_S / SUBSTEPS / LAG_UP)
        self._down = 1.0 - math.exp(-PERIOD_S / SUBSTEPS / LAG_DOWN)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Begin a run: the wind from its first draw."""
        self._wind = np.random.default_rng([seed % 2**63, 0x57494E44])
        self._steps = 0

    def step(self, inputs: SimpleNamespace) -> dict[str, Any]:
        """Move MuJoCo's body from the given state."""
        data, state = self.data, inputs.state
        p, v, q, rate = state.p, state.v, state.q, state.rate
        data.qpos[:] = (p.x, p.y, p.z, q.w, q.x, q.y, q.z)
        data.qvel[:] = (v.x, v.y, v.z, rate.x, rate.y, rate.z)
        if self._steps % WIND_HOLD_STEPS == 0:
            data.xfrc_applied[1, :3] = MASS * self._wind.uniform(-WIND, WIND, 3)
        self._steps += 1
        spins = [getattr(state.spin, n) for n in ROTORS]
        wanted = [getattr(inputs.rotors, n) for n in ROTORS]
        for _ in range(SUBSTEPS):
            data.ctrl[:] = [THRUST * w * w for w in spins]
            self._step(self.model, data)
            spins = [w + self._share(to - w) * (to - w) for w, to in zip(spins, wanted)]  # noqa: B905
        at, speed = data.qpos.tolist(), data.qvel.tolist()
        return {
            "p": at[:3],
            "v": speed[:3],
            "q": at[3:],
            "rate": speed[3:],
            "spin": dict(zip(ROTORS, spins)),  # noqa: B905 - four of each
        }

    def _share(self, gap: float) -> float:
        return self._up if gap > 0.0 else self._down


class QuadInAir(Quad):
    """The same in air."""

    density, viscosity = AIR, VISCOSITY
