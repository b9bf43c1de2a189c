"""The machine with its motion computer as an FMU: setpoints in, what a run without sensor noise gives out."""

import ctypes
import sys
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from compensation import compensator, create
from hexsim import HexsimError, load_scenario
from hexsim.cli import app
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.motion_computer import leg_load
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.plant import Plant
from hexsim.simulation import simulate

pytest.importorskip("ziglang", reason="the export compiles C with the wheel `ziglang`: pip install hexsim[fmu]")
fmpy = pytest.importorskip("fmpy", reason="FMPy runs the FMU: pip install hexsim[fmu]")
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

from hexsim import export  # noqa: E402
from hexsim.export import native  # noqa: E402

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the export needs MuJoCo's Linux library")
TICK = 0.002
SILENT = {f"sensors.{name}": 0.0 for name in ("position_noise_m", "pressure_noise_Pa", "acceleration_noise_m_s2")}
CONTROL = {
    "controller.velocity_feed_forward_V_s_per_m": 5.0,
    "controller.integral_time_s": 2.0,
    "controller.pressure_feedback_V_per_Pa": 1e-8,
}
STEP = 1e-4  # [s] constant: chosen steps go by a rule in an FMU, by their error in a run
CASES = {
    "bench": ("bench", {}),
    "controllers": ("servo_hexapod", CONTROL),
}


@pytest.mark.parametrize(
    "name", ["bench", *(pytest.param(name, marks=pytest.mark.slow) for name in CASES if name != "bench")]
)
def test_it_is_a_run_without_noise(name, tmp_path):
    """Heave and roll together on a hexapod: legs' setpoints, volts, positions and pressures are those of `simulate`
    with the same time step within 1e-12 of their size on a bench, within 1e-7 on a hexapod, whose tendons the FMU steps by MuJoCo and
    the run by Newton and Euler."""
    source, changes = CASES[name]
    machine = changed(load_machine(source), SILENT | changes | {"sensors.position_resolution_m": 0.0})
    path, n = tmp_path / "machine.fmu", machine.n_legs
    export.export_fmu(machine, path, what="machine", model="tendon", timestep=STEP)
    assert validate_fmu(str(path)) == []
    scenario = replace(load_scenario("combined" if machine.is_hexapod else "heave"), duration_s=0.6, fade_s=0.2)
    log = simulate(machine, scenario, fast=True, timestep=STEP).log
    every = round(TICK / (log["time_s"][1] - log["time_s"][0]))
    rows = log.gather_every(every)
    fmu = Slave(path, tmp_path / "unpacked")
    poses = scenario.evaluate(rows["time_s"].to_numpy())[0]
    inputs = poses if machine.is_hexapod else rows["setpoint_m"].to_numpy()[:, None]
    before, after = fmu.run(inputs)
    legs = [""] if n == 1 else [f"_{i}" for i in range(1, n + 1)]
    compared = [(before, f"position{i}_m", f"true_position{i}_m") for i in legs]
    compared += [(before, f"pressure_bottom{i}_Pa", f"true_pressure_bottom{i}_Pa") for i in legs]
    compared += [(after, f"valve{i}_V", f"valve{i}_V") for i in legs]
    compared += [(after, f"setpoint{i}_m", f"setpoint{i}_m") for i in legs if n > 1]
    for found, ours, theirs in compared:
        wanted = rows[theirs].to_numpy()
        assert np.ptp(wanted) > 0
        assert np.abs(found[ours] - wanted).max() < (1e-7 if n > 1 else 1e-12) * np.abs(wanted).max(), ours


class Slave:
    """An instance that is initialised, and its variables by name."""

    def __init__(self, path, folder, parameters=None) -> None:
        unpacked = fmpy.extract(str(path), unzipdir=str(folder))
        description = fmpy.read_model_description(unpacked)
        self.variables = {v.name: v for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=unpacked,
            instanceName="one",
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment()
        for name, value in (parameters or {}).items():
            self.fmu.setReal([self.variables[name].valueReference], [value])
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def run(self, inputs: np.ndarray) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Outputs before and after each tick."""
        outputs = {name: v.valueReference for name, v in self.variables.items() if v.causality == "output"}
        taken = [v.valueReference for v in self.variables.values() if v.causality == "input"]
        seen = [self.fmu.getReal(list(outputs.values()))]
        for k, values in enumerate(inputs.tolist()):
            self.fmu.setReal(taken, values)
            self.fmu.doStep(k * TICK, TICK)
            seen.append(self.fmu.getReal(list(outputs.values())))
        columns = np.array(seen).T
        before, after = columns[:, :-1], columns[:, 1:]
        return dict(zip(outputs, before, strict=True)), dict(zip(outputs, after, strict=True))


@pytest.mark.slow
def test_the_compensator_inside_is_the_one_of_a_run(tmp_path):
    """11 s of the bench with `compensator.adaptive` = 1, written by the command line: volts, positions and pressures are
    those of a run with `adaptive` that is told no future, within 1e-10; without the parameter those of plain control."""
    machine = changed(load_machine("bench"), SILENT | {"sensors.position_resolution_m": 0.0})
    path, settings = tmp_path / "machine.fmu", [f"{key}={value}" for key, value in SILENT.items()]
    arguments = [
        "export",
        "fmu",
        "bench",
        "--what",
        "machine",
        "--linux-only",
        "--timestep",
        str(STEP),
        "--out",
        str(path),
    ]
    for setting in [*settings, "sensors.position_resolution_m=0.0"]:
        arguments += ["--set", setting]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert validate_fmu(str(path)) == []
    scenario = replace(load_scenario("heave"), duration_s=11.0)
    for switch, made in ((1.0, create("adaptive", preview_s=0.0)), (0.0, "none")):
        log = simulate(machine, scenario, compensator=made, timestep=STEP).log
        rows = log.gather_every(round(TICK / (log["time_s"][1] - log["time_s"][0])))
        fmu = Slave(path, tmp_path / f"unpacked_{switch:g}", {"compensator.adaptive": switch})
        before, after = fmu.run(rows["setpoint_m"].to_numpy()[:, None])
        added = np.abs(rows["compensation_V"].to_numpy()).max()
        assert (added > 0.1) == (switch == 1.0)
        for found, theirs in ((before["position_m"], "true_position_m"), (after["valve_V"], "valve_V")):
            wanted = rows[theirs].to_numpy()
            assert np.abs(found - wanted).max() < 1e-10 * np.abs(wanted).max(), theirs


def test_states_steps_and_sensors_of_a_motion_computer(bench, tmp_path):
    """A state kept in mid-motion goes on to the bit, the controllers' memory with it; half a tick is refused; so is a
    machine whose sensor is late."""
    path = tmp_path / "machine.fmu"
    export.export_fmu(changed(bench, {"controller.integral_time_s": 1.0}), path, what="machine")
    fmu = Slave(path, tmp_path / "unpacked")
    start = float(fmu.variables["setpoint_m"].start)
    inputs = start + 0.02 * np.sin(0.1 * np.arange(60))[:, None]
    fmu.run(inputs[:20])
    state = fmu.fmu.getFMUstate()
    first = fmu.run(inputs[20:])[1]
    fmu.fmu.setFMUstate(state)
    again = fmu.run(inputs[20:])[1]
    assert all(np.array_equal(first[name], again[name]) for name in first)
    fmu.fmu.freeFMUstate(state)
    with pytest.raises(FMICallException):
        fmu.fmu.doStep(1.0, 0.5 * TICK)
    late = changed(bench, {"effects.position_delay.delay_s": 0.002})
    with pytest.raises(HexsimError, match="late or filtered"):
        export.export_fmu(late, path, what="machine")


def test_the_compensators_inside_feel_all_legs():
    """A hexapod's legs about neutral, 30 ticks of random motion and pressures: forces and speeds of five ticks ago, mobility and load
    of the pose are those of `PoseLoad` within 1e-12 of the largest, in SI, from the first tick on."""
    plant = Plant(load_machine("servo_hexapod"), model="tendon")
    n, load = plant.n_legs, leg_load.ExpectedLoad.of(plant.resolved)
    context = compensator_context(plant.machine, None, 1, load)
    rng, watch, by_pose = np.random.default_rng(0), native.watch_legs(plant), leg_load.PoseLoad.of(plant.resolved, load)
    places = load.neutral + 0.02 * np.cumsum(rng.normal(0.0, 0.1, (30, n)), axis=0)
    bottom, top, supply = rng.uniform(2e6, 4e6, (30, n)), rng.uniform(2e6, 4e6, (30, n)), np.array([7e6])
    seen, found = np.zeros((leg_load.SPAN, 2, n)), [np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n)]
    forces = bottom * context.area_bottom_m2 - (top if context.four_way else supply) * context.area_top_m2
    for k in range(30):
        arrays = (places[k].copy(), bottom[k].copy(), top[k].copy(), supply, seen, *found)
        watch.ctypes(*(one.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for one in arrays), float(k == 0))
        past = [max(k - leg_load.SPAN + 1 + i, 0) for i in range(leg_load.SPAN)]
        speeds, then = leg_load.SLOPE @ places[past] / TICK, past[compensator.MEASURED_TICKS]
        wanted = (*by_pose.at(places[then], speeds), forces[then], speeds)
        for ours, theirs in zip(found, wanted, strict=True):
            assert np.abs(ours - theirs).max() <= 1e-12 * max(np.abs(theirs).max(), 1.0)
