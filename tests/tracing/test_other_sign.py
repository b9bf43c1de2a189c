"""A term declared with the wrong sign is said, whatever took its place: nothing, a delay, or the number of another term."""

import numpy as np
import polars as pl
import pytest

from hexsim.tracing.own.trace import trace_folder

RATE, N = 50.0, 4000
AREA, LEAK, COMPLIANCE, LATE_S = 8.87e-4, 2.0e-12, 1.5e-12, 0.1

BALANCES = """
[runs]
window_s = 0.2
ALIGN
[[balances]]
name = "flow"
unit = "m3/s"
target = "flow_m3_s"
terms = [{ name = "area", unit = "m2", column = "AREA_COLUMN", declared = 8.87e-4, uncertainty = 2e-5 }]
candidates = [
    { name = "leakage", unit = "m3/s/Pa", column = "pressure_Pa", sign = LEAK_SIGN },
    { name = "compressibility", unit = "m3/Pa", column = "rate(pressure_Pa)", sign = COMPLIANCE_SIGN },
]
"""
ALIGNED = '[align.flow_m3_s]\nreference = "velocity_m_s"\nconstant = true'


def remarks_of(place, late=False, area="velocity_m_s", leak=1, compliance=1):
    """Remarks and named terms of the flow into a ram that leaks and compresses, with these signs declared."""
    for seed in range(4):
        rng, t = np.random.default_rng(seed), np.arange(N) / RATE
        waves = [np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in (0.11, 0.23, 0.31, 0.43, 0.57)]
        v, p = 0.05 * (waves[0] + waves[1]), 4e6 * (waves[2] + waves[3] + waves[4])
        if late:
            p = p + 6e7 * v
        flow = AREA * v + LEAK * p + COMPLIANCE * np.gradient(p, 1.0 / RATE)
        flow = np.interp(t - LATE_S * late, t, flow) + 1e-7 * rng.standard_normal(N)
        pl.DataFrame({"time_s": t, "velocity_m_s": v, "pressure_Pa": p, "flow_m3_s": flow}).write_csv(
            place / f"run{seed}.csv"
        )
    text = BALANCES.replace("ALIGN", ALIGNED if late else "").replace("AREA_COLUMN", area)
    text = text.replace("LEAK_SIGN", str(leak)).replace("COMPLIANCE_SIGN", str(compliance))
    (place / "balances.toml").write_text(text)
    columns = "".join(
        f'[columns.{name}]\nfrom = "{name}"\n' for name in ("time_s", "velocity_m_s", "pressure_Pa", "flow_m3_s")
    )
    (place / "mapping.toml").write_text(f'kind = "own"\n{columns}')
    [balance] = trace_folder(place)[2]["balances"]
    return [one for one in balance["remarks"] if "other sign" in one], balance["named"]


@pytest.mark.parametrize("late", [pytest.param(False, marks=pytest.mark.slow), True])
def test_right_signs_say_nothing(tmp_path, late):
    """Both terms are named and no sign is doubted, beside a delay too."""
    said, named = remarks_of(tmp_path, late)
    assert said == [] and set(named) == {"leakage", "compressibility"}


@pytest.mark.parametrize("wrong", ["leakage", pytest.param("compressibility", marks=pytest.mark.slow)])
def test_a_candidate_of_the_wrong_sign_is_said(tmp_path, wrong):
    """It is not named, and what it would take with the other sign is said; the other candidate's sign is not doubted."""
    said, named = remarks_of(
        tmp_path, leak=-1 if wrong == "leakage" else 1, compliance=-1 if wrong == "compressibility" else 1
    )
    assert wrong not in named
    assert len(said) == 1 and said[0].startswith(f"with the other sign {wrong} would take ")


def test_a_delay_that_took_a_wrong_signs_place_does_not_hide_it(tmp_path):
    """Aligned, the delay does most of what the compressibility would have done: it is said all the same, with the delay's shift."""
    said, named = remarks_of(tmp_path, late=True, compliance=-1)
    assert "compressibility" not in named
    assert any(one.startswith("with the other sign compressibility would take") and "delays" in one for one in said)


def test_a_declared_term_of_the_wrong_sign_is_said(tmp_path):
    """The ram's area with its column the wrong way round: far from its declaration, and its other sign takes most."""
    said, _ = remarks_of(tmp_path, area="-velocity_m_s")
    assert len(said) == 1 and said[0].startswith("with the other sign area would take 100%")
