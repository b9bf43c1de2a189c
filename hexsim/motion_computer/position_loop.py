"""The position loop of the motion computer: six proportional controllers and a compensator slot each.

    u = sat(Kp (setpoint - position) + u_c)          report 2.2.4, compensation of chapter 5 added

Runs at the controller's rate; the volts are held in between (zero-order hold).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from compensation import Compensator, Context, Sample, preview_count
from hexsim.compiled import compiled
from hexsim.declaration import Machine

Array = NDArray[np.float64]


@compiled
def proportional(setpoint, position, gain, limit):
    """Saturated volts (n,) of the proportional controllers."""
    out = np.empty(setpoint.shape[0])
    for i in range(setpoint.shape[0]):
        out[i] = min(max(gain * (setpoint[i] - position[i]), -limit), limit)
    return out


def compensator_context(machine: Machine, period_s: float | None) -> Context:
    """What an engineer reads off the machine's data sheet. Not the overlap, the friction or the discharge coefficient.

    Compensators know one chamber, F/A1 = P1 - Ps A2/A1. Two chambers on a four-way valve look like that: with r = A2/A1
    the valve's edges hold P1 (1 + r^3) = F/A1 + (Ps + Pt) (r + r^3)/2 -+ (Ps - Pt) (r - r^3)/2, extending or retracting.
    The last term, 0 for a symmetric cylinder, is a step at each turn that they have to learn.
    """
    cylinder, sensors = machine.cylinder, machine.sensors
    bottom, top = cylinder.area_bottom_m2, cylinder.area_top_m2
    share = 1.0
    if cylinder.rod_side == "valve":
        r = top / bottom
        share = 1 + r**3
        top = bottom * (r + r**3) / 2
    return Context(
        rate_Hz=machine.controller.rate_Hz,
        position_gain_V_per_m=machine.controller.gain_V_per_m,
        voltage_max_V=machine.valve.voltage_max_V,
        stroke_m=cylinder.stroke_m,
        area_bottom_m2=share * bottom,
        area_top_m2=top,
        supply_pressure_Pa=machine.supply.pressure_Pa,
        tank_pressure_Pa=machine.supply.tank_pressure_Pa,
        bulk_modulus_Pa=machine.oil.bulk_modulus_Pa,
        pipeline_volume_m3=share * cylinder.pipeline_volume_m3,
        position_noise_m=sensors.position_noise_m,
        position_resolution_m=sensors.position_resolution_m,
        pressure_noise_Pa=sensors.pressure_noise_Pa,
        period_s=period_s,
    )


class PositionLoop:
    """Kp and compensators of all actuators.

    compensators: one a leg, or empty for plain control. `preview` is how many setpoints ahead `tick` must be given.
    on_message(time_s, leg, sentence): called at each change of a compensator's status (leg counts from 1).
    """

    def __init__(
        self,
        machine: Machine,
        compensators: Sequence[Compensator],
        period_s: float | None,
        on_message: Callable[[float, int, str], None] = lambda time_s, leg, text: None,
    ) -> None:
        self.gain = machine.controller.gain_V_per_m
        self.limit = machine.valve.voltage_max_V
        self.compensators = list(compensators)
        self.on_message = on_message
        self.context = compensator_context(machine, period_s)
        self.states: list[Any] = [c.start(self.context) for c in self.compensators]
        self.previews = [preview_count(c, self.context) for c in self.compensators]
        self.preview = max(self.previews, default=1)
        self.valve = np.zeros(machine.n_legs)
        self.compensation = np.zeros(machine.n_legs)
        self.setpoint = np.zeros(machine.n_legs)
        self.compensation_share = 1.0  # that reaches the valve; a fault fades it to 0
        self._status = [""] * len(self.compensators)

    def tick(
        self, time_s: float, setpoints: Array, positions: Array, pressures: Array | None, supply_Pa: float
    ) -> Array:
        """Volts (n_legs,) for this tick. setpoints: (preview, n_legs), this tick's first; the rest SI, measured."""
        self.setpoint = setpoints[0]
        volts = proportional(setpoints[0], positions, self.gain, self.limit)
        if self.compensators and pressures is not None:
            control = self.gain * (setpoints[0] - positions)
            for i, compensator in enumerate(self.compensators):
                sample = Sample(
                    time_s=time_s,
                    setpoint_m=float(setpoints[0, i]),
                    preview_m=setpoints[: self.previews[i], i],
                    position_m=float(positions[i]),
                    control_V=float(control[i]),
                    valve_V=float(self.valve[i]),
                    pressure_bottom_Pa=float(pressures[i]),
                    pressure_supply_Pa=supply_Pa,
                )
                added, self.states[i] = compensator.step(self.states[i], sample)
                added *= self.compensation_share
                self.compensation[i] = added
                volts[i] = min(max(sample.control_V + added, -self.limit), self.limit)
                status = compensator.status(self.states[i])
                if status != self._status[i]:
                    self._status[i] = status
                    self.on_message(time_s, i + 1, f"{compensator.name}: {status or 'normal again'}")
        self.valve = np.where(np.isfinite(volts), volts, 0.0)  # a loop without position signal closes the valve
        return self.valve

    def learned(self) -> list[dict[str, Any]]:
        """What each compensator has learned."""
        return [c.parameters(s) for c, s in zip(self.compensators, self.states, strict=True)]
