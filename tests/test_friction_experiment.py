"""The report's experiment 2.3.3 from end to end: machine with power unit, sensors, scope, Stribeck parameters."""

import pytest

from hexsim import load_scenario, readers
from hexsim.files import log_files
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.sensors import measurement_chain
from hexsim.simulation import simulate
from hexsim.tracing.friction.identification import identify_friction

MEASURED = (
    "time_s",
    "setpoint_m",
    "position_m",
    "valve_V",
    "pressure_bottom_Pa",
    "pressure_supply_Pa",
    "acceleration_m_s2",
)


def test_the_scenario_holds_the_whole_experiment():
    """All levels fit into the scenario's duration, up to 0.1 m/s: a log that ends early knows no viscous part."""
    scenario = load_scenario("friction")
    signal = scenario.signals["z"]
    assert scenario.duration_s >= signal.period_s
    _, ends, velocities = signal.strokes()
    assert ends.max() < scenario.duration_s
    assert velocities.max() == pytest.approx(0.1) and velocities.min() == pytest.approx(-0.1)


@pytest.fixture(scope="module")
def experiment():
    """Bench with power unit, so that Ps moves as it does in reality."""
    machine = changed(load_machine("bench"), {"power_unit": {}})
    return machine, simulate(machine, load_scenario("friction"), seed=3).log.select(MEASURED)


@pytest.mark.slow  # test_friction_needs_the_machine_of_the_log has them from a run, test_measurement_chain.py the scope
@pytest.mark.parametrize("through", ["log", "scope"])
def test_friction_parameters_come_back(experiment, tmp_path, through):
    """All eight Stribeck parameters within 5 % of those simulated, from the log and from a 16 bit scope."""
    machine, log = experiment
    path = tmp_path / "friction.csv"
    if through == "scope":
        measurement_chain.export_scope(log, path, measurement_chain.load_chain())
        read = readers.read_log(path, measurement_chain.mapping_path(path))
    else:
        log_files.write_log(log, path)
        read = readers.read_log(path)
    result = identify_friction(read, machine)
    for name, declared in result.declared.items():
        assert result.parameters[name] == pytest.approx(declared, rel=0.05), name
