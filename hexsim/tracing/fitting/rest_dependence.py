"""On what a row of a rest depends: a curve over one signal, a line at one frequency."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hexsim.tracing import rules
from hexsim.tracing.balances.balance import measured_point, resolved_machine
from hexsim.tracing.balances.continuity import Continuity
from hexsim.tracing.balances.null import used
from hexsim.tracing.dependence import CURVES, block_numbers, design, knots_of, line_share, r2_of
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.rest_level import RestFit
from hexsim.tracing.problems.balance import BalanceProblem

Array = np.ndarray
TONE = {"frequency_Hz", "phase_rad"}  # numbers of an effect that is one


def line_in_continuity(fit: Fit, problem: BalanceProblem) -> float:
    """Largest share of a row of continuity that stands at the frequency of the last effect, in every run; 0 of no tone.

    An outside force moves piston and pressure together and leaves no line there; a hum p of the pressure signal leaves C dp/dt.
    """
    if not fit.values[-1].keys() >= TONE:
        return 0.0
    continuity = [isinstance(part.balance, Continuity) for part in problem.parts for _ in part.rows]
    shares = [
        [line_share(row, fit.values[-1]["frequency_Hz"], log.rate / problem.every(log)) for row in misfit[continuity]]
        for log, misfit in zip(problem.logs, fit.misfit, strict=True)
    ]
    return float(np.max(np.min(shares, axis=0), initial=0.0))


def left_by_a_curve(base: RestFit, rival: RestFit, own: Sequence[int], problem: BalanceProblem) -> float:
    """What a free curve over one signal leaves of the effect's own row, over what the effect leaves; on unseen blocks.

    The row in which the effect takes most. A curve that leaves far less says that the effect stands in for something.
    """
    if not own:
        return np.inf
    row = max(own, key=lambda k: base.sizes[k] / rival.sizes[k])
    place = problem.channels(0)[row].rpartition(" of ")[2]
    place = place if place.startswith("leg") else rival.fit.candidates[-1].where
    leg = int(place.split()[1]) - 1 if place.startswith("leg") else 0
    rest = np.concatenate([m[row] for m in base.fit.misfit])
    blocks = block_numbers([m.shape[1] for m in base.fit.misfit], round(rules.PARTLY_BLOCK_S / problem.thin_s))
    signals = [signals_at(problem, i, base, leg) for i in range(len(problem.logs))]
    v = np.concatenate([own_signals["velocity_m_s"] for own_signals in signals])
    best = 0.0
    for name in signals[0]:
        x = np.concatenate([own_signals[name] for own_signals in signals])
        if np.ptp(x) > 0.0:
            best = max(best, *(r2_of(design(form, x, v, knots_of(x)), rest, blocks) for form in CURVES))
    left = max(float(np.var(rest)) * (1.0 - best), 1.0)
    return left / max(float(rival.sizes[row] ** 2), 1.0)


def signals_at(problem: BalanceProblem, i: int, base: RestFit, leg: int) -> dict[str, Array]:
    """Signals of a leg in log i at the samples of the problem's rows."""
    log, machine = problem.logs[i], base.fit.machine
    point = measured_point(log, machine, resolved_machine(machine), leg)
    window, every = point.sensed.window, problem.every(log)
    found = {"position_m": point.y, "velocity_m_s": point.v, "valve_V": point.volts, "pressure_supply_Pa": point.Ps}
    if point.P1 is not None:
        found["pressure_bottom_Pa"] = point.P1
    if log.acceleration is not None:
        found["acceleration_m_s2"] = log.acceleration[-1]
    smooth = {name: used(log, window.mean(x))[::every] for name, x in found.items()}
    return smooth | {"time_s": used(log, point.t)[::every]}
