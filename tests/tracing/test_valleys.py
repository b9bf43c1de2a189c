"""A refit comes to the end of a valley along which two numbers trade, or says how far its end may be."""

from dataclasses import replace

import numpy as np
import pytest

from hexsim.hydraulics import chamber
from hexsim.machine import load_machine
from hexsim.signals.log import Log
from hexsim.tracing.fitting import fit as least_squares
from hexsim.tracing.fitting import parameters
from hexsim.tracing.problems import problem as problems

TRUE_PA, AIR, START, NOISE = 1.5e9, 0.02, 0.012, 0.03
PRESSURES_PA = np.linspace(3.0e6, 3.6e6, 4)
TIME_S = np.arange(400) * 1e-3


class Ringing(problems.FitProblem):
    """Oil that rings at 100 Hz and the root of its modulus, at four pressures: a tone is told by its phase alone."""

    logs = (Log(name="ringing", kind="bench", time=TIME_S, rate=1000.0),)
    noise = np.random.default_rng(1).standard_normal((4, len(TIME_S)))

    def channels(self, i):
        return [f"at {pressure:g} Pa" for pressure in PRESSURES_PA]

    def used(self, i):
        return len(TIME_S)

    def residual(self, machine, i):
        air = machine.model_dump()["effects"]["entrained_air"]["volume_fraction"]
        return (tones(TRUE_PA, AIR) - tones(machine.oil.bulk_modulus_Pa, air)) / NOISE + self.noise


def tones(modulus_Pa: float, air: float) -> np.ndarray:
    """(n_pressures, n)"""
    stiff = [
        chamber.bulk_modulus(pressure, modulus_Pa, air) / chamber.bulk_modulus(pressure, TRUE_PA, AIR)
        for pressure in PRESSURES_PA
    ]
    return np.sin(200.0 * np.pi * np.sqrt(stiff)[:, None] * TIME_S)


def test_a_refit_comes_to_the_end_of_a_valley():
    """Begun with less air in softer oil that rings alike at the middle pressure: the truth within a hundredth and four standard
    errors, which are those of the tones' derivatives, within a third."""
    machine, problem = load_machine("bench"), Ringing()
    modulus = replace(
        parameters.priors(machine)[0], key="bulk_modulus_Pa", dotted="oil.bulk_modulus_Pa", declared=TRUE_PA
    )
    middle = float(np.mean(PRESSURES_PA))
    shares = np.linspace(0.9, 1.0, 10_001)
    like = [chamber.bulk_modulus(middle, share * TRUE_PA, START) for share in shares]
    softer = float(np.interp(chamber.bulk_modulus(middle, TRUE_PA, AIR), like, shares))
    begun = least_squares.Fit(
        machine=machine,
        priors=(replace(modulus, half_width=0.1),),
        deviations=np.array([softer - 1.0]),
        candidates=(parameters.named("entrained_air"),),
        values=({"volume_fraction": START},),
        chi2=np.inf,
        n=0,
        misfit=[],
    )
    found = least_squares.refine(least_squares.evaluate(begun, problem), problem, stated=True)
    off, error = found.values[0]["volume_fraction"] - AIR, found.standard_errors()[0]["volume_fraction"]
    assert abs(off) < min(0.01 * AIR, 4.0 * error)
    steps = ((1e-6 * TRUE_PA, 0.0), (0.0, 1e-6 * AIR))
    X = np.stack([(tones(TRUE_PA + e, AIR + a) - tones(TRUE_PA - e, AIR - a)).ravel() / 2e-6 / NOISE for e, a in steps])
    assert error == pytest.approx(AIR * np.linalg.inv(X @ X.T)[1, 1] ** 0.5, rel=0.33)
