"""Numbers that trade: correlations in physical units, and the picture of them."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from hexsim.machine import load_machine
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters
from hexsim.tracing.report import trades as trading

DATA = Path(__file__).parents[1] / "data"
HOSE, SPOOL = parameters.named("hose_compliance"), parameters.named("spool_lag")
MODULUS = parameters.Prior(key="bulk_modulus_Pa", dotted="oil.bulk_modulus_Pa", declared=1.5e9, half_width=0.1)


def fitted(correlations):
    """Modulus, hose, spool's two numbers: errors of 0.5, 0.2, 0.1 and 0.1 in their coordinates."""
    sd = np.array([0.5, 0.2, 0.1, 0.1])
    matrix = np.eye(4)
    for (i, j), r in correlations.items():
        matrix[i, j] = matrix[j, i] = r
    spool = {number.name: number.typical for number in SPOOL.free()}
    return least_squares.Fit(
        machine=load_machine(DATA / "bench_none"), priors=(MODULUS,), deviations=np.array([0.02]),
        candidates=(HOSE, SPOOL), values=({"compliance_m3_Pa": 5e-14}, spool), chi2=0.0, n=0, misfit=[],
        covariance=matrix * sd * sd[:, None],
    )  # fmt: skip


def test_two_numbers_trade_where_they_are_correlated_beyond_nine_tenths():
    """Errors are in the numbers' units; the number of the named effect stands first."""
    [(hose, modulus, r)] = trading.trades(fitted({(0, 1): 0.95, (0, 2): 0.5}), [HOSE.label])
    assert (hose.of, modulus.key, r) == (HOSE.label, MODULUS.key, pytest.approx(0.95))
    assert hose.standard_error == pytest.approx(0.2 * HOSE.effect.parameters[0].typical)
    assert modulus.standard_error == pytest.approx(0.5 * 0.1 * 1.5e9)
    assert not trading.trades(fitted({(0, 1): 0.89}), [HOSE.label])
    assert not trading.trades(fitted({(0, 1): 0.95}), [SPOOL.label])


def test_a_bandwidth_falls_as_its_coordinate_grows():
    """Coordinate typical/f: what is correlated in coordinates is so with the other sign in the bandwidth."""
    [(_, _, r)] = trading.trades(fitted({(0, 2): 0.95}), [SPOOL.label])
    assert r == pytest.approx(-0.95, abs=1e-6)


def test_trades_are_in_the_report_and_drawn():
    fit = fitted({(0, 1): 0.95})
    result = SimpleNamespace(final=fit, effects=[SimpleNamespace(candidate=HOSE)])
    [entry] = trading.trade_entries(result)
    assert entry["correlation"] == pytest.approx(0.95)
    assert [number["of"] for number in entry["numbers"]] == [HOSE.label, "declared"]
    assert trading.pairs(result).startswith(b"\x89PNG")


def test_without_a_covariance_nothing_trades():
    bare = least_squares.Fit(machine=load_machine(DATA / "bench_none"), priors=(), deviations=np.zeros(0), candidates=(), values=(),
               chi2=0.0, n=0, misfit=[])  # fmt: skip
    assert trading.trades(bare, []) == []
