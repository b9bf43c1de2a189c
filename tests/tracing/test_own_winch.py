"""A hydraulic winch: five terms in one balance, and a late flow whose leakage and compressibility lead its speed by 0.1 s."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from hexsim.tracing import term_regression, term_selection
from hexsim.tracing.own.trace import trace_folder

pytestmark = pytest.mark.slow  # test_own_boom.py has a late flow and its losses, test_other_sign.py the signs
RATE, SECONDS, LATE_S, GEAR = 125.0, 48.0, 0.06, 12.0
DISPLACEMENT, INERTIA, LEVER = 7.162e-6, 0.9, 0.0167  # m3/rad, kg m2, m
TORQUE = {"viscous": 1.7, "Coulomb": 9.0, "cold": 5.0, "unbalance sine": 5.4, "unbalance cosine": 3.7}
FLOW = {"leakage": 2.3e-12, "case drain": 1.1e-12, "compressibility": 1.33e-12}
COLUMNS = ("speed_rad_s", "drum_rad", "pressure_a_Pa", "pressure_b_Pa", "flow_m3_s", "rope_N")

TABLES = """
[runs]
validate = ["run4"]
window_s = 0.1
[constants]
drop = "pressure_a_Pa - pressure_b_Pa"
side = "tanh(speed_rad_s / 0.4)"
[align.flow_m3_s]
reference = "speed_rad_s"
[[balances]]
name = "torque"
unit = "N m"
target = "7.162e-6 * drop"
terms = [
    { name = "inertia", unit = "kg m2", column = "rate(speed_rad_s)", declared = 0.85, uncertainty = 0.09 },
    { name = "rope", unit = "m", column = "rope_N", declared = 0.0167, uncertainty = 0.0005 },
]
candidates = [
    { name = "viscous", unit = "N m s", column = "speed_rad_s", sign = 1 },
    { name = "Coulomb", unit = "N m", column = "side", sign = 1 },
    { name = "by pressure", unit = "N m/Pa", column = "abs(drop) * side", sign = 1 },
    { name = "cold", unit = "N m", column = "exp(-time_s / 25) * side", sign = 1 },
    { name = "unbalance sine", unit = "N m", column = "sin(drum_rad)" },
    { name = "unbalance cosine", unit = "N m", column = "cos(drum_rad)" },
    { name = "constant", unit = "N m" },
]
[[balances]]
name = "flow"
unit = "m3/s"
target = "flow_m3_s"
terms = [{ name = "displacement", unit = "m3/rad", column = "speed_rad_s", declared = 7.162e-6, uncertainty = 7e-8 }]
candidates = [
    { name = "leakage", unit = "m3/s/Pa", column = "drop", sign = 1 },
    { name = "case drain", unit = "m3/s/Pa", column = "pressure_a_Pa", sign = 1 },
    { name = "compressibility", unit = "m3/Pa", column = "rate(pressure_a_Pa)", sign = 1 },
]
"""


def logged(seed: int) -> dict[str, np.ndarray]:
    """Columns of a run; made at 10 times the rate, derivatives by differences there."""
    rng, t = np.random.default_rng([seed, 51]), np.arange(-2.0, SECONDS, 0.1 / RATE)
    w, phase = 2 * np.pi * np.array([0.07, 0.13, 0.21, 0.37, 0.6, 0.95]), rng.uniform(0, 2 * np.pi, 6)
    size = np.array([14, 11, 9, 6, 4, 2.5]) * rng.uniform(0.7, 1.3, 6)
    speed = np.sin(np.multiply.outer(t, w) + phase) @ size
    drum = np.cumsum(speed) * 0.1 / RATE / GEAR
    rope = 2100.0 + 480.0 * np.sin(0.19 * t + phase[0])
    side = np.tanh(speed / 0.4)
    torque = INERTIA * np.gradient(speed, t) + LEVER * rope + TORQUE["viscous"] * speed + TORQUE["Coulomb"] * side
    torque += TORQUE["cold"] * np.exp(-t / 25.0) * side
    torque += TORQUE["unbalance sine"] * np.sin(drum) + TORQUE["unbalance cosine"] * np.cos(drum)
    back = 8e5 + 2e5 * np.sin(0.07 * t + phase[1])
    bottom = back + torque / DISPLACEMENT
    flow = DISPLACEMENT * speed + FLOW["leakage"] * (bottom - back) + FLOW["case drain"] * bottom
    flow += FLOW["compressibility"] * np.gradient(bottom, t)
    flow = np.interp(t - LATE_S, t, flow)
    noise = (0.06, 3e-4, 2.5e4, 1e4, 1e-6, 5.0)
    keep = np.flatnonzero(t >= 0.0)[::10]
    values = (speed, drum, bottom, back, flow, rope)
    noisy = (x[keep] + s * rng.standard_normal(len(keep)) for x, s in zip(values, noise, strict=True))
    return {"time_s": t[keep], **dict(zip(COLUMNS, noisy, strict=True))}


@pytest.fixture(scope="module")
def winch(tmp_path_factory):
    """Both balances traced; five runs, the last held out."""
    place = tmp_path_factory.mktemp("winch")
    for seed in range(5):
        pl.DataFrame(logged(seed)).write_csv(place / f"run{seed}.csv")
    (place / "balances.toml").write_text(TABLES)
    (place / "mapping.toml").write_text('kind = "own"\n' + "".join(f"[columns.{name}]\n" for name in COLUMNS))
    machine, traces, _ = trace_folder(place)
    return machine, {trace.balance.name: trace for trace in traces}


def test_a_flow_that_leads_its_speed_is_moved_to_its_own_delay(winch):
    """Leakage and compressibility make the flow lead its speed by some 0.1 s, more than it is late. The delay comes out within
    0.5 ms (5 of its errors) in every run, the one held out too, and is said with what correlation alone gives."""
    machine, _ = winch
    for point in (*machine.fit, *machine.validate):
        assert point.shifts_s["flow_m3_s"] == pytest.approx(LATE_S, abs=5e-4)
        (said,) = (text for text in machine.sentences[point.log.name] if "is late by" in text)
        assert "by its reference alone -" in said


def test_its_three_losses_are_found(winch):
    """Within 3 %, and on the held-out run a hundredth of the flow's rest is left; with the flow aligned by its speed half was,
    and a relief valve was named."""
    trace = winch[1]["flow"]
    assert set(trace.verdict.named) == set(FLOW)
    for name, size in FLOW.items():
        assert trace.verdict.coefficients[name][0] == pytest.approx(size, rel=0.03)
    assert trace.held_out["run4"]["with_terms"] < trace.held_out["run4"]["refit"] / 100


def test_five_terms_that_are_there_are_named_and_no_other(winch):
    """Friction by its three parts and the unbalance by its two, within 2 %; three were the most that a balance could name."""
    trace = winch[1]["torque"]
    assert set(trace.verdict.named) == set(TORQUE)
    for name, size in TORQUE.items():
        assert trace.verdict.coefficients[name][0] == pytest.approx(size, rel=0.02)


def test_beside_a_delay_every_term_has_the_sign_that_physics_allows(winch):
    """Leakage given the wrong sign is nothing then, and the other numbers those of a fit without it."""
    point = winch[0].fit[0]
    terms = {
        name: term_regression.Term(name=name, unit="", column=lambda p, k=name: p.mean(p[k]), sign=sign)
        for name, sign in (("pressure_a_Pa", -1), ("rope_N", 1))
    }
    rate = term_regression.Term(name="speed", unit="", column=lambda p: p.mean(p["speed_rad_s"]))
    balance = term_regression.OwnBalance(
        name="flow", unit="m3/s", target=lambda p: p.mean(p["flow_m3_s"]), terms=(rate,), candidates=()
    )
    runs = [term_regression.run_data(balance, point)]
    free, held = (
        term_selection.solve(balance, runs, tuple(terms.values())),
        term_selection.solve_physical(balance, runs, tuple(terms.values())),
    )
    assert free[1] > 0.0
    assert abs(held[1]) < 1e-6 * free[1]
    assert held[[0, 2]] == pytest.approx(term_selection.solve(balance, runs, (terms["rope_N"],)), rel=1e-6)


def test_a_delay_that_a_candidate_does_as_well_stays_where_correlation_put_it(tmp_path):
    """A candidate in the rate of the speed that the flow follows is a delay to first order: no run tells them apart, and
    correlation's delay, within 0.5 ms of the true one, is kept and said without an error."""
    for seed in range(3):
        columns = logged(seed)
        late = np.interp(columns["time_s"] - LATE_S, columns["time_s"], columns["speed_rad_s"])
        pl.DataFrame(columns | {"flow_m3_s": DISPLACEMENT * late}).write_csv(tmp_path / f"run{seed}.csv")
    rate = '{ name = "lag", unit = "m3", column = "rate(speed_rad_s)" },'
    only_flow = TABLES[: TABLES.index("[[balances]]")] + TABLES[TABLES.rindex("[[balances]]") :]
    (tmp_path / "balances.toml").write_text(
        only_flow.replace('validate = ["run4"]', "").replace("candidates = [", f"candidates = [{rate}")
    )
    (tmp_path / "mapping.toml").write_text('kind = "own"\n' + "".join(f"[columns.{name}]\n" for name in COLUMNS))
    machine, _, _ = trace_folder(tmp_path)
    for point in machine.fit:
        assert point.shifts_s["flow_m3_s"] == pytest.approx(LATE_S, abs=5e-4)
        assert not any("by its reference alone" in text for text in machine.sentences[point.log.name])


def test_a_held_out_run_whose_late_channel_stands_still_is_scored_without_a_delay(tmp_path):
    """The others are aligned; the run says that there is nothing to align, and has its place in the budget."""
    for seed in range(5):
        still = {"flow_m3_s": np.zeros(int(SECONDS * RATE))} if seed == 4 else {}
        pl.DataFrame(logged(seed) | still).write_csv(tmp_path / f"run{seed}.csv")
    (tmp_path / "balances.toml").write_text(TABLES)
    (tmp_path / "mapping.toml").write_text('kind = "own"\n' + "".join(f"[columns.{name}]\n" for name in COLUMNS))
    machine, traces, _ = trace_folder(tmp_path)
    assert all(point.shifts_s["flow_m3_s"] == pytest.approx(LATE_S, abs=5e-4) for point in machine.fit)
    assert "flow_m3_s stands still: nothing to align" in machine.sentences["run4"]
    assert all("run4" in trace.held_out for trace in traces)
