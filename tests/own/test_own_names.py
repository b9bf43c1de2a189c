"""Names of machines of one's own: a form is proven against free forms, a memory against all memories."""

import numpy as np
import polars as pl
import pytest

from hexsim.inference.search import search
from hexsim.own.folder import load_simulated
from hexsim.own.trace import Simulated
from hexsim.own.trace_files import trace_simulated

DRIVE = """
[runs]
fit = ["one", "two", "three"]
[signals]
command = { quantity = "voltage", hold = true }
[parameters]
damping = { start = 1.2, sign = 1 }
stiffness = { start = 18.0, sign = 1 }
[states.x]
rate = "v"
[states.v]
quantity = "force"
sum = "20 * command - damping * v - stiffness * x"
[outputs.x]
formula = "x"
[simulation]
scheme = "heun"
steps = 2
"""
DT, N = 0.04, 250


def run(seed: int, place_damping: float, play: float) -> pl.DataFrame:
    """Written apart: mass 1, damping 1.5 + place_damping x^2, spring 20, play of the drive; 20 semi-implicit steps a sample."""
    rng = np.random.default_rng(seed)
    t = np.arange(N) * DT
    command = sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in rng.uniform(0.1, 1.2, 5)) / 2
    x, v, held = 0.0, 0.0, command[0]
    seen = np.zeros(N)
    for k in range(N):
        seen[k] = x
        held = min(max(held, command[k] - 0.5 * play), command[k] + 0.5 * play)
        for _ in range(20):
            v += DT / 20 * (20 * held - (1.5 + place_damping * x * x) * v - 20 * x)
            x += DT / 20 * v
    return pl.DataFrame({"time_s": t, "command": command, "x": seen + 0.003 * rng.standard_normal(N)})


def traced(place, **missing: float):
    """The trace of three runs, its files in place/out."""
    (place / "model.toml").write_text(DRIVE)
    for seed, name in enumerate(("one", "two", "three")):
        run(seed, **{"place_damping": 0.0, "play": 0.0} | missing).write_csv(place / f"{name}.csv")
    return trace_simulated(place, out=place / "out")[0]


@pytest.mark.timeout(300)
def test_damping_over_place_is_no_friction(tmp_path):
    """Where damping grows with the place, which no effect of the library says, an effect gains and nothing is named: a free form beside
    it finds the rest. What gains stays in the model all the same, for with it held-out motion is predicted better, and the verdict says
    what it is. The formula x^2 v is stated with its coefficient; its file, put to the machine's, is an effect that is named."""
    trace = traced(tmp_path, place_damping=4.0)
    assert trace.steps == []
    stand_ins = [one.title for one in trace.found.refused if "its form is open" in one.why]
    assert stand_ins and {one.title for one in trace.found.in_model} == set(stand_ins)
    assert f"likely, not proven: {stand_ins[0]} (in the model, its form is open)" in trace.verdict
    assert sum(trace.found.final_held.density) > sum(trace.found.base_held.density)
    assert set(trace.found.in_model[0].numbers) <= set(trace.declaration.parameters)
    assert "formula beyond the library: x**2 * v in v" in trace.verdict
    fitted = trace.formula.best.fitted
    assert fitted.value("form_amount_v") == pytest.approx(4.0, abs=4 * fitted.error("form_amount_v"))
    with (tmp_path / "model.toml").open("a") as file:
        file.write((tmp_path / "out" / "effect.toml").read_text())
    with_it = search(Simulated(load_simulated(tmp_path)), most=1)
    assert [step.title for step in with_it.steps] == ["x**2 * v in v"]


def test_play_is_backlash_and_no_lag(tmp_path):
    """Play of a drive is named as such, alone and with its width: every memory is fitted, whatever a linear look foretells."""
    trace = traced(tmp_path, play=0.15)
    assert [step.candidate.name for step in trace.steps] == ["backlash of a drive"]
    assert trace.steps[0].tied == []
    width = next(name for name in trace.final.names if name.startswith("play"))
    assert trace.final.value(width) == pytest.approx(0.15, abs=4 * trace.final.error(width))
