"""What a rest hides and what would show it; and what must not take the place of a number: bends, bounds."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from other_plant import write_machine

from hexsim.machine import load_machine
from hexsim.tracing import balances, rules
from hexsim.tracing.balances import balance as points
from hexsim.tracing.balances import bends, continuity, null
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters, rest_hidden, rest_priors
from hexsim.tracing.fitting.limits import reached
from hexsim.tracing.problems import balance as balance_problem
from hexsim.tracing.report.hidden import would_show
from hexsim.tracing.steps import balance_search, logs, violations

DATA = Path(__file__).parents[1] / "data"
BENCH = load_machine(DATA / "bench_none")


def bare_fit(*effects, values=()):
    own = parameters.priors(BENCH)
    return least_squares.Fit(
        machine=BENCH, priors=own, deviations=np.zeros(len(own)), candidates=effects, values=values, chi2=0.0, n=0, misfit=[]
    )  # fmt: skip


def test_a_late_valve_bends_the_acceleration_between_the_controllers_ticks(tmp_path):
    """5 ms at 2 ms between ticks: sensors agree as well as on a bench without; at the ticks themselves 5 times worse."""
    left = {}
    for delay_ms in (0.0, 5.0):
        write_machine(tmp_path / f"{delay_ms:g}", 7, {"valve_delay": delay_ms} if delay_ms else {}, duration_s=8.0)
        trace = logs.begin(tmp_path / f"{delay_ms:g}", ["fit"], ["validate"])
        point = points.sensed_leg(trace.fit_problem.logs[0], points.resolved_machine(trace.machine), 0)
        at_ticks = replace(point, ticks=slice(0, None, 2))
        left[delay_ms] = [float(np.std(own.disagreement()[500:-500])) for own in (point, at_ticks)]
    assert left[0.0][0] == left[0.0][1]
    assert left[5.0][0] < 1.2 * left[0.0][0]
    assert left[5.0][1] > 4.0 * left[5.0][0]


def test_an_acceleration_that_follows_no_volts_bends_at_the_ticks():
    """Noise says nothing of when it bends."""
    acceleration, volts = np.random.default_rng(3).standard_normal((2, 20_000))
    assert bends.bends_at(acceleration, np.repeat(volts[::2], 2), slice(0, None, 2)) == slice(0, None, 2)


def test_a_number_that_physics_bounds_stays_in_the_middle_where_no_log_shows_it():
    """A polytropic exponent costs nothing at 1.2 and 3 at 1 and at 1.4; a gas volume and a frequency cost nothing anywhere."""
    for exponent, cost in ((1.0, 3.0), (1.2, 0.0), (1.4, 3.0)):
        numbers = {"gas_volume_m3": 3e-4, "line_resistance_Pa_s_m3": 8e9, "polytropic_exponent": exponent}
        fit = bare_fit(parameters.named("gas_accumulator"), values=(numbers,))
        assert rest_priors.prior_precision(fit) @ rest_priors.off_prior(fit) ** 2 == pytest.approx(cost)
    lag = bare_fit(parameters.named("spool_lag"), values=({"frequency_Hz": 30.0, "damping": 2.9},))
    assert rest_priors.prior_precision(lag) @ rest_priors.off_prior(lag) ** 2 == 0.0


def hidden_beside(A, least=100.0, effect="entrained_air"):
    """What is hidden of an effect with this normal matrix: its column last, bulk modulus first."""
    modulus = next(prior for prior in parameters.priors(BENCH) if prior.key == "bulk_modulus_Pa")
    bare = replace(bare_fit(), priors=(modulus,), deviations=np.zeros(1))
    return rest_hidden.hidden_of(bare, A, parameters.named(effect), least)


def test_what_hides_an_effect_known_as_well_as_is_said_lets_its_typical_size_show():
    """Two columns that are one but for a tenth: with the modulus known to what is said, the error is what is needed."""
    A = np.array([[900.0 + 3.0, 990.0], [990.0, 1100.0]])
    found = hidden_beside(A)
    assert found.by == "bulk_modulus_Pa" and found.is_parameter and 0.0 < found.known_to < 1.0
    assert found.times == pytest.approx(10.0 * math.sqrt(np.linalg.inv(A)[1, 1]))
    posterior = 1.0 / np.linalg.inv(A)[0, 0]
    A[0, 0] += 3.0 / found.known_to**2 - posterior
    assert np.linalg.inv(A)[1, 1] == pytest.approx(1.0 / 100.0)


def test_an_effect_that_shows_is_hidden_by_nothing_and_one_without_a_column_is_not_known():
    """Typical air of a normal matrix of 10,000 stands 100 errors high; no column, no size."""
    assert hidden_beside(np.diag([3.0, 1e4])).by == ""
    assert hidden_beside(np.diag([3.0, 0.0])) is None


def test_the_report_says_which_parameter_known_how_well_would_show_an_effect():
    """Air beside a bulk modulus at its limit comes before what is hidden more; what stands for any cause does not come."""
    own = parameters.priors(BENCH)
    at_limit = np.array([prior.half_width * (prior.key == "bulk_modulus_Pa") for prior in own])
    width = BENCH.uncertainty["bulk_modulus_Pa"]
    hidden = {
        "constant_force": rest_hidden.Hidden(size=80.0, times=9.0, by="supply_pressure_gain", known_to=0.5),
        "null_drift": rest_hidden.Hidden(size=2e-2, times=7.0, by="null_offset", known_to=0.5),
        "entrained_air": rest_hidden.Hidden(
            size=0.025, times=2.5, by="bulk_modulus_Pa", is_parameter=True, known_to=0.4
        ),
        "spring": rest_hidden.Hidden(size=90.0, times=0.2),
    }
    result = SimpleNamespace(
        hidden=hidden, effects=[], final=SimpleNamespace(priors=own, deviations=at_limit), machine=BENCH
    )
    first, second = would_show(result)
    assert "entrained air" in first and "2.50 %" in first and f"known to {40 * width:.2g} %" in first
    assert "null drift" in second and "measured apart to" in second


def test_a_gain_that_is_taken_out_leaves_the_noise_of_a_row_as_it_was():
    """Noise added to a log, transducers that show 10 % too much: it makes rows as large as without, within 4 %."""
    rng, machine = np.random.default_rng(11), BENCH
    its = lambda name: balances.balance_named(name, BENCH)  # noqa: E731
    log = next(
        iter(logs.begin(Path(__file__).parents[1] / "data" / "bench_none", ["fit"], ["validate"]).fit_problem.logs)
    )
    noise = {"position_m": 3e-6, "pressure_bottom_Pa": 4e3, "pressure_supply_Pa": 4e3, "acceleration_m_s2": 0.02}
    noisy = null.with_noise(log, noise, 0.0, rng)
    for balance, names in (
        (its("sensor"), ("position_gain", "accelerometer_gain")), (its("force"), ("pressure_gain",)),
        (its("continuity"), ("position_gain",)), (continuity.FastContinuity(0.0, 1.0), ("pressure_gain",)),
    ):  # fmt: skip
        sizes = []
        for change in (0.0, 0.1):
            gained = parameters.with_settings(
                machine, {}, [(parameters.named(name), {"relative_change": change}) for name in names]
            )
            clean = (null.used(log, balance.residual(log, gained)),)
            rows = balance_problem.BalanceRows(balance=balance, sigma=np.ones(1), rows=(0,), clean=clean)
            sizes.append(np.std(rows.residual(noisy, gained, 0, 1)))
        assert sizes[1] == pytest.approx(sizes[0], rel=0.04), balance.name


def test_a_limit_that_no_motion_reaches_is_not_said_to_show():
    """Of a spool of 250 Hz: its speed after the volts' largest step is all that a log asks for, and a limit shows from below that.
    Its spool alone, without a limit, moves the balances by far more than noise: that says nothing of a limit."""
    trace = logs.begin(DATA / "bench_none", ["fit"], ["validate"])
    for step in (violations.STEP, balance_search.STEP):
        trace = step.run(trace, lambda doing: None)
    limit, problem = parameters.named("spool_rate_limit"), trace.balance_problem
    shown = reached(trace.base, limit, problem, rules.alarm(trace.screened))
    gain = BENCH.valve.spool_travel_max_m / BENCH.valve.voltage_max_V
    asked = 2 * np.pi * 250.0 * gain * np.abs(np.diff(trace.fit_problem.logs[0].volts[0])).max()
    assert 0.1 * asked < shown < asked
    never = limit.start() | {"rate_m_s": 2.0 * asked}
    alone = least_squares.evaluate(replace(trace.base, candidates=(limit,), values=(never,)), problem)
    assert sum(np.sum((a - b) ** 2) for a, b in zip(alone.misfit, trace.base.misfit, strict=True)) > 1e3
