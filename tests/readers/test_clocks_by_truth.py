"""Logs with a known clock: the base is never worse than the stamps were, jitter of an even clock goes, no hole is bridged."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hexsim import readers
from hexsim.readers import files, reader

LENGTH_s = 6.0
W = 2 * np.pi * 0.7
SIGNALS = {  # value and rate of each at t [s]
    "position_m": (lambda t: 0.1 + 0.038 * np.sin(W * t - 0.2), lambda t: 0.038 * W * np.cos(W * t - 0.2)),
    "pressure_bottom_Pa": (lambda t: 3.4e6 + 3e5 * np.sin(W * t + 0.5), lambda t: 3e5 * W * np.cos(W * t + 0.5)),
    "acceleration_m_s2": (lambda t: -0.7 * np.sin(W * t - 0.2), lambda t: -0.7 * W * np.cos(W * t - 0.2)),
    "pressure_supply_Pa": (lambda t: 1e7 + 2e5 * np.sin(W * t), lambda t: 2e5 * W * np.cos(W * t)),
    "valve_V": (lambda t: 0.9 * np.cos(W * t), lambda t: -0.9 * W * np.sin(W * t)),
}
NOISE = 1e-5  # of a signal's size
ALLOWED_s = 2e-5  # error of times by the noise of the signals and by interpolation


@dataclass(kw_only=True)
class Clock:
    """One clock of a made-up log.

    jitter: of the stamps of even samples, in periods. wander: of the samples themselves, a random walk of the steps, in
    periods. drift: relative change of the period over the log. hole: (first, length) [s] or None. wrap: the counter's end
    [s] or 0. step_s: resolution. markers: runs of -9999. backwards: newest row first.
    """

    rate_Hz: float
    phase: float = 0.0
    jitter: float = 0.0
    wander: float = 0.0
    drift: float = 0.0
    hole: tuple[float, float] | None = None
    wrap: float = 0.0
    step_s: float = 0.0
    markers: list[tuple[float, int]] = field(default_factory=list)
    backwards: bool = False

    def made(self, names: list[str], rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """(true times, stamps, values)."""
        n = int(LENGTH_s * self.rate_Hz)
        steps = (1.0 + self.drift * np.linspace(0, 1, n)) * (1.0 + self.wander * np.clip(rng.standard_normal(n), -2, 2))
        true = (self.phase + np.cumsum(steps) - steps[0]) / self.rate_Hz
        if self.hole is not None:
            true = true[(true < self.hole[0]) | (true > self.hole[0] + self.hole[1])]
        stamps = true + self.jitter / self.rate_Hz * rng.standard_normal(len(true))
        if self.step_s:
            stamps = np.round(stamps / self.step_s) * self.step_s
        values = {}
        for name in names:
            x = SIGNALS[name][0](true)
            x = x + NOISE * np.ptp(x) * rng.standard_normal(len(x))
            for place, length in self.markers:
                first = int(place * len(x))
                x[first : first + length] = -9999.0 if name != "valve_V" else x[first]
            values[name] = x
        if self.wrap:
            stamps = np.mod(stamps + self.wrap - 3.0, self.wrap)
        if self.backwards:
            return true, stamps[::-1], {name: x[::-1] for name, x in values.items()}
        return true, stamps, values


class Made(reader.Reader):
    """A format that holds what a test put there."""

    name, suffixes = "made-up", (".made",)
    signals: list[reader.RawSignal]

    def read(self, path, layout):
        return reader.RawLog(signals=self.signals)


@pytest.fixture(scope="module")
def read(tmp_path_factory):
    """Read clocks with the names of their signals: (stretches, what each clock really was)."""
    path, made = tmp_path_factory.mktemp("made") / "run.made", Made()
    path.write_text("")
    known = files.readers()
    files.readers.cache_clear()
    files.readers()[".made"] = made

    def read(clocks: list[Clock], seed: int = 1):
        rng, made.signals, truth = np.random.default_rng(seed), [], {}
        for k, clock in enumerate(clocks):
            names = list(SIGNALS)[k : k + 1] if k + 1 < len(clocks) else list(SIGNALS)[k:]
            true, stamps, values = clock.made(names, rng)
            made.signals += [
                reader.RawSignal(name=name, values=x, stamps={"clock": stamps}) for name, x in values.items()
            ]
            truth |= {name: (clock, true, stamps) for name in names}
        return readers.read_stretches(path, readers.Mapping(kind="bench")), truth

    yield read
    files.readers.cache_clear()
    files.readers().update({key: one for key, one in known.items() if key != ".made"})


def time_error(log, name: str, offset: float) -> np.ndarray:
    """How far the times of a column are off [s], by what it reads, where it moves."""
    value, rate = SIGNALS[name]
    t = log.time - offset
    error, slope = log.columns[name] - value(t), rate(t)
    moving = (np.abs(slope) > 0.5 * np.max(np.abs(slope))) & (log.weight(name) > 0)
    return error[moving] / slope[moving]


def hold_to_truth(parts, truth) -> None:
    """The three claims."""
    base = max(truth.values(), key=lambda one: one[0].rate_Hz)
    offset = 0.0 if not base[0].wrap else float(base[2][-1 if base[0].backwards else 0] - base[1][0])
    for name, (clock, true, _) in truth.items():
        if name == "valve_V":  # held between its samples
            continue
        errors = np.concatenate([time_error(log, name, offset) for log in parts])
        stamp_s = np.hypot(clock.jitter / clock.rate_Hz, clock.step_s / np.sqrt(12))
        even = clock.wander == 0 and stamp_s > 0
        allowed = stamp_s / 3 if even else stamp_s
        spread = np.std(errors - np.mean(errors)) if even else np.sqrt(np.mean(errors**2))
        assert spread <= allowed + ALLOWED_s + 4 * stamp_s / np.sqrt(len(true)), (name, clock, spread, allowed)
        assert np.sqrt(np.mean(errors**2)) <= 1.2 * stamp_s + clock.step_s / 2 + ALLOWED_s, (name, clock)
        if clock.hole is not None:
            first, last = clock.hole[0] + 2 / clock.rate_Hz, clock.hole[0] + clock.hole[1] - 2 / clock.rate_Hz
            late = 5 * stamp_s
            for log in parts:
                t = log.time - offset
                inside = (t > first + late) & (t < last - late)
                assert not np.any(inside & (log.weight(name) > 0)), (name, clock)


ALONE = {
    "even": Clock(rate_Hz=1000.0),
    "even, odd rate": Clock(rate_Hz=187.3, phase=0.3),
    "jitter 1 %": Clock(rate_Hz=500.0, jitter=0.01),
    "jitter 10 %": Clock(rate_Hz=500.0, jitter=0.1),
    "jitter 40 %": Clock(rate_Hz=1000.0, jitter=0.4),
    "jitter and a hole": Clock(rate_Hz=500.0, jitter=0.2, hole=(2.0, 0.4)),
    "jitter and drift": Clock(rate_Hz=1000.0, jitter=0.2, drift=2e-3),
    "drift": Clock(rate_Hz=1000.0, drift=5e-3),
    "software loop": Clock(rate_Hz=187.0, wander=0.1),
    "software loop with a hole": Clock(rate_Hz=400.0, wander=0.15, hole=(2.5, 1.0)),
    "software loop and a little jitter": Clock(rate_Hz=400.0, wander=0.1, jitter=0.02),
    "stamps of 1 ms at 400 Hz": Clock(rate_Hz=400.0, step_s=1e-3),
    "stamps of 10 ms at 1 kHz": Clock(rate_Hz=1000.0, step_s=1e-2),
    "counter of 32 bits in us": Clock(rate_Hz=500.0, wrap=2.0**32 * 1e-6),
    "counter of 16 bits in ms": Clock(rate_Hz=500.0, wrap=65.536, step_s=1e-3),
    "past midnight": Clock(rate_Hz=500.0, wrap=86_400.0),
    "newest first": Clock(rate_Hz=500.0, backwards=True),
    "newest first, wrapped": Clock(rate_Hz=500.0, backwards=True, wrap=2.0**32 * 1e-6),
    "markers": Clock(rate_Hz=500.0, markers=[(0.3, 1), (0.5, 3), (0.7, 40)]),
}


@pytest.mark.parametrize("kind", ALONE)
@pytest.mark.parametrize("seed", [1, 2])
def test_one_clock(read, kind, seed):
    """Each kind alone: the times come back."""
    hold_to_truth(*read([ALONE[kind]], seed))


@st.composite
def clocks(draw) -> Clock:
    """Any mixture of what a clock does."""
    way = draw(st.sampled_from(["even", "jittered", "loop"]))
    hole = draw(st.booleans())
    return Clock(
        rate_Hz=draw(st.sampled_from([100.0, 187.3, 400.0, 500.0, 1000.0])),
        phase=draw(st.floats(0.0, 1.0)),
        jitter=draw(st.floats(0.005, 0.4)) if way == "jittered" else 0.0,
        wander=draw(st.floats(0.02, 0.2)) if way == "loop" else 0.0,
        drift=draw(st.sampled_from([0.0, 1e-4, 2e-3])),
        hole=(draw(st.floats(1.5, 3.0)), draw(st.floats(0.15, 1.0))) if hole else None,
        markers=draw(st.lists(st.tuples(st.floats(0.1, 0.9), st.integers(1, 9)), max_size=2)),
    )


@settings(max_examples=60, derandomize=True, database=None, deadline=None, suppress_health_check=list(HealthCheck))
@given(several=st.lists(clocks(), min_size=2, max_size=5), seed=st.integers(0, 99))
def test_several_clocks(read, several, seed):
    """Two to five clocks together, each with its own faults."""
    hold_to_truth(*read(several, seed))
