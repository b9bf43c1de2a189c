"""Nothing learned elsewhere enters an algorithm unchecked, and nothing leaves the guard that the declared valve cannot explain."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from leg_plant import run

import compensation
import hexsim as hx
from compensation import (
    Compensator,
    Context,
    Sample,
    check_parameters,
    compensator,
    guard,
    records,
    started,
    volts_bound,
)
from hexsim.machine import load_machine
from hexsim.motion_computer import compensator_packet
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.simulation.asked_compensators import AskedCompensators

CONTEXT = Context(edge_V=0.07, spool_frequency_Hz=60.0)
ODD = (None, math.nan, math.inf, -math.inf, "1", True, [], {}, 10**400, 1e308, -1e308)


@pytest.fixture(scope="module")
def learned() -> dict[str, Any]:
    """What `adaptive` has learned of a leg in 12 s."""
    made = compensation.create("adaptive")
    return json.loads(json.dumps(made.parameters(run(made, duration_s=12.0).state)))


def places(value: Any, place: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Of every number within tables and lists; of a long list the first and the last."""
    if isinstance(value, dict):
        return [found for key, inner in value.items() for found in places(inner, (*place, key))]
    if isinstance(value, list):
        return [found for i in sorted({0, len(value) - 1}) for found in places(value[i], (*place, i))]
    return [place]


def with_value(parameters: Any, place: tuple[Any, ...], value: Any) -> Any:
    """The tables and lists on the way to a place copied, and another value there."""
    copy, (first, *rest) = parameters.copy(), place
    copy[first] = with_value(parameters[first], tuple(rest), value) if rest else value
    return copy


def test_every_odd_number_is_refused_in_one_sentence(learned) -> None:
    """Each number of what was learned in turn, null, NaN, infinite, text, a truth value, a list, a table, huge: ValueError whose
    sentence names the place. As learned: taken."""
    made = compensation.create("adaptive")
    check_parameters(made, CONTEXT, learned)
    for place in places(learned):
        name = next(key for key in reversed(place) if isinstance(key, str))
        for odd in ODD:
            with pytest.raises(ValueError, match=name) as refused:
                check_parameters(made, CONTEXT, with_value(learned, place, odd))
            assert "\n" not in str(refused.value) and len(str(refused.value)) < 300


@pytest.mark.parametrize(
    ("place", "value", "sentence"),
    [
        (("numbers", "zeta"), 9.0, r"numbers\.zeta is 9; it must lie between -0\.15 and 2\.8"),
        (("numbers", "hold"), 1e5, r"numbers\.hold is 100000; it must lie between"),
        (("scale", "mass"), -1.0, r"scale\.mass is -1; it must lie between 0 and"),
        (("factor", 0), 0.0, r"factor\[0\] is 0; the factor's diagonal .* must be above zero"),
        (("factor",), [1.0] * 12, "factor must be a list of"),
        (("chi2", 0), -1.0, r"chi2\[0\] is -1"),
        (("noise", 1), 0.0, r"noise\[1\] is 0"),
        (("noise", 0), 1.0, r"noise\[0\] is 1"),
    ],
)
def test_what_no_machine_can_be_is_refused(learned, place, value, sentence) -> None:
    """A damping out of its range, more held force than the supply has, a negative scale, a factor without information or of another
    length, a negative misfit, no noise, and one beyond the stroke."""
    with pytest.raises(ValueError, match=sentence):
        check_parameters(compensation.create("adaptive"), CONTEXT, with_value(learned, place, value))


def test_what_is_missing_is_named(learned) -> None:
    """A scale without a name."""
    scale = {name: value for name, value in learned["scale"].items() if name != "zeta"}
    with pytest.raises(ValueError, match=r"scale\.zeta is missing"):
        check_parameters(compensation.create("adaptive"), CONTEXT, {**learned, "scale": scale})


@pytest.mark.parametrize("name", [name for name in compensation.available() if name != "none" and ":" not in name])
def test_the_gate_is_the_same_for_every_algorithm(name) -> None:
    """Own parameters are taken; none, a list, a missing and an odd number are refused by `restore` and by a start, whoever asks."""
    made = compensation.create(name)
    own = json.loads(json.dumps(made.parameters(run(made, duration_s=4.0).state)))
    made.restore(CONTEXT, own)
    for bad in (None, [], 3, *(with_value(own, place, math.nan) for place in places(own)[:6])):
        with pytest.raises(ValueError, match="start parameters of"):
            started.Started(made, bad).start(CONTEXT)


def test_files_and_packets_go_through_it(learned, tmp_path) -> None:
    """A null in a file and a NaN in a packet are refused, and the sentence names leg and number."""
    machine, algorithm = load_machine("bench"), "adaptive"
    path = tmp_path / "compensator.json"
    path.write_text(json.dumps({"compensator": algorithm, "legs": [learned]}))
    brief = {"scenario.duration_s": 0.2, "scenario.fade_s": 0.1}
    assert hx.run("heave", "bench", str(path), brief).summary["compensator"] == algorithm
    for place in (("numbers", "zeta"), ("noise", 1)):
        for odd in (None, math.nan, -1e308):
            bad = with_value(learned, place, odd)
            path.write_text(json.dumps({"compensator": algorithm, "legs": [bad]}))
            name = next(key for key in reversed(place) if isinstance(key, str))
            with pytest.raises(hx.HexsimError, match=f"leg 1.*{name}"):
                hx.run("heave", "bench", str(path), brief)
            with pytest.raises(hx.HexsimError, match=f"leg 1.*{name}"):
                AskedCompensators(machine).take(
                    compensator_packet.AskedCompensator(leg=1, n_legs=1, name=algorithm, parameters=bad)
                )


class Fixed(Compensator):
    """Adds what it was made with, and holds a number that its maker sets."""

    name = "fixed"
    volts_V = 0.0
    held = 0.0

    def start(self, context):
        return {"held": [np.zeros(3), self.held]}

    def step(self, state, sample):
        return self.volts_V, state

    def parameters(self, state):
        return {}

    def restore(self, context, parameters):
        return self.start(context)


def sample(setpoint_m: float = 0.1, **changes: Any) -> Sample:
    values = dict(
        time_s=0.0, setpoint_m=setpoint_m, preview_m=np.full(1, setpoint_m), position_m=0.1, control_V=0.0, valve_V=0.0,
        pressure_bottom_Pa=3.3e6, pressure_supply_Pa=7e6,
    )  # fmt: skip
    return Sample(**{**values, **changes})


def stepped(
    made: Compensator, count: int, context: Context = CONTEXT, start: Any = None
) -> tuple[list[float], list[str]]:
    """Volts and statuses of `count` ticks at rest, with transducers that live."""
    state, volts, said = made.start(context) if start is None else start, [], []
    for k in range(count):
        added, state = made.step(state, sample(position_m=0.1 + 1e-6 * (k % 2), pressure_bottom_Pa=3.3e6 + k % 2))
        volts.append(added)
        said.append(made.status(state))
    return volts, said


def guarded(volts_V: float = 0.0, held: float = 0.0) -> Compensator:
    made = compensation.create(f"{__name__}:Fixed")
    made.inner.volts_V, made.inner.held = volts_V, held  # type: ignore[attr-defined]
    return made


@pytest.mark.parametrize("held", [math.nan, math.inf])
def test_a_number_that_is_not_finite_anywhere_in_a_state_ends_compensation(held) -> None:
    """A state with one such number, whose volts are finite: none are added, and it is said."""
    volts, said = stepped(guarded(0.05, held), 200)
    assert max(map(abs, volts)) == 0.0 and said[0] == guard.SENTENCES[guard.Reason.NOT_FINITE]


@pytest.mark.parametrize("odd", [math.nan, math.inf, -math.inf])
def test_an_odd_number_is_seen_wherever_it_stands(odd) -> None:
    """In lists of numbers, of lists and of other things; large finite numbers, whose sum is not, are finite."""
    held = ([0.5, odd, 1.0], [1, odd], [[1.0], [2.0, odd]], (odd, -odd), [0.0, None, odd], [np.float64(1.0), odd])
    assert not any(compensator.all_finite(each) for each in held)
    assert all(compensator.all_finite(each) for each in ([1e308, 1e308], [], [0.5, None, "text"], [0.5, 10**400]))


def test_a_spoilt_state_leaves_finite_and_explained_volts(learned) -> None:
    """A NaN in any parameter value in use, and in every 997th double of the state of a leg that compensates: for 20 ticks no volts
    that are not finite or beyond what the declared valve explains; a NaN mass is said."""
    made = compensation.create("adaptive")
    state: Any = run(made, duration_s=6.0, state=made.restore(CONTEXT, learned)).state
    engaged = state.inner.states.copy()
    wanted = 0.1 + 0.05 * np.sin(2e-3 * math.pi * np.arange(40))
    most = volts_bound.lead_gain(60.0, 0.7) * (
        volts_bound.EDGE_MARGIN * CONTEXT.edge_V + volts_bound.GAIN_MARGIN / CONTEXT.velocity_gain_m_s_V * 0.16
    )
    first = engaged.dtype.fields["numbers"][1] // 8
    mass = first + list(learned["numbers"]).index("mass")
    doubles = [place for place, kind in enumerate(records.kinds(engaged.dtype)) if kind == "f8"]
    for place in (*range(first, first + len(learned["numbers"])), *doubles[::997]):
        state, said = made.restore(CONTEXT, learned), set()
        state.inner.states[:] = engaged
        state.inner.states.view("f8")[place] = math.nan
        for k in range(20):
            asked = sample(
                float(wanted[k]), preview_m=wanted[k : k + 15], position_m=float(wanted[k]) + 1e-6 * (k % 2),
                pressure_bottom_Pa=3.3e6 + k % 2,
            )  # fmt: skip
            added, state = made.step(state, asked)
            said.add(made.status(state))
            assert math.isfinite(added) and abs(added) <= most, place
        assert place != mass or guard.SENTENCES[guard.Reason.NOT_FINITE] in said


def test_no_more_than_the_declared_valve_explains() -> None:
    """An algorithm that asks for 10 V at rest: no tick more than the lead allows, the spool that the volts move within four times
    70 mV, after 50 ms plain control with a reason. 0.2 V, within it, pass as they are, for ever."""
    volts, said = stepped(guarded(10.0), 400)
    most = volts_bound.EDGE_MARGIN * CONTEXT.edge_V
    assert max(volts) <= most * volts_bound.lead_gain(60.0, 0.7) + 1e-12
    assert max(volts[3:]) <= most + 1e-12  # once the spool is there
    assert np.all(np.array(volts[45:270]) == 0.0) and guard.SENTENCES[guard.Reason.BEYOND] in said
    volts, said = stepped(guarded(0.2), 400)
    assert volts == [0.2] * 400 and not any(said)


def test_the_bound_of_the_volts_by_hand() -> None:
    """45 mV of overlap, 5 of rounding, 10 of hysteresis, -20 of null, 1.5 mm/s of leak and 10 um of oil in 3 ms through 0.15 m/s/V:
    e = 80 + 10 + 22.2 mV. A setpoint at 0.1 m/s adds twice its volts."""
    e = volts_bound.edge_V(0.045, 5e-3, 1e-2, -2e-2, 1.5e-3, 1e5, 1e-10, 0.15)
    assert e == pytest.approx(0.08 + 0.01 + 1e-5 / 3e-3 / 0.15)
    made, state = guarded(9.0), None
    state = made.start(CONTEXT)
    for k in range(20):
        added, state = made.step(
            state, sample(0.1 + 2e-4 * k, position_m=0.1 + 1e-6 * (k % 2), pressure_bottom_Pa=3.3e6 + k % 2)
        )
    assert added == pytest.approx(volts_bound.EDGE_MARGIN * 0.07 + volts_bound.GAIN_MARGIN * 0.1 / 0.15, rel=1e-6)


NUMBERS = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(
    max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow]
)
@given(data=st.data())
def test_any_start_parameters_and_any_samples_leave_bounded_volts(learned, data) -> None:
    """Up to three numbers of what was learned are anything: refused in a sentence, or the volts are finite and explained, whatever
    samples come."""
    made = compensation.create("adaptive")
    given_parameters = learned
    for place in data.draw(st.lists(st.sampled_from(places(learned)), max_size=3)):
        value = data.draw(st.one_of(NUMBERS, st.none(), st.floats(-1.0, 1.0), st.floats(0.0, 0.02)))
        given_parameters = with_value(given_parameters, place, value)
    try:
        state = made.restore(CONTEXT, given_parameters)
    except ValueError as refused:
        assert "start parameters of adaptive" in str(refused)
        state = made.start(CONTEXT)
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    absurd = data.draw(st.lists(NUMBERS, min_size=1, max_size=4))
    share = data.draw(st.sampled_from([0.0, 0.01, 0.3]))
    most = volts_bound.lead_gain(60.0, 0.7) * (
        volts_bound.EDGE_MARGIN * CONTEXT.edge_V + volts_bound.GAIN_MARGIN / CONTEXT.velocity_gain_m_s_V * 0.32
    )
    t = 0.002 * np.arange(400)
    wanted = 0.1 + 0.05 * np.sin(2 * math.pi * t)  # at most 0.314 m/s
    for k in range(380):
        values = [
            0.1 + 0.03 * math.sin(6 * t[k]) + 3e-6 * rng.normal(),
            rng.normal(),
            rng.normal(),
            3.3e6 + 1e5 * rng.normal(),
            7e6,
        ]
        values = [absurd[rng.integers(len(absurd))] if rng.random() < share else value for value in values]
        position, control, valve, bottom, supply = map(float, values)
        asked = sample(
            float(wanted[k]), preview_m=wanted[k : k + 15], position_m=position, control_V=control, valve_V=valve,
            pressure_bottom_Pa=bottom, pressure_supply_Pa=supply,
        )  # fmt: skip
        added, state = made.step(state, asked)
        assert math.isfinite(added) and abs(added) <= min(most, CONTEXT.voltage_max_V)


def test_the_declared_machines_leave_room() -> None:
    """On each shipped machine a leg's bound is above a dead band's volts and below a tenth of the valve's range."""
    for name in ("bench", "micro_motion_system", "servo_bench", "servo_hexapod"):
        context = compensator_context(load_machine(name), None)
        assert 0.01 < context.edge_V < 0.1 * context.voltage_max_V
        assert dataclasses.replace(context, edge_V=1.0).edge_V == 1.0
