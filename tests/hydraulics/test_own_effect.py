"""An effect of one's own is one file and an entry point: the machine runs with it, and tracing has it among its candidates."""

import sys

import numpy as np
import pytest

from hexsim import HexsimError
from hexsim.hydraulics import effects
from hexsim.machine import load_machine, machine_from_dict
from hexsim.scenarios import scenario_from_dict
from hexsim.simulation import simulate
from hexsim.tracing.fitting import parameters

FILE = """
from hexsim.hydraulics.effects import Effect, EffectParameter
from hexsim.hydraulics.parameters import P

EFFECT = Effect(
    name="{name}",
    balance="force",
    description="a damper beside the cylinder",
    source="test",
    parameters=(
        EffectParameter(
            name="damping_N_s_m", unit="N s/m", bounds=(0.0, 1e6), typical=500.0, slot=P.EXTRA_DAMPING
        ),
    ),
)
"""
MOTION = {
    "name": "short",
    "mode": "actuator",
    "duration_s": 2.0,
    "fade_s": 0.5,
    "axes": {"leg_1": {"kind": "sine", "amplitude": 0.02, "frequency_Hz": 1.0}},
}


def installed(folder, name: str) -> None:
    """A package of one module with an entry point, as pip would leave it."""
    (folder / "own_damper.py").write_text(FILE.format(name=name))
    info = folder / "own_damper-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-damper\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[hexsim.effects]\ndamper = own_damper:EFFECT\n")


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """The library as a new session finds it, with `tmp_path` among the installed packages; as before afterwards."""
    effects.library.cache_clear()
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    effects.library.cache_clear()
    sys.modules.pop("own_damper", None)


def test_a_file_and_an_entry_point_make_an_effect(fresh):
    """The damper slows the piston down, a machine file may carry it, and tracing would try it."""
    installed(fresh, "own_damper")
    bench = load_machine("bench")
    damped = machine_from_dict(
        bench.model_dump(exclude_none=True) | {"effects": {"own_damper": {"damping_N_s_m": 2e4}}}
    )
    scenario = scenario_from_dict(MOTION | {"machine_name": bench.name})
    reach = [np.ptp(simulate(machine, scenario).log["position_m"].to_numpy()) for machine in (bench, damped)]
    assert reach[1] < 0.98 * reach[0]
    (candidate,) = (c for c in parameters.candidates(bench) if c.effect.name == "own_damper")
    assert candidate.effect.parameters[0].unit == "N s/m"


def test_a_name_that_is_taken_is_refused(fresh):
    """Two effects of one name would hide each other: a sentence says which entry point to rename."""
    installed(fresh, "hose_compliance")
    with pytest.raises(HexsimError, match=r"entry point damper.*there is an effect hose_compliance already; rename it"):
        effects.library()
