"""The four-way leg against Exudyn's two-chamber hydraulic actuator, written by others: pip install hexsim[benchmark]."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from hexsim import Machine
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant

exudyn = pytest.importorskip("exudyn")
STEP_S, TICK_S, TICKS = 1.0e-4, 1.0e-3, 400
VISCOUS = 900.0  # [N s/m]; Exudyn's element has no other friction, no edges with lap, no leakage, and a spool at once
COMMON = {f"friction.{kind}_{way}": 0.0 for kind in ("coulomb", "static") for way in ("extend_N", "retract_N")} | {
    "friction.viscous_extend_N_s_m": VISCOUS,
    "friction.viscous_retract_N_s_m": VISCOUS,
    "cylinder.piston_leakage_m3_s_Pa": 0.0,
    "cylinder.through_rod": False,
    "valve.edge_rounding_m": 0.0,
    "valve.spool_frequency_Hz": 0.0,
    "valve.pressure_width_Pa": 1.0,
}


@dataclass(frozen=True, kw_only=True)
class Start:
    """Load on the rod besides the weight [N], and pressures that hold it [Pa]."""

    force: float
    bottom: float
    top: float


@pytest.fixture(scope="module")
def machine() -> Machine:
    """The servo bench as a differential cylinder with viscous friction and sharp edges without lap."""
    return changed(load_machine("servo_bench"), COMMON)


def at_rest(machine: Machine, force: float) -> Start:
    """P1 A1 - P2 A2 = m g - F and P1 + P2 = Ps + Pt."""
    cylinder, supply = machine.cylinder, machine.supply
    carried = machine.load.moving_mass_kg * machine.machine.gravity_m_s2 - force
    total = supply.pressure_Pa + supply.tank_pressure_Pa
    bottom = (carried + total * cylinder.area_top_m2) / (cylinder.area_bottom_m2 + cylinder.area_top_m2)
    return Start(force=force, bottom=bottom, top=total - bottom)


def in_hexsim(machine: Machine, start: Start, volts: np.ndarray) -> np.ndarray:
    """Velocity [m/s] at the beginning of each tick, RK4 with STEP_S."""
    plant = Plant(machine, timestep=STEP_S)
    plant.change_row(0, P.EXTRA_FORCE, start.force)
    plant.prepare(1.0 / TICK_S, len(volts))
    plant.data.act[:] = np.array([start.top, start.bottom]) / 1e6
    for u in volts:
        plant.tick(np.array([u]))
    return plant.record.qvel[:, 0]


def in_exudyn(machine: Machine, start: Start, volts: np.ndarray) -> np.ndarray:
    """The same in Exudyn: a mass on the actuator between two markers, RK44 with STEP_S."""
    from exudyn import itemInterface as items

    cylinder, valve, supply = machine.cylinder, machine.valve, machine.supply
    mass = machine.load.moving_mass_kg
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    half, offset = cylinder.stroke_m / 2, 1.0
    node = system.AddNode(items.NodePoint(referenceCoordinates=[0, 0, offset + half]))
    body = system.AddObject(items.ObjectMassPoint(mass=mass, nodeNumber=node))
    ends = [system.AddMarker(items.MarkerBodyPosition(bodyNumber=number)) for number in (ground, body)]
    pull = start.force - mass * machine.machine.gravity_m_s2
    system.AddLoad(items.Force(markerNumber=ends[1], loadVector=[0, 0, pull]))
    pressures = [start.bottom, start.top]
    oil = system.AddNode(
        items.NodeGenericODE1(numberOfODE1Coordinates=2, referenceCoordinates=[0, 0], initialCoordinates=pressures)
    )
    actuator = system.AddObject(
        items.ObjectConnectorHydraulicActuatorSimple(
            markerNumbers=ends,
            nodeNumbers=[oil],
            offsetLength=offset,
            strokeLength=cylinder.stroke_m,
            chamberCrossSection0=cylinder.area_bottom_m2,
            chamberCrossSection1=cylinder.area_top_m2,
            hoseVolume0=cylinder.pipeline_volume_m3,
            hoseVolume1=cylinder.rod_side_volume_m3,
            useChamberVolumeChange=True,
            oilBulkModulus=machine.oil.bulk_modulus_Pa,
            actuatorDamping=VISCOUS,
            nominalFlow=valve.rated_flow_m3_s / math.sqrt(valve.rated_pressure_drop_Pa),
            systemPressure=supply.pressure_Pa,
            tankPressure=supply.tank_pressure_Pa,
        )
    )
    velocity = system.AddSensor(
        items.SensorNode(
            nodeNumber=node,
            outputVariableType=exudyn.OutputVariableType.Velocity,
            storeInternal=True,
            writeToFile=False,
        )
    )
    system.Assemble()

    openings = iter(np.repeat(volts, round(TICK_S / STEP_S)) / valve.voltage_max_V)  # one a step

    def open_valve(mbs, t):
        opening = float(next(openings))
        mbs.SetObjectParameter(actuator, "valveOpening0", opening)
        mbs.SetObjectParameter(actuator, "valveOpening1", -opening)
        return True

    system.SetPreStepUserFunction(open_valve)
    settings = exudyn.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = round(len(volts) * TICK_S / STEP_S), len(volts) * TICK_S
    integration.automaticStepSize = integration.adaptiveStep = False
    integration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = TICK_S
    system.SolveDynamic(settings, solverType=exudyn.DynamicSolverType.RK44)
    return system.GetSensorStoredData(velocity)[: len(volts), 3]


@pytest.mark.parametrize("force", [4500.0, -4500.0])
@pytest.mark.parametrize("volts", [3.0, -3.0])
def test_four_quadrants_of_velocity_and_force(machine, volts, force):
    """Out and in, load pushed and pulled: accelerations of each tick, equal step, within 1e-6 of their peak (asked: 0.1 %).

    4500 N against 2450 N of weight: the net load turns its sign. No chamber cavitates: Exudyn has no law for it. The
    valve opens and shuts within 150 ms each.
    """
    shape = np.clip(np.minimum(np.arange(TICKS) / 150, (TICKS - 60 - np.arange(TICKS)) / 150), 0.0, 1.0)
    command, start = volts * shape, at_rest(machine, force)
    here, there = (np.diff(run(machine, start, command)) / TICK_S for run in (in_hexsim, in_exudyn))
    assert np.abs(there).max() > 1.0 and np.sign(np.sum(there[:200])) == np.sign(volts)
    assert np.abs(here - there).max() < 1e-6 * np.abs(there).max()
