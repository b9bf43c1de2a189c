"""What is left follows a signal, or none: by curves on unseen blocks, against a null."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hexsim as hx
from hexsim.signals import channels
from hexsim.tracing import rules
from hexsim.tracing.predictable import predicted
from hexsim.tracing.report import content
from hexsim.tracing.steps import declared_refit, noise_only
from hexsim.tracing.steps import logs as trace_logs

DATA = Path(__file__).parents[1] / "data"
RATE, N = 1000.0, 20000


def sure(found):
    return [own for own in found if own.share > rules.SLIGHT and own.above > rules.ERRORS]


def runs(rng, count=2, colour=0.0):
    """Noise of two channels, and two signals of many frequencies, of `count` runs. colour: of the noise's low-pass pole."""
    rests, signals = [], []
    t = np.arange(N) / RATE
    for _ in range(count):
        white = rng.standard_normal((2, N))
        for k in range(1, N) if colour else ():
            white[:, k] = colour * white[:, k - 1] + np.sqrt(1.0 - colour**2) * white[:, k]
        f, phase = rng.uniform(0.2, 6.0, (2, 12)), rng.uniform(0.0, 6.3, (2, 12))
        waves = np.mean(np.sin(2 * np.pi * f[..., None] * t + phase[..., None]), axis=1)
        waves /= waves.std(axis=1, keepdims=True)
        rests.append(white)
        signals.append({"first": waves[0], "second": waves[1]})
    return rests, signals, [{name: np.gradient(x) for name, x in own.items()} for own in signals]


@pytest.mark.parametrize(
    ("part", "form"),
    [
        (lambda x: 0.1 * x, "plain"),
        (lambda x: 0.15 * (np.abs(x) - np.abs(x).mean()), "plain"),
        (lambda x: 0.25 * x * np.gradient(x) / np.std(np.gradient(x)), "product"),
    ],
)
def test_a_tenth_of_the_noise_that_follows_a_signal_is_found(part, form):
    """In its channel, over its signal, in its form, and in no other channel: 1 % of the variance of a sample."""
    rests, signals, velocities = runs(np.random.default_rng(1))
    for rest, own in zip(rests, signals, strict=True):
        rest[0] += part(own["second"])
    [found] = sure(predicted(("a", "b"), rests, signals, velocities, RATE))
    assert (found.channel, found.signal, found.form) == ("a", "second", form)
    assert 0.03 < found.share < 0.4 and "what is left of a follows second" in found.sentence


@pytest.mark.parametrize("colour", [0.0, 0.97])
def test_noise_follows_nothing(colour):
    """White, or with a correlation of 30 ms: of 6 draws of two channels none."""
    for seed in range(6):
        assert sure(predicted(("a", "b"), *runs(np.random.default_rng(seed), colour=colour), RATE)) == []


@pytest.mark.parametrize(("delay_s", "low", "high"), [(20e-6, 0.0, 0.02), (1e-3, 0.88, 0.92)])
def test_a_small_delay_of_a_channel_itself_is_not_told(delay_s, low, high):
    """What 20 us of a channel's own delay leave is taken off; of a whole sample's delay only the tenth that a log may have;
    another signal's part stays."""
    rests, signals, velocities = runs(np.random.default_rng(4))
    late = [rest.copy() for rest in rests]
    for rest, own, speed in zip(late, signals, velocities, strict=True):
        rest[0] += delay_s * 1000.0 * RATE * speed["first"]
        rest[1] += 0.1 * own["first"]
    named = [{"a": 1000.0 * own["first"], "b": own["second"], **own} for own in signals]
    left = noise_only.without_own(("a", "b"), late, named, RATE, np.ones(2))

    def part(of, k):
        return np.std(np.concatenate([one[k] - two[k] for one, two in zip(of, rests, strict=True)]))

    assert low <= part(left, 0) / part(late, 0) <= high
    assert part(left, 1) == pytest.approx(0.1, rel=0.05)


@pytest.mark.slow
def test_nothing_missing_is_not_said_of_a_transducer_that_reads_another_pressure_too():
    """A measured bench stays quiet; 0.3 % of the chamber's pressure in the supply's reading, a quarter of its noise, is told."""
    trace = trace_logs.begin(DATA / "bench_none", ["fit", "sweep"], ["validate"])
    trace = replace(declared_refit.STEP.run(trace, lambda doing: None), verdict="nothing missing")
    quiet = noise_only.hold_against_signals(trace, lambda doing: None)
    assert quiet.verdict == "nothing missing" and "follows no signal" in quiet.decided and not content.remarks(quiet)
    logs = tuple(replace(log, supply=log.supply + 0.003 * (log.pressure[0] - 3.5e6)) for log in trace.fit_problem.logs)
    told = noise_only.hold_against_signals(
        replace(trace, fit_problem=replace(trace.fit_problem, logs=logs)), lambda doing: None
    )
    assert told.verdict == "unexplained" and told.predicted[0].channel == "pressure_supply_Pa"
    assert told.predicted[0].signal in channels.channel_arrays(logs[0]) and told.predicted[
        0
    ].sentence in content.remarks(told)
    small = replace(trace, verdict="explained", fit_problem=replace(trace.fit_problem, logs=logs))
    unsure = noise_only.hold_against_signals(
        small, lambda doing: None
    )  # what the noise could hide, and something follows a signal
    assert unsure.verdict == "unexplained" and unsure.final is trace.base and "is not sure" in unsure.decided
    far = replace(trace.base, misfit=[2.0 * rest for rest in trace.base.misfit])
    assert noise_only.hold_against_signals(replace(small, base=far), lambda doing: None).verdict == "explained"


@pytest.mark.slow
def test_a_small_payload_mode_is_no_constant_force(tmp_path):
    """2.25 kg of 40 on a spring at 8 Hz, which a multisine below 6 Hz hides in the noise: a constant force of -15 N takes
    eight times as much by its column, and three quarters as much once both are refitted. The payload is named, with its numbers."""
    from other_plant import write_machine

    write_machine(tmp_path, 3021, {"flexible_payload": 0.056365}, runs=("fit", "validate"), suffix=".csv")
    found = hx.trace(tmp_path)
    assert found.verdict == "explained"
    (effect,) = found.report["effects"]
    assert effect["name"] == "flexible_payload" and not effect["tied_with"]
    assert effect["parameters"]["mass_kg"] == pytest.approx(2.255, rel=0.03)
    assert effect["parameters"]["frequency_Hz"] == pytest.approx(8.0, rel=0.01)
