"""What every algorithm promises, whatever it computes."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from leg_plant import Leg, run

import compensation
from compensation import Compensator, Context, Sample

NAMES = [
    "none", "exact", "iterative", "iterative_report_1", "iterative_report_2", "buffered", "buffered_report",
    "buffered_two_sided", "adaptive", "repetitive",
]  # fmt: skip


def sample(count: int, **changes) -> Sample:
    """A sound sample at rest, with changes."""
    values = dict(
        time_s=0.0, setpoint_m=0.1, preview_m=np.full(count, 0.1), position_m=0.1, control_V=0.0, valve_V=0.0,
        pressure_bottom_Pa=3.3e6, pressure_supply_Pa=7e6,
    )  # fmt: skip
    return Sample(**{**values, **changes})


def test_every_name_is_there() -> None:
    """The registry lists these algorithms, plain control first."""
    assert compensation.available()[: len(NAMES)] == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_volts_are_finite_and_bounded_for_any_signal(name) -> None:
    """2000 samples of absurd signals, NaN and infinity among them: the answer is a finite number within +-10 V."""
    made = compensation.create(name)
    context = Context()
    state = made.start(context)
    rng = np.random.default_rng(1)
    count = compensation.preview_count(made, context)
    absurd = [math.nan, math.inf, -math.inf, 0.0, 1e300, -1e300, 1e-300]
    for _ in range(2000):
        values = rng.normal(0, 1, 6) * 10.0 ** rng.integers(-6, 9, 6)
        for i in range(6):
            if rng.random() < 0.1:
                values[i] = absurd[rng.integers(len(absurd))]
        setpoint, position, control, valve, bottom, supply = (float(v) for v in values)
        added, state = made.step(state, sample(
            count, setpoint_m=setpoint, preview_m=np.clip(rng.normal(0.1, 0.05, count), -1, 1), position_m=position,
            control_V=control, valve_V=valve, pressure_bottom_Pa=bottom, pressure_supply_Pa=supply))  # fmt: skip
        assert math.isfinite(added) and abs(added) <= 10.0


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_added_at_first(name) -> None:
    """The very first tick adds less than 10 mV: everything is faded in."""
    made = compensation.create(name)
    context = Context()
    count = compensation.preview_count(made, context)
    added, _ = made.step(made.start(context), sample(count, position_m=0.09, control_V=0.5))
    assert abs(added) < 0.01


SCALARS = {
    "float64": np.float64,
    "float32": np.float32,
    "0-d array": np.array,
    "float32, whole numbers": lambda x: np.float32(round(x)),
    "bool": lambda x: np.bool_(x > 0.1),
}


@pytest.mark.parametrize(
    "scalar", ["float32", *(pytest.param(one, marks=pytest.mark.slow) for one in SCALARS if one != "float32")]
)
@pytest.mark.parametrize("name", NAMES)
def test_numpy_scalars_give_the_volts_of_floats(name, scalar) -> None:
    """5 s of motion with every number of the sample a numpy scalar, the preview with its type: the same volts, to the
    bit and as Python floats, as with Python floats of the same values."""
    made, of = compensation.create(name), SCALARS[scalar]
    context = Context(period_s=2.0)
    count = compensation.preview_count(made, context)
    t = np.arange(2500 + count) / context.rate_Hz
    wanted = 0.1 + 0.05 * np.sin(math.pi * t)
    rng = np.random.default_rng(0)
    states = [made.start(context), made.start(context)]
    for k in range(2500):
        control = 0.3 * math.cos(math.pi * t[k]) + 0.01 * rng.normal()
        numbers = of(t[k]), of(wanted[k]), of(wanted[k] - 0.02 * control), of(control), of(0.9 * control)
        pressures = of(3.3e6 + 1e5 * control + 4e3 * rng.normal()), of(7e6 + 4e3 * rng.normal())
        ahead = np.array([of(x) for x in wanted[k : k + count]])
        volts = []
        for i, kind in enumerate((lambda x: x, float)):
            values = [kind(x) for x in (*numbers, *pressures)]
            numpy_or_float = ahead if i == 0 else np.array([float(x) for x in ahead])
            asked = Sample(values[0], values[1], numpy_or_float, *values[2:])
            added, states[i] = made.step(states[i], asked)
            volts.append(added)
        assert volts[0] == volts[1]
        assert type(volts[0]) is float


@pytest.mark.parametrize("name", [n for n in NAMES if n != "none"])
def test_learned_parameters_survive_json(name) -> None:
    """parameters -> JSON -> restore -> parameters gives the same numbers, after 6 s of motion."""
    made = compensation.create(name)
    state = run(made, duration_s=6.0).state
    known = made.parameters(state)
    text = json.dumps(known, allow_nan=False)
    again = made.parameters(made.restore(Context(period_s=2.0), json.loads(text)))
    known.pop("table_V", None), again.pop("table_V", None)  # a table of one run's phase does not outlive it
    assert json.dumps(again) == json.dumps(known)


def test_one_instance_serves_six_actuators() -> None:
    """States are apart: a leg run beside another, through one instance, answers as if alone."""
    made = compensation.create("adaptive")
    alone = run(made, duration_s=4.0, seed=3)
    run(made, Leg(overlap_m=2e-5), duration_s=4.0, seed=4)
    again = run(made, duration_s=4.0, seed=3)
    assert np.array_equal(alone.added_V, again.added_V)


def test_the_package_stands_alone() -> None:
    """Importing compensation and every algorithm brings in neither hexsim nor mujoco nor scipy, and needs none of them.

    numba compiles the adaptive step; it looks for scipy by itself, so scipy is hidden here.
    """
    code = (
        "import sys; sys.modules['scipy'] = None; import compensation\n"
        "[compensation.create(n) for n in compensation.available() if ':' not in n]\n"
        "bad = {'hexsim', 'mujoco', 'scipy', 'pandas', 'polars'} & {n.split('.')[0] for n, m in sys.modules.items() if m}\n"
        "assert not bad, bad\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


class _Lacking(Compensator):
    name = "lacking"

    def start(self, context):
        return None


class _Stranger:
    def step(self, state, sample):
        return 0.0, state


def test_own_classes_are_loaded_or_told_what_they_lack() -> None:
    """module:Class loads; a class without methods, a stranger, no class, a wrong module and a wrong name each get a
    sentence."""
    here = __name__
    sys.modules.setdefault(here, sys.modules[__name__])
    with pytest.raises(TypeError, match="lacks parameters, restore, step"):
        compensation.create(f"{here}:_Lacking")
    with pytest.raises(
        TypeError, match=r"not derived from compensation.Compensator and lacks start, parameters, restore"
    ):
        compensation.create(f"{here}:_Stranger")
    with pytest.raises(TypeError, match="is a list"):
        compensation.create(f"{here}:NAMES")
    with pytest.raises(ValueError, match="cannot be imported"):
        compensation.create("no_such_module:Thing")
    with pytest.raises(ValueError, match="has no 'Thing'; it has _Lacking"):
        compensation.create(f"{here}:Thing")
    with pytest.raises(ValueError, match="no compensator is called 'nothing'; there are none, exact"):
        compensation.create("nothing")
    with pytest.raises(TypeError, match="cannot be made with speed"):
        compensation.create("adaptive", speed=3)


def test_context_refuses_impossible_numbers() -> None:
    """A negative rate or a period that is no number names the field."""
    with pytest.raises(ValueError, match="rate_Hz is -1"):
        Context(rate_Hz=-1)
    with pytest.raises(ValueError, match="period_s is nan"):
        Context(period_s=math.nan)
