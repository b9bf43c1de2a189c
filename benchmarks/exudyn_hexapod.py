"""The 600 kg hexapod in Exudyn, from the same machine file, kinematics and static pressures as hexsim's tendon model.

Rigid platform on six massless legs. Each leg: a C++ hydraulic actuator, and the friction curve as a symbolic user
function that Exudyn evaluates in C++. Control: Python, once a control tick. Needs Exudyn: the extra `benchmark`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.plant import Plant
from hexsim.scenarios import Scenario
from hexsim.simulation import setpoints

Array = NDArray[np.float64]
ENDLESS_VOLUME_m3 = 1.0e6  # a rod side of this volume stays at supply pressure within 1 Pa


def load_exudyn() -> Any:
    """Exudyn's build without range checks where the processor has AVX2, its faster one. Raises ImportError."""
    sys.exudynFast = True  # type: ignore[attr-defined]
    import exudyn

    return exudyn


@dataclass(frozen=True, kw_only=True)
class Model:
    """The machine in Exudyn. `container` and `functions` are kept alive here; Exudyn needs them."""

    container: Any
    system: Any
    actuators: list[Any]
    velocity: Any
    functions: list[Any]


def build(machine: Machine, plant: Plant) -> Model:
    """Platform, legs, gravity and a velocity sensor; geometry and static pressures are those of `plant`."""
    exudyn = load_exudyn()
    from exudyn import itemInterface as items

    kinematics, load = plant.kinematics, machine.load
    container = exudyn.SystemContainer()
    system = container.AddSystem()
    ground = system.AddObject(items.ObjectGround())
    neutral = [0, 0, kinematics.neutral_height_m, 0, 0, 0]
    node = system.AddNode(items.NodeRigidBodyRotVecLG(referenceCoordinates=neutral))
    inertia = [*load.platform_inertia_kg_m2, 0, 0, 0]
    platform = system.AddObject(items.ObjectRigidBody(mass=load.platform_mass_kg, inertia=inertia, nodeNumber=node))
    carried = system.AddMarker(items.MarkerBodyMass(bodyNumber=platform))
    system.AddLoad(items.LoadMassProportional(markerNumber=carried, loadVector=list(plant.resolved.gravity_m_s2)))
    offset = float(np.broadcast_to(kinematics.retracted_length_m, 6)[0])
    actuators, functions = [], []
    for i, pressure in enumerate(plant.static_pressures()):
        ends = [
            system.AddMarker(items.MarkerBodyPosition(bodyNumber=body, localPosition=joints[i]))
            for body, joints in ((ground, kinematics.base_joints), (platform, kinematics.platform_joints))
        ]
        pressures = [pressure, machine.supply.pressure_Pa]
        oil = system.AddNode(
            items.NodeGenericODE1(numberOfODE1Coordinates=2, referenceCoordinates=[0, 0], initialCoordinates=pressures)
        )
        actuators.append(system.AddObject(_actuator(items, machine, ends, oil, offset)))
        functions.append(_add_friction(system, items, machine, ends))
    kind = exudyn.OutputVariableType.Velocity
    velocity = system.AddSensor(
        items.SensorBody(bodyNumber=platform, outputVariableType=kind, storeInternal=True, writeToFile=False)
    )
    system.Assemble()
    return Model(container=container, system=system, actuators=actuators, velocity=velocity, functions=functions)


def _actuator(items: Any, machine: Machine, ends: list[Any], oil: Any, offset: float) -> Any:
    """Eq. 3.4 and 3.7 with the relative opening as input; the rod side's volume is endless, so it stays at Ps."""
    cylinder, valve, supply = machine.cylinder, machine.valve, machine.supply
    edge = valve.discharge_coefficient * np.pi * valve.spool_diameter_m * np.sqrt(2.0 / machine.oil.density_kg_m3)
    return items.ObjectConnectorHydraulicActuatorSimple(
        markerNumbers=ends,
        nodeNumbers=[oil],
        offsetLength=offset,
        strokeLength=cylinder.stroke_m,
        chamberCrossSection0=cylinder.area_bottom_m2,
        chamberCrossSection1=cylinder.area_top_m2,
        hoseVolume0=cylinder.pipeline_volume_m3,
        hoseVolume1=ENDLESS_VOLUME_m3,
        useChamberVolumeChange=True,
        oilBulkModulus=machine.oil.bulk_modulus_Pa,
        nominalFlow=edge * valve.spool_travel_max_m,
        systemPressure=supply.pressure_Pa,
        tankPressure=supply.tank_pressure_Pa,
    )


def _add_friction(system: Any, items: Any, machine: Machine, ends: list[Any]) -> Any:
    """Eq. 2.4 with tanh(v / sharpness) for sign(v), as hexsim's default form, along the leg."""
    from exudyn import symbolic
    from exudyn.advancedUtilities import CreateSymbolicUserFunction

    curve = machine.friction

    def branch(v, viscous, coulomb, static):
        level = coulomb + static * symbolic.exp(-symbolic.abs(v) / curve.stribeck_velocity_m_s)
        return viscous * v + symbolic.tanh(v / curve.sharpness_m_s) * level

    def friction(mbs, t, itemNumber, deltaL, deltaL_t, stiffness, damping, force):
        extending = branch(deltaL_t, curve.viscous_extend_N_s_m, curve.coulomb_extend_N, curve.static_extend_N)
        retracting = branch(deltaL_t, curve.viscous_retract_N_s_m, curve.coulomb_retract_N, curve.static_retract_N)
        return symbolic.IfThenElse(deltaL_t < 0, retracting, extending)

    connector = system.AddObject(items.ObjectConnectorSpringDamper(markerNumbers=ends, referenceLength=1.0))
    function = CreateSymbolicUserFunction(system, friction, "springForceUserFunction", connector)
    system.SetObjectParameter(connector, "springForceUserFunction", function)
    return function


def controller(model: Model, machine: Machine, lengths: list[list[float]], steps_a_tick: int) -> Callable[..., bool]:
    """Called before each step: proportional control and the valve's overlap, once a control tick; held in between.

    lengths: reference leg lengths [m] of each tick.
    """
    exudyn = load_exudyn()
    gain, limit = machine.controller.gain_V_per_m, machine.valve.voltage_max_V
    overlap = machine.valve.overlap_m / machine.valve.spool_travel_max_m
    length = exudyn.OutputVariableType.Distance
    actuators, step = model.actuators, 0

    def before_step(mbs: Any, t: float) -> bool:
        nonlocal step
        tick, rest = divmod(step, steps_a_tick)
        step += 1
        if rest:
            return True
        for actuator, reference in zip(actuators, lengths[tick], strict=True):
            x = min(max(gain * (reference - mbs.GetObjectOutput(actuator, length)) / limit, -1.0), 1.0)
            opening = x - overlap if x > overlap else (x + overlap if x < -overlap else 0.0)
            mbs.SetObjectParameter(actuator, "valveOpening0", opening)
        return True

    return before_step


def exudyn_run(
    machine: Machine, scenario: Scenario, scheme: str, step_s: float, log_step_s: float
) -> Callable[[], Array]:
    """A function that runs the scenario and gives the platform's vertical velocity (n,) [m/s] every `log_step_s`.

    scheme: a name in exudyn.DynamicSolverType, run with the fixed step `step_s`, a whole part of the control step.
    """
    exudyn = load_exudyn()
    plant = Plant(machine, model="tendon")
    model = build(machine, plant)
    control_step = 1.0 / machine.controller.rate_Hz
    ticks = np.arange(round(scenario.duration_s / control_step) + 1) * control_step
    pistons = setpoints(machine, scenario, plant.kinematics, ticks)
    lengths = (pistons + np.broadcast_to(plant.kinematics.retracted_length_m, 6)).tolist()
    settings = exudyn.SimulationSettings()
    integration = settings.timeIntegration
    integration.numberOfSteps, integration.endTime = round(scenario.duration_s / step_s), scenario.duration_s
    integration.automaticStepSize = integration.adaptiveStep = False
    integration.explicit.computeEndOfStepAccelerations = False  # one evaluation a step less
    integration.verboseMode = 0
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = log_step_s
    solver = getattr(exudyn.DynamicSolverType, scheme)
    steps_a_tick = round(control_step / step_s)

    def go() -> Array:
        model.system.SetPreStepUserFunction(controller(model, machine, lengths, steps_a_tick))
        model.system.SolveDynamic(settings, solverType=solver)
        return model.system.GetSensorStoredData(model.velocity)[: round(scenario.duration_s / log_step_s), 3]

    return go
