"""Controller: the logged volts against the position loop as it is declared, u - sat(K (s - y_m))  [V].

Formed only where the volts are those of a position loop of another gain or with a computing delay: the volts of any other
controller drive the model, and say nothing of the machine's loop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from hexsim.declaration import Controller, Machine
from hexsim.declaration.controller import LONGEST_DELAY_TICKS
from hexsim.signals.channels import noise_of
from hexsim.signals.log import Log
from hexsim.signals.ripple import wave_along
from hexsim.signals.weak_form import Window
from hexsim.tracing import rules
from hexsim.tracing.balances.balance import Balance, resolved_machine
from hexsim.tracing.memory import remembered

Array = np.ndarray
ALIKE = 0.02  # of the volts, likewise; of a tick, likewise


@dataclass(frozen=True, kw_only=True)
class LoopOfLeg:
    """Gain over the declared one, delay [ticks], and what of the volts is left [V]."""

    gain: float
    delay_ticks: float
    left_V: float


def is_position_loop(controller: Controller) -> bool:
    """Is it the proportional loop alone?"""
    plain = ("gain_V_per_m", "rate_Hz", "computing_delay_ticks", "setpoint_rate_Hz")
    usual = {key: field.default for key, field in Controller.model_fields.items() if key not in plain}
    return all(getattr(controller, key) == value for key, value in usual.items())


def loops_of(log: Log, machine: Machine) -> list[LoopOfLeg] | None:
    """The position loops that gave the logged volts, each leg's by least squares; None where no such loop did.

    u_k = a e_(k-w) + b e_(k-w-1),  e = K (s - y_m):  gain a + b, delay w + b/(a + b), away from the volts' limit.
    """
    if log.setpoint is None or log.volts is None or not is_position_loop(machine.controller):
        return None
    setpoint, volts = log.setpoint, log.volts
    K, limit = machine.of_legs("controller", "gain_V_per_m"), machine.of_legs("valve", "voltage_max_V")
    noise, every = noise_of(machine, [log])["position_m"], max(round(log.rate / machine.controller.rate_Hz), 1)
    ticks = slice(log.tick_phase(every), None, every)
    found = []
    for i in range(log.n_legs):
        asked, u = (K[i] * (setpoint[i] - log.position[i]))[ticks], volts[i, ticks]
        own = loop_of_leg(asked, u, 0.99 * limit[i])
        if own is None or own.left_V > min(rules.CERTAIN * K[i] * own.gain * noise, ALIKE * float(np.std(u))):
            return None
        found.append(own)
    return found


def loop_of_leg(asked: Array, volts: Array, limit_V: float) -> LoopOfLeg | None:
    """The loop that leaves least of the volts at the ticks."""
    best = None
    first = LONGEST_DELAY_TICKS + 1
    inside = (np.abs(volts) < limit_V)[first:]
    if inside.sum() < 10 * first:
        return None
    for whole in range(LONGEST_DELAY_TICKS):
        late = [asked[first - k : len(asked) - k][inside] for k in (whole, whole + 1)]
        share, *_ = np.linalg.lstsq(np.stack(late, axis=1), volts[first:][inside], rcond=None)
        left = float(np.median(np.abs(volts[first:][inside] - share @ late)))
        gain = float(share.sum())
        if gain > 0.0 and min(share) > -ALIKE * gain and (best is None or left < best.left_V):
            best = LoopOfLeg(gain=gain, delay_ticks=whole + float(share[1]) / gain, left_V=left)
    return best


def reads_another_transducer(log: Log, machine: Machine) -> bool:
    """Does the declared loop read a position that is not the logged one? The volts tell the position y that it reads; the
    logged one is that with an offset, a gain, a delay and a ripple where one stands out, to the noise,

        y = s - u/K,    y_m(t) = b0 + (1 + b1) y(t - b2) + A sin(2 pi y/L + phase)

    and no loop of another gain and delay leaves as little. A transducer with an error that the loop reads itself leaves
    nothing there. Volts at their limit tell nothing."""
    if log.setpoint is None or log.volts is None or not is_position_loop(machine.controller):
        return False
    K, limit = machine.of_legs("controller", "gain_V_per_m"), machine.of_legs("valve", "voltage_max_V")
    noise, every = noise_of(machine, [log])["position_m"], max(round(log.rate / machine.controller.rate_Hz), 1)
    ticks, seen = slice(log.tick_phase(every), None, every), False
    for volts, setpoint, position, gain, most in zip(log.volts, log.setpoint, log.position, K, limit, strict=True):
        inside = (np.abs(volts[ticks]) < 0.99 * most)[1:]
        if inside.sum() < machine.controller.rate_Hz:  # a second
            return False
        read, error = (setpoint - volts / gain)[ticks], (setpoint - position)[ticks]
        left, taken = left_by_transducer(log.time[ticks], read, position[ticks], inside)
        if left**2 > rules.NEAR * noise**2:
            return False
        loop = np.stack([error[1:], error[:-1]], axis=1)[inside]
        of_loop = left_by(loop, (volts / gain)[ticks][1:][inside] - loop[:, 0])
        seen |= taken**2 > rules.TELLABLE * noise**2 and left**2 < (1.0 - rules.SLIGHT) * of_loop**2
    return seen


def left_by_transducer(time: Array, read: Array, shown: Array, inside: Array) -> tuple[float, float]:
    """Rms [m] of what an offset, a gain, a delay and a ripple leave of shown - read (n,), and of what they take, by Gauss-Newton.

    inside (n - 1,): which samples count, from the second on.
    """
    curve, delay, left, waves = CubicSpline(time, read), 0.0, shown, np.zeros((0, len(time)))
    for _ in range(rules.FEW_STEPS):
        at, rate = curve(time - delay), curve(time - delay, 1)
        columns, off = np.stack([np.ones(len(at)), at, -rate, *waves], axis=1)[1:][inside], (shown - at)[1:][inside]
        found = np.linalg.lstsq(columns, off, rcond=None)[0]
        left = off - columns @ found
        delay = float(np.clip(delay + found[2], -rules.LONGEST_DELAY_S, rules.LONGEST_DELAY_S))
        if not len(waves):
            pitch, _, level = wave_along(at[1:][inside], left)
            angle = 2.0 * np.pi * at / pitch
            waves = np.stack([np.sin(angle), np.cos(angle)]) if level > rules.CERTAIN else waves
    return float(np.sqrt(np.mean(left**2))), float(np.sqrt(np.mean(((shown - read)[1:][inside] - left) ** 2)))


def left_by(columns: Array, values: Array) -> float:
    """Rms of what columns (n, k) leave of values (n,) by least squares."""
    left = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


class Loop(Balance):
    """The volts of every leg against those of the declared position loop."""

    name = "controller"
    unit = "V"
    caption = "volts = the declared gain times (setpoint − position)"
    order = 5
    signals = ("valve_V", "velocity_m_s", "position_m", "time_s")
    usual_signal = "valve_V"

    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        return (("setpoint", "valve"),) if is_position_loop(machine.controller) else ()

    def wants(self, log: Log, machine: Machine) -> bool:
        """Only where the loop is another one than declared."""
        if not self.measurable(log, machine):
            return False
        found = remembered(log, "loops", lambda: (loops_of(log, machine),))[0]
        declared = machine.controller.computing_delay_ticks
        return found is not None and any(
            abs(loop.gain - 1.0) > rules.KNOWN or abs(loop.delay_ticks - declared) > ALIKE for loop in found
        )

    def residual(self, log: Log, machine: Machine) -> Array:
        resolved, window = resolved_machine(machine), Window(log.rate)
        assert log.setpoint is not None and log.volts is not None
        limit = machine.of_legs("valve", "voltage_max_V")[:, None]
        gain = (machine.of_legs("controller", "gain_V_per_m") * resolved.loop_gain)[:, None]
        every = max(round(log.rate / machine.controller.rate_Hz), 1)
        asked = np.clip(gain * (log.setpoint - log.position), -limit, limit)[:, log.tick_phase(every) :: every]
        delay, at = machine.controller.computing_delay_ticks + resolved.loop_delay_ticks, np.arange(asked.shape[1])
        late = np.stack([np.interp(at - own, at, row) for own, row in zip(delay, asked, strict=True)])
        held = np.clip((np.arange(log.n) - log.tick_phase(every)) // every, 0, asked.shape[1] - 1)
        return window.mean(log.volts - late[:, held])


BALANCES = (Loop(),)
