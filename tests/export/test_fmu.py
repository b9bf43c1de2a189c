"""The plant as an FMU: what FMPy says of it, and that it is `Plant`."""

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from hexsim import HexsimError
from hexsim.cli import app
from hexsim.hydraulics import chamber
from hexsim.hydraulics.resolve import resolve
from hexsim.machine import load_machine, machine_from_dict
from hexsim.machine.files import changed, machine_tables
from hexsim.plant import Plant, readout
from hexsim.signals import table as signal_table

pytest.importorskip("ziglang", reason="the export compiles C with the wheel `ziglang`: pip install hexsim[fmu]")
fmpy = pytest.importorskip("fmpy", reason="FMPy runs the FMU: pip install hexsim[fmu]")
from fmpy import fmi2  # noqa: E402
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

from hexsim import export  # noqa: E402

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the export needs MuJoCo's Linux library")
STEP = 0.002  # [s] communication step
TICKS = 60
SAME = 1e-12  # of each signal's size
TWO_WAYS = 1e-7  # tendons: the FMU steps them by MuJoCo, the plant by Newton and Euler; rounding grows with the motion
BY_RULE = 0.02  # the same with steps that an FMU takes by the rule, where the plant goes by the error of each step


class Fmu:
    """An FMU unpacked, its variables by name, and what its instances said to the logger."""

    def __init__(self, path: Path, folder: Path) -> None:
        self.folder = fmpy.extract(str(path), unzipdir=str(folder))
        self.description = fmpy.read_model_description(self.folder)
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.outputs = [v.name for v in self.description.modelVariables if v.causality == "output"]
        self.inputs = [v.name for v in self.description.modelVariables if v.causality == "input"]
        self.said: list[str] = []
        self.parameters: list = []  # as the export says

    def instance(self, parameters: dict[str, float] | None = None, stop_time: float | None = None) -> FMU2Slave:
        """A slave before the end of its initialisation."""
        slave = FMU2Slave(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
            instanceName="one",
        )
        slave.instantiate(callbacks=self._callbacks())
        slave.setupExperiment(stopTime=stop_time)
        self.initialise(slave, parameters or {})
        return slave

    def initialise(self, slave: FMU2Slave, parameters: dict[str, float]) -> None:
        slave.enterInitializationMode()
        slave.setReal([self.references[name] for name in parameters], list(parameters.values()))
        slave.exitInitializationMode()

    def run(self, slave: FMU2Slave, volts: np.ndarray, first: int = 0) -> np.ndarray:
        """Outputs before each of the steps under `volts` (steps, n_legs)."""
        references = [self.references[name] for name in self.outputs]
        rows = []
        for k, command in enumerate(volts):
            rows.append(slave.getReal(references))
            slave.setReal([self.references[name] for name in self.inputs], [float(u) for u in command])
            slave.doStep((first + k) * STEP, STEP)
        return np.array(rows)

    def _callbacks(self):
        def logger(environment, instance, status, category, message):
            self.said.append(message.decode())

        callbacks = fmi2.fmi2CallbackFunctions()
        callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(logger)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self._kept = callbacks
        return callbacks


def volts_of(n_legs: int, ticks: int = TICKS) -> np.ndarray:
    t = np.arange(ticks)[:, None] * STEP
    leg = np.arange(n_legs)
    return np.round((0.8 + 0.1 * leg) * np.sin(2 * np.pi * (4 + 0.7 * leg) * t), 3)


def by_plant(machine, model: str, volts: np.ndarray, timestep: float | None) -> np.ndarray:
    """The same outputs by `Plant`."""
    plant = Plant(machine, model=model, timestep=timestep)
    plant.prepare(1 / STEP, len(volts))
    for command in volts:
        plant.tick(command)
    r = plant.record
    time = np.arange(len(volts)) * STEP
    legs = readout.leg_signals(plant, time, r.qpos, r.qvel, r.act, r.spool_volts)
    top = [legs.pressure_top] if machine.cylinder.rod_side != "supply" else []
    found = [legs.position, legs.velocity, legs.pressure_bottom, *top, legs.supply_Pa[:, None]]
    if machine.is_hexapod:
        platform = readout.platform_signals(plant, r.qpos, r.qvel, r.qacc)
        found += [platform.pose, platform.acceleration, platform.angular_acceleration]
    else:
        found += [r.qacc]
    return np.concatenate(found, axis=1)


def worst_difference(names: list[str], found: np.ndarray, wanted: np.ndarray) -> float:
    """Of all signals, over the largest value of the signal in any leg or along any axis."""
    assert found.shape == wanted.shape
    kinds = np.array([signal_table.kind_of(name) for name in names])
    sizes = np.array([np.abs(wanted[:, kinds == kind]).max() for kind in kinds])
    assert (sizes > 1e-3).all()
    return float((np.abs(found - wanted) / sizes).max())


EFFECTS = {
    "effects.valve_delay.delay_s": 0.004,
    "effects.valve_hysteresis.half_width_V": 0.05,
    "valve.hysteresis_percent": 1.0,
    "valve.threshold_percent": 0.4,
    "effects.supply_droop.line_resistance_Pa_s_m3": 1e9,
}
# Machine, model, changes, constant time step [s]; None: chosen.
MACHINES = {
    "bench": ("bench", "full", {}, 1e-4),
    "tendon": ("micro_motion_system", "tendon", {}, 1e-4),
    "full": ("servo_hexapod", "full", {}, 1e-4),
    "power_unit": ("micro_motion_system/power_unit", "tendon", {}, 1e-4),
    "effects": ("bench", "full", EFFECTS, 1e-4),
    "full_chosen": ("micro_motion_system", "full", {}, None),
    "power_unit_chosen": ("micro_motion_system/power_unit", "tendon", {}, None),
    "effects_chosen": ("bench", "full", EFFECTS, None),
}


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    """One export of each machine that is asked for."""
    made: dict[str, tuple[Path, Fmu]] = {}

    def get(name: str) -> tuple[Path, Fmu]:
        if name not in made:
            folder = tmp_path_factory.mktemp(name)
            source, model, changes, step = MACHINES[name]
            machine = changed(load_machine(source), changes)
            variables = export.export_fmu(machine, folder / "machine.fmu", model=model, timestep=step)
            made[name] = folder / "machine.fmu", Fmu(folder / "machine.fmu", folder / "unpacked")
            made[name][1].parameters = variables.parameters
        return made[name]

    return get


BY_CI = ("bench", "power_unit")  # full legs and tendons, with a pump and without; chosen steps are in test_systems.py


@pytest.mark.parametrize(
    "name", [name if name in BY_CI else pytest.param(name, marks=pytest.mark.slow) for name in MACHINES]
)
def test_outputs_are_those_of_the_plant(fmus, name):
    """Volts in: every output is that of `Plant` at the same constant step within 1e-12 of its size (tendons, which the two
    step in their own ways: 1e-7); with chosen steps within 2 %, which jolts of a millisecond in the acceleration take, for the plant's
    steps go by their error."""
    source, model, changes, step = MACHINES[name]
    machine = changed(load_machine(source), changes)
    _, fmu = fmus(name)
    volts = volts_of(machine.n_legs)
    found, wanted = fmu.run(fmu.instance(), volts), by_plant(machine, model, volts, step)
    assert np.ptp(wanted[:, 0]) > 1e-3
    same = TWO_WAYS if model == "tendon" else SAME
    assert worst_difference(fmu.outputs, found, wanted) < (same if step else BY_RULE)


def test_a_chamber_that_cavitates_is_that_of_the_plant(fmus):
    """A valve that shuts at speed: the FMU's pressure stays at that of vapour as the plant's does, and collapses as it."""
    volts = np.where(np.arange(300) < 75, 5.0, 0.0)[:, None]
    _, fmu = fmus("bench")
    found, wanted = fmu.run(fmu.instance(), volts), by_plant(load_machine("bench"), "full", volts, 1e-4)
    bottom = fmu.outputs.index("pressure_bottom_Pa")
    assert found[:, bottom].min() == chamber.VAPOUR
    assert worst_difference(fmu.outputs, found, wanted) < SAME


@pytest.fixture(scope="module")
def own_legs(hexapod):
    """The 600 kg machine with joints of its own, legs longer than their transducers say, and two legs that differ."""
    base = hexapod.mechanics.base_joints.copy()
    base[1] += [1e-2, -2e-2, 5e-3]
    tables = machine_tables(hexapod) | {
        "geometry": {
            "base_joints_m": base.tolist(),
            "platform_joints_m": hexapod.mechanics.platform_joints.tolist(),
            "neutral_leg_length_m": 0.7,
            "leg_zero_offsets_m": [0.0, 0.0, 1.2e-3, 0.0, -5e-4, 0.0],
        },
        "leg": [
            {"number": 3, "cylinder": {"piston_diameter_m": 0.045}, "friction": {"coulomb_extend_N": 95.0}},
            {"number": 6, "valve": {"overlap_m": 2e-5}},
        ],
    }
    return machine_from_dict(tables)


@pytest.mark.parametrize(
    "changes",
    [pytest.param({}, marks=pytest.mark.slow), {"friction.coulomb_extend_N": 40.0, "load.platform_mass_kg": 550.0}],
)
def test_own_joints_and_legs_that_differ_are_those_of_the_plant(own_legs, changes, tmp_path):
    """Volts in: every output is that of `Plant` within 1e-7, rounding of two ways to step tendons; a parameter of the
    machine leaves alone the leg that has its own, as in machine.toml."""
    path = tmp_path / "own.fmu"
    export.export_fmu(own_legs, path, model="tendon", timestep=1e-4)
    fmu, volts = Fmu(path, tmp_path / "unpacked"), volts_of(6)
    found, wanted = fmu.run(fmu.instance(changes), volts), by_plant(changed(own_legs, changes), "tendon", volts, 1e-4)
    assert np.ptp(wanted[:, 2]) > 1e-3
    assert worst_difference(fmu.outputs, found, wanted) < TWO_WAYS


@pytest.mark.parametrize("name", BY_CI)
def test_fmpy_validates_it_without_a_message(fmus, name):
    """FMPy checks the archive against the schema and the standard's rules, and has nothing to say."""
    path, _ = fmus(name)
    assert validate_fmu(str(path)) == []


def test_fmpy_simulates_it_as_it_would_any_other(fmus):
    """`fmpy.simulate_fmu` with volts as a table: the piston moves as under the plain calls."""
    path, fmu = fmus("bench")
    volts = volts_of(1)
    table = np.zeros(TICKS, dtype=[("time", float), ("valve_V", float)])
    table["time"], table["valve_V"] = np.arange(TICKS) * STEP, volts[:, 0]
    found = fmpy.simulate_fmu(
        str(path), stop_time=(TICKS - 1) * STEP, step_size=STEP, output_interval=STEP, input=table
    )
    assert found["position_m"] == pytest.approx(fmu.run(fmu.instance(), volts)[:, 0], rel=1e-12)


# Each differs enough from the declared value to be seen in the outputs.
CHANGES = {
    "load.platform_mass_kg": 700.0,
    "supply.pressure_Pa": 8.0e6,
    "supply.tank_pressure_Pa": 2.0e5,
    "oil.bulk_modulus_Pa": 1.1e9,
    "valve.overlap_m": 2.0e-5,
    "valve.spool_frequency_Hz": 40.0,
    "valve.spool_diameter_m": 0.011,
    "valve.laminar_reynolds": 12.0,
    "friction.coulomb_extend_N": 90.0,
}


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("tendon", CHANGES),
        pytest.param("full", {"load.platform_mass_kg": 1100.0}, marks=pytest.mark.slow),
        pytest.param("effects", {"supply.pressure_Pa": 8.0e6}, marks=pytest.mark.slow),
        pytest.param("full_chosen", CHANGES, marks=pytest.mark.slow),
        pytest.param(
            "effects_chosen", {"supply.pressure_Pa": 8.0e6, "friction.sharpness_m_s": 1e-4}, marks=pytest.mark.slow
        ),
    ],
)
def test_parameters_of_the_machine_file_are_parameters_of_the_fmu(fmus, name, changes):
    """Set before the initialisation, all together: outputs are those of `Plant` with the changed machine within 1e-12,
    tendons within 1e-7 (two ways to step), full legs within 5e-11: the solver of their ball ends leaves the equilibrium open by
    1e-13 of the pressures.
    """
    source, model, with_effects, step = MACHINES[name]
    _, fmu = fmus(name)
    machine = changed(load_machine(source), with_effects | changes)
    volts = volts_of(machine.n_legs)
    wanted = by_plant(machine, model, volts, step)
    same = TWO_WAYS if model == "tendon" else SAME if machine.n_legs == 1 else 50 * SAME
    same = same if step else BY_RULE
    assert worst_difference(fmu.outputs, fmu.run(fmu.instance(changes), volts), wanted) < same
    declared = fmu.run(fmu.instance(), volts)
    assert worst_difference(fmu.outputs, declared, wanted) > 1e-3


@pytest.mark.parametrize("name", ["bench", pytest.param("full", marks=pytest.mark.slow)])
def test_each_parameter_is_the_key_of_the_machine_file(fmus, name):
    """Every parameter by itself, 1 % larger (or 1 % of its upper bound): the numbers that it changes are those of the
    machine file with that key, and no other number of the machine would change.
    """
    machine, parameters = load_machine(MACHINES[name][0]), fmus(name)[1].parameters
    assert len(parameters) >= 20
    for parameter in parameters[:-1]:  # the last one is the mass, which is in no row
        value = parameter.start * 1.01 or 0.01 * parameter.high
        rows = resolve(changed(machine, {parameter.name: value})).rows
        found = resolve(machine).rows
        for change in parameter.changes:
            if change.actuator < machine.n_legs:
                found[change.actuator, change.place] = change.offset + change.slope * value
        assert found == pytest.approx(rows, rel=1e-12, abs=0), parameter.name


def test_instances_in_one_process_do_not_disturb_each_other(fmus):
    """Two instances with other parameters, stepped in turn, and two machines at once: each as it is alone."""
    _, fmu = fmus("tendon")
    _, other = fmus("bench")
    volts = volts_of(6)
    alone = [fmu.run(fmu.instance(change), volts) for change in ({}, CHANGES)]
    instances, bench = [fmu.instance(), fmu.instance(CHANGES)], other.instance()
    together = [np.array([]).reshape(0, len(fmu.outputs))] * 2
    for k, command in enumerate(volts):
        for i, instance in enumerate(instances):
            together[i] = np.vstack([together[i], fmu.run(instance, command[None], k)])
        other.run(bench, command[None, :1], k)
    assert np.array_equal(alone[0], together[0])
    assert np.array_equal(alone[1], together[1])


def test_instances_in_threads_repeat_to_the_bit(fmus):
    """Four instances in four threads."""
    _, fmu = fmus("tendon")
    volts = volts_of(6)
    instances = [fmu.instance() for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda instance: fmu.run(instance, volts), instances))
    assert all(np.array_equal(one, found[0]) for one in found)


def test_reset_repeats_to_the_bit(fmus):
    """After a run with other parameters `reset` gives the declared machine in its first state."""
    _, fmu = fmus("effects")
    volts = volts_of(1)
    first = fmu.run(fmu.instance(), volts)
    slave = fmu.instance({"supply.pressure_Pa": 8.0e6})
    fmu.run(slave, volts)
    slave.reset()
    fmu.initialise(slave, {})
    assert np.array_equal(fmu.run(slave, volts), first)


@pytest.mark.parametrize(
    "name", ["tendon", *(pytest.param(name, marks=pytest.mark.slow) for name in ("effects", "full"))]
)
def test_a_kept_state_goes_on_to_the_bit(fmus, name):
    """A state kept in mid-motion, set again in the same instance, or written out and read by another one."""
    _, fmu = fmus(name)
    volts = volts_of(len(fmu.inputs))
    slave = fmu.instance()
    fmu.run(slave, volts[:20])
    state = slave.getFMUstate()
    text = slave.serializeFMUstate(state)
    first = fmu.run(slave, volts[20:], 20)
    slave.setFMUstate(state)
    assert np.array_equal(fmu.run(slave, volts[20:], 20), first)
    other = fmu.instance()
    other.setFMUstate(other.deSerializeFMUstate(text))
    assert np.array_equal(fmu.run(other, volts[20:], 20), first)
    slave.freeFMUstate(state)


REFUSED = {
    "friction.coulomb_extend_N": (-1.0, "friction.coulomb_extend_N = -1: 0 to "),
    "valve.edge_rounding_m": (1e-12, "valve.edge_rounding_m = 1e-12: 0, or 1e-09 to 0.01 is possible"),
    "oil.density_kg_m3": (np.nan, "oil.density_kg_m3 = nan: 500 to 2000 is possible"),
    "load.moving_mass_kg": (1e5, "leg 1 needs "),
    "supply.tank_pressure_Pa": (9e6, "leg 1 needs "),
    "valve_V": (np.inf, "volts of valve 1 are inf"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_bad_number_is_refused_through_the_logger(fmus, name):
    """Outside its range, or a machine that cannot stand: an error, and the sentence in the log names it."""
    value, sentence = REFUSED[name]
    _, fmu = fmus("bench")
    fmu.said.clear()
    with pytest.raises(FMICallException, match="status 3"):
        fmu.instance({name: value})
    assert len(fmu.said) == 1
    assert fmu.said[0].startswith(sentence)


def test_each_parameter_is_refused_beyond_its_bounds(fmus):
    """Every parameter, below its lower and above its upper bound: one sentence that begins with its name."""
    _, fmu = fmus("tendon")
    bounds = {
        v.name: (float(v.min), float(v.max)) for v in fmu.description.modelVariables if v.causality == "parameter"
    }
    slave = fmu.instance()
    slave.reset()
    for name, (low, high) in bounds.items():
        for value in (low - 0.01 * max(abs(low), 1.0), 1.01 * high):
            fmu.said.clear()
            with pytest.raises(FMICallException):
                slave.setReal([fmu.references[name]], [value])
            assert fmu.said[0].startswith(f"{name} = ")


def test_steps_and_times_that_do_not_go_are_refused(fmus):
    """A communication step that is no multiple of the time step; a parameter in flight; a state of another machine."""
    _, fmu = fmus("bench")
    fmu.said.clear()
    slave = fmu.instance()
    with pytest.raises(FMICallException):
        slave.doStep(0.0, 2.5e-4)
    with pytest.raises(FMICallException):
        slave.setReal([fmu.references["friction.coulomb_extend_N"]], [80.0])
    with pytest.raises(FMICallException):
        slave.deSerializeFMUstate(b"0123456789abcdef")
    assert "communication step 0.00025 s is not a whole multiple of the time step 0.0001 s" in fmu.said[0]
    assert "fixed once the FMU is initialised" in fmu.said[1]
    assert "16 bytes are no state of this FMU" in fmu.said[2]


def test_it_does_not_go_beyond_its_stop_time(fmus):
    """FMI: who has named a stop time gets an error for a step beyond it, and the FMU says so; a step that ends there, its time
    summed with rounding, goes; without a stop time every step goes."""
    _, fmu = fmus("bench")
    fmu.said.clear()
    slave = fmu.instance(stop_time=0.3)
    for begin in (0.0, 0.1, 0.1 + 0.1):
        slave.doStep(begin, 0.1)
    with pytest.raises(FMICallException):
        slave.doStep(0.3, 0.1)
    assert "a step from 0.3 to 0.4 s, beyond the stop time of 0.3 s" in fmu.said[0]
    free = fmu.instance()
    free.doStep(0.0, 0.1)
    free.doStep(0.1, 0.1)


@pytest.mark.parametrize("name", BY_CI)
def test_it_is_small_and_native(fmus, name):
    """Below 5 MB; binaries for Linux and the description, nothing that Python would run."""
    path, fmu = fmus(name)
    assert path.stat().st_size < 5e6
    kinds = {file.suffix for file in Path(fmu.folder).rglob("*") if file.is_file()}
    assert kinds == {".xml", ".so", ".4"}


def test_every_variable_has_its_unit(fmus):
    """As at the end of its name; roots and ratios have none."""
    _, fmu = fmus("tendon")
    units = {v.name: v.unit for v in fmu.description.modelVariables}
    assert units["valve_1_V"] == "V"
    assert units["acceleration_z_m_s2"] == "m/s2"
    assert units["friction.viscous_extend_N_s_m"] == "N.s/m"
    assert {name for name, unit in units.items() if unit is None} == {
        "cylinder.rod_side_conductance_m3_s_sqrtPa",
        "valve.discharge_coefficient",
        "valve.spool_damping",
        "valve.laminar_reynolds",
    }


def test_the_command_writes_it(tmp_path):
    """`hexsim export fmu MACHINE --out FILE --linux-only`; a step that is none is a sentence and leaves no file."""
    out = tmp_path / "bench.fmu"
    command = ["export", "fmu", "bench", "--what", "plant", "--linux-only", "--out", str(out), "--json"]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout)["outputs"] == 5 and json.loads(done.stdout)["systems"] == ["linux64"]
    assert out.stat().st_size < 5e6
    bad = CliRunner().invoke(app, ["export", "fmu", "bench", "--out", str(tmp_path / "no.fmu"), "--timestep", "0.1"])
    assert bad.exit_code == 2
    assert "a time step of 0.1 s: 1e-6 to 1e-3 is possible" in bad.output
    assert list(tmp_path.iterdir()) == [out]


def test_without_the_compiler_the_sentence_says_what_to_install(bench, tmp_path, monkeypatch):
    """The wheel `ziglang` is an extra."""
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(HexsimError, match=r"pip install hexsim\[fmu\]"):
        export.export_fmu(bench, tmp_path / "no.fmu")
    assert list(tmp_path.iterdir()) == []
