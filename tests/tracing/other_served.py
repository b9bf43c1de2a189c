"""The second plant in the place of a server's own: what stands behind the packets shares no equation with hexsim."""

import numpy as np
from other_equations import PER_LEG, bench_rates, integrate
from other_plant import SUBSTEPS, state_at_rest
from other_plant import Plant as Other

from hexsim import Machine
from hexsim.plant import Plant


class ServedPlant(Plant):
    """A bench. hexsim's sensors read it and its motion computer drives it; effects that know the time or remember the spool
    (tone, drift, delay, hysteresis) begin anew at each tick and are not for it."""

    def __init__(self, machine: Machine, other: Other, **settings) -> None:
        self.other, self.ticks_ms, self.volts = other, 1, np.zeros(1)
        self.state = state_at_rest(other)
        super().__init__(machine, **settings)

    def prepare(self, rate_Hz: float, ticks: int = 0) -> None:
        super().prepare(rate_Hz, ticks)
        self.ticks_ms = round(1e3 / rate_Hz)

    def reset(self) -> None:
        super().reset()
        self.state = state_at_rest(self.other)

    def tick(self, volts, at_spool=None) -> None:
        other, gain = self.other, float(self.other.rig["gain_V_per_m"][0])
        self.volts = np.array(volts, dtype=float)
        for _ in range(self.ticks_ms):  # the plant's own loop gives just these volts
            setpoint = self.state[9] + self.volts[None] / gain
            integrate(
                other.rig, other.legs, other.base, other.joints, self.state, setpoint, np.zeros(1), SUBSTEPS["bench"]
            )

    def piston_positions(self):
        return self.state[9:10].copy()

    def bottom_pressures(self):
        return self.state[0:1].copy()

    def supply_pressure(self) -> float:
        return float(self.state[PER_LEG])

    def instant_acceleration(self):
        rates, found = np.zeros_like(self.state), np.zeros(6)
        bench_rates(self.other.rig[0], self.other.legs, self.state.copy(), self.volts, 0.0, rates, found)
        return found[:1]

    def check(self) -> None:
        if not np.all(np.isfinite(self.state)):
            raise FloatingPointError("the second plant diverged")
