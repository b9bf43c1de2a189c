"""The declared valve on a test stand, as ISO 10770-1 (four-way) and -2 (three-way) test one: no cylinder, one leg's row.

    flow over signal       constant valve drop, port A joined to B (three-way: A at half of it)    ISO 10770-1, 8.1.4
    pressure gain          ports blocked: pA - pB (three-way: pA) over signal
    threshold              smallest reversal of the signal that moves the flow
    internal leakage       ports blocked: flow that the supply gives
    step, frequency        spool position over signal, at several amplitudes

The signal runs a full slow cycle, so that hysteresis shows. The spool stands for the flow in the dynamic tests, as in
valves whose spool position is measured.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from hexsim.compiled import allocating
from hexsim.declaration import Machine
from hexsim.hydraulics import leg, ports, valve
from hexsim.hydraulics.parameters import ROD_SIDE_VALVE, P, declared_rows
from hexsim.smoothness import frequency_below

Array = NDArray[np.float64]
SEAL_m3_s_Pa = 1e-17  # of a blocked port, so that a dead band has a pressure: the middle one
FREQUENCIES_Hz = np.geomspace(1.0, 1000.0, 61)


@dataclass(frozen=True, kw_only=True)
class ValveTest:
    """Curves over the signal (n,) in shares of full signal, and the figures that a sheet gives.

    reversal (m,): signal that turns twice, at half signal after a rise, with its flow.

    step: amplitude -> response over time_s. bode: amplitude -> (gain, phase [deg]) over FREQUENCIES_Hz.
    """

    signal: Array
    flow_m3_s: Array
    reversal: Array
    reversed_flow_m3_s: Array
    load_pressure_Pa: Array
    leakage_m3_s: Array
    time_s: Array
    step: dict[float, Array]
    bode: dict[float, tuple[Array, Array]]
    drop_Pa: float
    supply_Pa: float
    figures: dict[str, Any]

    def table(self) -> list[tuple[str, str, str]]:
        """(figure, value, unit) in the units of data sheets."""
        f = self.figures
        rows = [
            (f"flow at full signal, {self.drop_Pa / 1e5:.3g} bar valve drop", f["rated_flow_l_min"], "l/min"),
            ("hysteresis", f["hysteresis_percent"], "% of full signal"),
            ("threshold", f["threshold_percent"], "% of full signal"),
            ("null", f["null_percent"], "% of full signal"),
            ("dead band about null", f["dead_band_percent"], "% of full signal"),
            ("pressure gain at null", f["pressure_gain_percent"], "% of supply for 1 % of signal"),
            (f"internal leakage at null, {self.supply_Pa / 1e5:.3g} bar", f["null_leakage_l_min"], "l/min"),
        ]
        for amplitude, figure in f["dynamics"].items():
            rows += [
                (f"-3 dB at {amplitude} % of signal", figure["minus_3dB_Hz"], "Hz"),
                (f"-90 deg at {amplitude} %", figure["minus_90deg_Hz"], "Hz"),
            ]
        rows += [(f"0 to {a} % step, to 90 % of it", t, "ms") for a, t in f["step_90_percent_ms"].items()]
        return [(name, "-" if value is None else f"{value:.3g}", unit) for name, value, unit in rows]


def valve_test(
    machine: Machine,
    *,
    reversed_at: float = 0.5,  # of full signal: where the threshold is tested
    least_reversal: float = 2e-3,  # of full signal
    null_share: float = 0.05,  # spacing of the signal at null over an even one
    step_s: float = 1e-5,  # a hundredth of the fastest spool's time constant
) -> ValveTest:
    """All tests of the valve of a machine's first leg, at the declared oil."""
    p = declared_rows(machine)[0]
    tank = float(p[P.TANK_PRESSURE])
    rated = machine.valve.rated_pressure_drop_Pa
    drop = 2 * rated if rated else float(p[P.SUPPLY_PRESSURE]) - tank
    supply = float(p[P.SUPPLY_PRESSURE])
    even = np.concatenate([np.linspace(0, 1, 501), np.linspace(1, -1, 1001)[1:], np.linspace(-1, 1, 1001)[1:]])
    signal = null_share * even + (1.0 - null_share) * even**3  # dense about null, where pressure and leakage turn
    spool = _spool(p, signal * machine.valve.voltage_max_V)
    flow = np.array([_no_load_flow(p, x, tank + drop, tank) for x in spool])
    reversal = reversed_at - max(2 * p[P.HYSTERESIS] / machine.valve.voltage_max_V, least_reversal) * np.concatenate(
        [np.linspace(0, 2, 401), np.linspace(2, 0, 401)[1:]]
    )
    ramp = np.linspace(0.0, reversed_at, 51)[:-1]
    turned = _spool(p, np.concatenate([ramp, reversal]) * machine.valve.voltage_max_V)[len(ramp) :]
    blocked = np.array([_blocked(p, x, supply, tank) for x in spool])
    cycle = slice(500, None)  # one closed loop from +1 to +1
    time = np.arange(0, 6.0 / max(p[P.SPOOL_OMEGA] / 10, 10.0), step_s)
    step = {
        a: _response(p, np.full(len(time), a * p[P.SPOOL_TRAVEL]), step_s) / p[P.SPOOL_TRAVEL]
        for a in (0.1, 0.25, 0.5, 1.0)
    }
    bode = {a: _bode(p, a) for a in (0.05, 0.25, 1.0)}
    test = ValveTest(
        signal=signal[cycle],
        reversal=reversal,
        flow_m3_s=flow[cycle],
        load_pressure_Pa=blocked[cycle, 0],
        leakage_m3_s=blocked[cycle, 1],
        time_s=time,
        step=step,
        bode=bode,
        drop_Pa=drop,
        supply_Pa=supply,
        figures={},
        reversed_flow_m3_s=np.array([_no_load_flow(p, x, tank + drop, tank) for x in turned]),
    )
    test.figures.update(_figures(test))
    return test


def _spool(p: Array, volts: Array) -> Array:
    """Spool positions (n,) [m] of a slow signal [V]."""
    at_rest = p.copy()
    at_rest[P.SPOOL_OMEGA] = 0.0
    held = leg.valve_volts(volts, p[P.HYSTERESIS], 0.0, p[P.HYSTERESIS_SPREAD])
    return np.array([leg.metering_spool(at_rest, u, 0.0, 0.0) for u in held])


def _no_load_flow(p: Array, x: float, supply: float, tank: float) -> float:
    """Flow out of port A [m3/s] at spool position x, A joined to B, or A of a three-way valve at the middle pressure."""
    middle = 0.5 * (supply + tank)
    if p[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE:

        def net(pressure: float) -> float:
            return (
                _port_a(p, x, pressure, supply) + _port_b(p, x, pressure, supply) + SEAL_m3_s_Pa * (middle - pressure)
            )

        middle = float(scipy.optimize.root_scalar(net, bracket=(tank, supply), xtol=1.0).root)
    return _port_a(p, x, middle, supply)


def _port_a(p: Array, x: float, pressure: float, supply: float) -> float:
    return ports.supply_edge_flow(p, x, pressure, supply) - ports.tank_edge_flow(p, x, pressure)


def _port_b(p: Array, x: float, pressure: float, supply: float) -> float:
    return ports.top_supply_flow(p, x, pressure, supply) - ports.top_tank_flow(p, x, pressure)


def _blocked(p: Array, x: float, supply: float, tank: float) -> tuple[float, float]:
    """Load pressure [Pa] and flow from the supply [m3/s] with all ports blocked."""
    middle = 0.5 * (supply + tank)

    def rest(flow: Any) -> float:
        def net(pressure: float) -> float:
            return flow(p, x, pressure, supply) + SEAL_m3_s_Pa * (middle - pressure)

        return float(scipy.optimize.root_scalar(net, bracket=(tank, supply), xtol=1.0).root)

    a = rest(_port_a)
    leakage = ports.supply_edge_flow(p, x, a, supply)
    if p[P.ROD_SIDE_CHAMBER] != ROD_SIDE_VALVE:
        return a, leakage
    b = rest(_port_b)
    return a - b, leakage + ports.top_supply_flow(p, x, b, supply)


@allocating
def _response(p, command, h):
    """Spool positions (n,) [m] under commands (n,) [m], from rest at 0, time step h [s]."""
    out = np.empty(command.shape[0])
    x = speed = 0.0
    for k in range(command.shape[0]):
        out[k] = x if p[P.SPOOL_OMEGA] > 0.0 else command[k]
        dx, acceleration = valve.spool_rates(
            x, speed, command[k], p[P.SPOOL_OMEGA], p[P.SPOOL_DAMPING], p[P.SPOOL_RATE]
        )
        speed += h * acceleration
        x += h * dx if p[P.SPOOL_DAMPING] <= 0.0 or p[P.SPOOL_RATE] > 0.0 else h * speed
    return out


def _bode(
    p: Array,
    amplitude: float,
    *,
    per_cycle: int = 1000,  # time steps of a sine
    n_cycles: int = 6,  # that are run; the last one is judged
) -> tuple[Array, Array]:
    """Gain and phase [deg] of the spool's first harmonic (n_frequencies,)."""
    height = amplitude * p[P.SPOOL_TRAVEL]
    turn = 2j * np.pi * np.arange(per_cycle) / per_cycle
    answers = []
    for frequency in FREQUENCIES_Hz:
        h = 1.0 / (frequency * per_cycle)
        sine = height * np.sin(2 * np.pi * np.arange(per_cycle * n_cycles) / per_cycle)
        last = _response(p, sine, h)[-per_cycle:]
        answers.append(2j * np.mean(last * np.exp(-turn)) / height)
    response = np.array(answers)
    return np.abs(response), np.degrees(np.unwrap(np.angle(response)))


def _figures(
    test: ValveTest,
    *,
    moved_share: float = 1e-9,  # of the largest flow: more is a movement, less is rounding
) -> dict[str, Any]:
    """What a sheet says of these curves."""
    down, up = slice(0, 1001), slice(1000, 2001)
    flow, signal = test.flow_m3_s, test.signal
    rated = float(np.max(np.abs(flow)))
    # the signal at which each way passes a tenth of the flow, either sign: how far the two lie apart
    levels = np.concatenate([np.linspace(0.1, 0.9, 9), -np.linspace(0.1, 0.9, 9)]) * rated
    falling, rising = (
        np.interp(levels, flow[w][order], signal[w][order])
        for w, order in ((down, slice(None, None, -1)), (up, slice(None)))
    )
    moved = np.abs(test.reversed_flow_m3_s - test.reversed_flow_m3_s[0]) > moved_share * rated
    ends = [_shut(signal[way], flow[way], rated) for way in (down, up)]
    steep = np.gradient(test.load_pressure_Pa[up], signal[up])
    dynamics = {
        f"{100 * amplitude:g}": {
            "minus_3dB_Hz": _falls(gain, 10 ** (-3 / 20)),
            "minus_90deg_Hz": _falls(phase, -90.0),
        }
        for amplitude, (gain, phase) in test.bode.items()
    }
    return {
        "rated_flow_l_min": rated * 6e4,
        "hysteresis_percent": round(100 * float(np.max(rising - falling)), 9),  # interpolation leaves 1e-14
        "threshold_percent": 100 * float(test.reversal[0] - test.reversal[max(int(np.argmax(moved)) - 1, 0)]),
        "null_percent": 100 * float(np.mean(ends)),
        "dead_band_percent": 100 * (ends[1][1] - ends[1][0]),
        "pressure_gain_percent": float(np.max(steep)) / test.supply_Pa,
        "null_leakage_l_min": 6e4 * float(np.max(test.leakage_m3_s)),
        "dynamics": dynamics,
        "step_90_percent_ms": {
            f"{100 * a:g}": 1e3 * float(test.time_s[np.argmax(x >= 0.9 * a)]) if np.any(x >= 0.9 * a) else None
            for a, x in test.step.items()
        },
    }


def _shut(
    signal: Array,
    flow: Array,
    rated: float,
    *,
    dead_share: float = 1e-4,  # of the largest flow: below it the valve counts as shut
) -> tuple[float, float]:
    """Signals between which the valve is shut on its way up or down; where it never is, the one at which its flow turns."""
    shut = signal[np.abs(flow) < dead_share * rated]
    if len(shut):
        return float(np.min(shut)), float(np.max(shut))
    order = np.argsort(signal)
    turn = float(np.interp(0.0, flow[order], signal[order]))
    return turn, turn


def _falls(values: Array, level: float) -> float | None:
    """Frequency at which a curve falls below a level; None where it does not within reach, or begins below."""
    return frequency_below(FREQUENCIES_Hz, values, level) if values[0] >= level else None
