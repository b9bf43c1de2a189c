"""The linear model of `hx.linearize`, against MuJoCo's own derivatives and the linear loop."""

import json

import mujoco
import numpy as np
import pytest

import hexsim as hx
from hexsim.motion_computer import loop_model
from hexsim.plant import Plant
from hexsim.plant.states import A

NO_DRY_FRICTION = {f"friction.{kind}_{way}_N": 0.0 for kind in ("coulomb", "static") for way in ("extend", "retract")}
MPa = 1e6  # pressures inside MuJoCo
STEPS = {"pressure": 1e3, "velocity": 1e-5, "spool": 1e-8}


class Derivatives:
    """Central differences of MuJoCo's rates about neutral, valves open as in the linear model, at rest."""

    def __init__(self, machine, extends):
        self.plant = Plant(machine, model="tendon")
        self.jacobian = machine.mechanics.jacobian(np.zeros(6)) if machine.is_hexapod else np.ones((1, 1))
        laps = (
            [machine.valve.overlap_m or 0.0] if machine.valve.overlap_edges_m is None else machine.valve.overlap_edges_m
        )
        self.places = {
            name: self.plant.layout[0, place] for name, place in (("pressure", A.PRESSURE), ("spool", A.SPOOL))
        }
        opening = (max(0.0, *laps, 0.0) + 0.01 * machine.valve.spool_travel_max_m) * (1 if extends else -1)
        for leg in range(machine.n_legs):
            self.plant.data.act[int(self.plant.layout[leg, A.SPOOL])] = opening

    def rates(self):
        """Pressure rates [Pa/s] and leg accelerations [m/s2] of all legs."""
        plant = self.plant
        mujoco.mj_forward(plant.model, plant.data)
        return plant.data.act_dot[plant.pressure_places] * MPa, self.jacobian @ plant.data.qacc

    def along(self, state, leg, step):
        """Both, by a change of a state of one leg (from 0)."""
        found = []
        for sign in (1.0, -1.0):
            act, speed = self.plant.data.act.copy(), self.plant.data.qvel.copy()
            if state == "velocity":
                self.plant.data.qvel[:] = np.linalg.solve(self.jacobian, sign * step * np.eye(len(self.jacobian))[leg])
            else:
                place = self.plant.layout[leg, A.PRESSURE if state == "pressure" else A.SPOOL]
                self.plant.data.act[int(place)] += sign * step / (MPa if state == "pressure" else 1.0)
            found.append(self.rates())
            self.plant.data.act[:], self.plant.data.qvel[:] = act, speed
        return [(up - down) / (2 * step) for up, down in zip(*found, strict=True)]


def test_a_linear_model_is_drawn_and_kept(tmp_path):
    """The response is the transfer function: pistons of the bench integrate the volts at low frequency, as the pole at zero has
    it, and the acceleration is w^2 of them. The folder has matrices and names; an unknown output is named."""
    model = hx.linearize("bench")
    place, acceleration = (model.outputs.index(name) for name in ("position_m", "acceleration_m_s2"))
    low, high = model.response([0.01, 20.0])[:, :, 0]
    assert abs(model.response([0.02])[0, place, 0] / low[place]) == pytest.approx(0.5, rel=1e-3)
    assert high[acceleration] == pytest.approx(-((2 * np.pi * 20.0) ** 2) * high[place], rel=1e-6)
    kept = json.loads((model.to_folder(tmp_path / "linear") / "linear.json").read_text())
    assert np.array_equal(kept["A"], model.A) and kept["outputs"] == list(model.outputs)
    assert (tmp_path / "linear" / "response.png").read_bytes() == model.plot("acceleration_m_s2").png
    with pytest.raises(hx.HexsimError, match="no picture 'acceleration': did you mean acceleration_m_s2"):
        model.plot("acceleration")


@pytest.mark.parametrize("extends", (True, False))
@pytest.mark.parametrize("name", ("bench", "micro_motion_system", "servo_hexapod"))
def test_slopes_are_those_of_mujoco(name, extends):
    """Pressure rates and leg accelerations along pressure, speed and spool of a leg: those of MuJoCo with the hydraulics.

    Within 1 %: the legs' masses are lumped, and the four-way valve of the linear model moves.
    """
    machine = hx.load_machine(name).with_(NO_DRY_FRICTION)
    model, plant, n = hx.linearize(machine, extends=extends), Derivatives(machine, extends), machine.n_legs
    mark = (lambda stem, unit: f"{stem}_{unit}") if n == 1 else (lambda stem, unit: f"{stem}_2_{unit}")
    rows = [
        [i for i, state in enumerate(model.states) if state.startswith(stem)]
        for stem in ("pressure_bottom", "velocity")
    ]
    leg = 0 if n == 1 else 1
    for state, column in (
        ("pressure", mark("pressure_bottom", "Pa")),
        ("velocity", mark("velocity", "m_s")),
        ("spool", mark("spool", "m")),
    ):
        by_model = model.A[:, model.states.index(column)]
        for own, told in zip(rows, plant.along(state, leg, STEPS[state]), strict=True):
            size = max(np.abs(told).max(), np.abs(by_model[own]).max())
            assert np.abs(by_model[own] - told).max() <= 0.01 * size, (state, by_model[own], told)


def test_displaced_load_pulls_back_or_falls():
    """Along a displacement of the platform the legs accelerate as MuJoCo's platform does with its pressures held."""
    machine = hx.load_machine("micro_motion_system").with_(NO_DRY_FRICTION)
    model, plant = hx.linearize(machine), Derivatives(machine, True)
    own = [[i for i, state in enumerate(model.states) if state.startswith(stem)] for stem in ("position", "velocity")]
    step = 1e-5
    found = []
    for sign in (1.0, -1.0):
        plant.plant.data.qpos[1] = sign * step
        found.append(plant.rates()[1])
    told = (found[0] - found[1]) / (2 * step)
    moved = model.A[np.ix_(own[1], own[0])] @ plant.jacobian[:, 1]
    assert np.abs(moved - told).max() < 0.02 * np.abs(told).max()


def test_modes_of_a_bench_are_those_of_its_loop_model():
    """The poles of one leg, sampled, are those that stability margins are computed from."""
    model = hx.linearize("servo_bench")
    sampled = next(loop for loop in loop_model.loops(hx.load_machine("servo_bench")) if loop.extends)
    poles = np.exp(model.poles * sampled.tick_s)
    assert np.sort(np.abs(poles)) == pytest.approx(np.sort(np.abs(np.linalg.eigvals(sampled.plant[0]))), rel=1e-6)


def test_outputs_belong_together():
    """In a pose: the platform's pose is what the pistons' positions make of it, to first order, and units are named."""
    at = {"z": 0.03, "roll": 0.04, "yaw": -0.05}
    model, mechanics = hx.linearize("micro_motion_system", at), hx.load_machine("micro_motion_system").mechanics
    pose = np.array([0.0, 0.0, 0.03, 0.04, 0.0, -0.05])
    positions = [model.outputs.index(f"position_{leg}_m") for leg in range(1, 7)]
    platform = [i for i, name in enumerate(model.outputs) if name.startswith("platform_")]
    states = [model.states.index(f"position_{leg}_m") for leg in range(1, 7)]
    step = 1e-5
    for k in range(6):
        moved = pose + step * np.eye(6)[k]
        change = (mechanics.inverse(moved) - mechanics.inverse(2 * pose - moved)) / (2 * step)
        state = np.zeros(len(model.states))
        state[states] = change
        assert (model.C @ state)[platform] == pytest.approx(np.eye(6)[k], abs=1e-6)
        assert (model.C @ state)[positions] == pytest.approx(change)
    units = model.units
    assert {units[name] for name in model.inputs} == {"V"} and units["angular_acceleration_x_rad_s2"] == "rad/s2"
    assert pytest.approx(model.A) == hx.linearize("micro_motion_system", pose).A


def test_to_control_answers_as_the_matrices_do():
    """`to_control` is the same system by python-control: names, and the response at a frequency."""
    pytest.importorskip("control")
    model = hx.linearize("bench")
    made, omega = model.to_control(), 2j * np.pi * 7.0
    by_hand = model.C @ np.linalg.solve(omega * np.eye(len(model.A)) - model.A, model.B) + model.D
    assert made(omega)[:, 0] == pytest.approx(by_hand[:, 0]) and tuple(made.input_labels) == model.inputs
    assert "modes" not in repr(model) and "mode [Hz]" in model._repr_html_()
