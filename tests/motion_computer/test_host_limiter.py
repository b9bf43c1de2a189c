"""Setpoints that leave a host: whatever made them, they are within the machine's limits, as legs and as platform."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hexsim import HexsimError
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer import host_limiter, host_packet
from hexsim.tracing.design import motions

MACHINES = {name: load_machine(name) for name in ("bench", "micro_motion_system")}
FIGURES = {"m": (0.3, 3.0, 300.0), "rad": tuple(np.radians([20.0, 150.0, 15_000.0]))}  # docs/identify.md


def derivatives(rows):
    """Differences of a motion that begins and ends at rest, written out: speed, acceleration, jerk."""
    x = np.concatenate([np.zeros((3, rows.shape[1])), rows, np.zeros((3, rows.shape[1]))])
    v = (x[1:] - x[:-1]) / host_limiter.PERIOD_s
    a = (v[1:] - v[:-1]) / host_limiter.PERIOD_s
    return v, a, (a[1:] - a[:-1]) / host_limiter.PERIOD_s


def assert_within(machine, rows, share=1.0):
    """By the figures of the page: legs clear of their cushions by 5 mm, legs and axes within speed, acceleration, jerk."""
    mechanics = machine.mechanics
    legs = mechanics.piston_positions(rows) if machine.is_hexapod else 0.5 * mechanics.stroke_m + rows[:, 2:3]
    clear = np.asarray(machine.cylinder.cushion_length_m) + 0.005
    assert (legs >= clear - 1e-9).all() and (legs <= machine.cylinder.stroke_m - clear + 1e-9).all()
    neutral = mechanics.neutral_positions
    judged = [(legs - neutral, "m")] + machine.is_hexapod * [(rows[:, :3], "m"), (rows[:, 3:], "rad")]
    for values, unit in judged:
        for found, limit in zip(derivatives(values), FIGURES[unit], strict=True):
            assert np.abs(found).max(initial=0.0) <= share * limit * (1.0 + 1e-5)


def any_motion(width):
    """Rows of anything: noise, jumps, constants, a metre and a thousand of them."""
    sizes = st.sampled_from([1e-4, 0.01, 0.1, 1.0, host_packet.LARGEST])
    return st.integers(1, 150).flatmap(
        lambda m: sizes.flatmap(lambda size: arrays(float, (m, width), elements=st.floats(-size, size)))
    )


@settings(max_examples=40, deadline=None)
@pytest.mark.parametrize("name", MACHINES)
@given(data=st.data())
def test_any_motion_in_one_within_the_limits_out(name, data):
    """Whatever comes in, what comes out keeps every figure, and passes again unchanged."""
    machine = MACHINES[name]
    axes = machine.mechanics.dof_places
    rows = np.zeros((150, 6))
    given_rows = data.draw(any_motion(len(axes)))
    rows[: len(given_rows), axes] = given_rows
    limiter = host_limiter.HostLimiter(machine)
    found = limiter.limit(rows)
    assert_within(machine, found)
    assert np.array_equal(limiter.limit(found), found)


@settings(max_examples=40, deadline=None)
@pytest.mark.parametrize("name", MACHINES)
@given(frequency=st.floats(0.05, 5.0), share=st.floats(0.01, 0.99), axis=st.integers(0, 5), phase=st.floats(0.0, 6.28))
def test_a_motion_within_the_limits_passes_unchanged(name, frequency, share, axis, phase):
    """A faded sine of any axis and frequency, scaled to a share of what is allowed, comes out to the bit."""
    machine = MACHINES[name]
    limiter = host_limiter.HostLimiter(machine)
    time = np.arange(400) * host_limiter.PERIOD_s
    fade = np.sin(np.pi * time / 4.0) ** 4
    rows = np.zeros((400, 6))
    rows[:, axis if machine.is_hexapod else 2] = 1e-3 * fade * np.sin(2 * np.pi * frequency * time + phase)
    rows *= share / limiter.share(rows)
    while limiter.share(rows) > 1.0:  # legs are not linear in the pose
        rows *= 0.99
    assert np.array_equal(limiter.limit(rows), rows)


@pytest.mark.parametrize("name", MACHINES)
def test_a_step_is_rounded_and_keeps_its_size(name):
    """20 mm within one packet and back: 2 m/s and 190 m/s2 as asked, within the limits and still 20 mm as sent."""
    machine = MACHINES[name]
    rows = np.zeros((200, 6))
    rows[50:150, 2] = 0.02
    found = host_limiter.HostLimiter(machine).limit(rows)
    assert_within(machine, found)
    assert found[:, 2].max() == pytest.approx(0.02, rel=0.03)


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("largest", [pytest.param(1.0, marks=pytest.mark.slow), 0.3])
def test_every_designed_motion_is_within_the_limits(name, largest):
    """Of every kind, first points and random ones, scaled by the largest share: no packet needs to be limited."""
    machine = MACHINES[name]
    family, made = motions.MotionFamily(machine, 20.0, largest=largest), set()
    low, high = np.transpose(family.bounds)
    points = [*family.first_points(16), *np.random.default_rng(5).uniform(low, high, (20, len(low)))]
    for point in points:
        tables = family.scenario(point)
        if tables is None:
            continue
        made.add(next(iter(tables["axes"].values()))["kind"])
        rows = host_limiter.setpoints_of(machine, tables)
        assert_within(machine, rows, largest)
        assert np.array_equal(host_limiter.HostLimiter(machine, largest).limit(rows), rows)
    assert made == set(motions.KINDS)


def test_the_limits_are_those_of_the_machine_file():
    """Half the acceleration and a tenth of the stroke in [host_limits]: kept by what the limiter lets out."""
    machine = changed(MACHINES["bench"], {"host_limits.acceleration_m_s2": 1.5, "host_limits.stroke_share": 0.1})
    rows = np.zeros((300, 6))
    rows[:, 2] = 0.05 * np.sin(np.pi * np.arange(300) / 100) ** 3
    found = host_limiter.HostLimiter(machine).limit(rows)
    assert 0.0 < np.abs(found).max() <= 0.1 * 0.095
    assert np.abs(derivatives(found)[1]).max() <= 1.5 * (1 + 1e-6)


@pytest.mark.parametrize(
    ("rows", "says"),
    [
        (np.full((9, 6), np.nan), "not finite"),
        (np.full((9, 6), np.inf), "not finite"),
        (np.full((9, 6), 2 * host_packet.LARGEST), "above 1000"),
        (np.zeros((9, 5)), "shape"),
        (np.ones((9, 6)), "x, y, roll, pitch, yaw"),
    ],
)
def test_what_is_no_motion_is_refused(rows, says):
    """Values that are not finite or absurd, a wrong shape, axes that a bench has not: a sentence each."""
    with pytest.raises(HexsimError, match=says):
        host_limiter.HostLimiter(MACHINES["bench"]).limit(rows)


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("kind", range(len(motions.KINDS)))
def test_a_motion_that_is_broken_off_ends_within_the_limits(name, kind):
    """At any packet of a designed motion at its full size: what was sent and the way back keep every figure, end at neutral."""
    machine = MACHINES[name]
    family, limiter = motions.MotionFamily(machine, 10.0), host_limiter.HostLimiter(machine)
    rows = host_limiter.setpoints_of(machine, family.scenario(np.array([kind, 2, 1.0, 0.35, 0.6, 0.3, 2])))
    for k in range(1, len(rows), 83):
        sent = np.concatenate([np.zeros((host_limiter.MEMORY + 1, 6)), rows[:k]])
        back = limiter.way_back(sent[-host_limiter.MEMORY - 1 :], rows[k:])
        assert_within(machine, np.concatenate([rows[:k], back]))


def test_no_row_beyond_the_limits_leaves():
    """The last gate: a jump is not sent, and neither is anything but neutral by a host that knows no machine."""
    gate = host_limiter.Gate(host_limiter.HostLimiter(MACHINES["bench"]))
    gate.let_out(np.zeros(6))
    with pytest.raises(HexsimError, match=r"acceleration of leg 1 is .* times what \[host_limits\] allows"):
        gate.let_out(np.array([0, 0, 0.005, 0, 0, 0]))
    with pytest.raises(HexsimError, match="was not sent"):
        gate.let_out(np.full(6, np.nan))
    assert not gate.sent.any()
    blind = host_limiter.Gate(None)
    blind.let_out(np.zeros(6))
    with pytest.raises(HexsimError, match="without the machine's declaration"):
        blind.let_out(np.array([0, 0, 1e-6, 0, 0, 0]))
