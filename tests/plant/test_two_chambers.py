"""Two chambers on a four-way valve in the plant: closed forms, balances over a run, and a measured set."""

import json
import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from hexsim import Machine, load_scenario
from hexsim.hydraulics import ports
from hexsim.hydraulics.parameters import P
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.plant import Plant, readout
from hexsim.plant.states import A
from hexsim.simulation import simulate

MEASURED = Path(__file__).parents[3] / "shared" / "measured" / "servo_none"
VISCOUS = 3000.0  # [N s/m] so that the oil's spring has come to rest after 2 s
SMOOTH = {f"friction.{kind}_{way}": 0.0 for kind in ("coulomb", "static") for way in ("extend_N", "retract_N")} | {
    "friction.viscous_extend_N_s_m": VISCOUS,
    "friction.viscous_retract_N_s_m": VISCOUS,
    "cylinder.piston_leakage_m3_s_Pa": 0.0,
    "valve.edge_rounding_m": 0.0,
    "valve.overlap_m": 5e-6,
}
FORMS = {"symmetric": {}, "differential": {"cylinder.through_rod": False}}


@pytest.fixture(scope="module", params=FORMS)
def machine(request) -> Machine:
    """The servo bench with viscous friction alone and 5 um of overlap; symmetric, and with its bottom area whole."""
    return changed(load_machine("servo_bench"), SMOOTH | FORMS[request.param])


def driven(machine: Machine, volts, timestep=None, at_start=lambda plant: None):
    """(time, signals) under volts(t), ticks of 1 ms."""
    plant = Plant(machine, timestep=timestep)
    at_start(plant)
    plant.prepare(1000.0, len(volts))
    for u in volts:
        plant.sense()
        plant.tick(np.array([u]))
    record, time = plant.record, np.arange(len(volts)) * 1e-3
    return time, readout.leg_signals(plant, time, record.qpos, record.qvel, record.act, record.spool_volts), plant


@pytest.mark.parametrize("volts", [1.0, -1.0])
def test_speed_and_pressures_of_a_steady_stroke(machine, volts):
    """v^2 (A1^3 + A2^3) = (K x)^2 (Ps A1 - Pt A2 - F) out, (Ps A2 - Pt A1 + F) in; F = weight + friction; 1e-3.

    So the speeds of a differential cylinder without load go as sqrt((Ps A1 - Pt A2)/(Ps A2 - Pt A1)) = sqrt(A1/A2).
    """
    cylinder, valve, supply = machine.cylinder, machine.valve, machine.supply
    A1, A2, Ps, Pt = cylinder.area_bottom_m2, cylinder.area_top_m2, supply.pressure_Pa, supply.tank_pressure_Pa
    _, s, _ = driven(machine, np.full(2000, volts))
    v, P1, P2 = (signal[-1, 0] for signal in (s.velocity, s.pressure_bottom, s.pressure_top))
    opening = (5e-5 - 5e-6) / (5e-4 - 5e-6)
    gain = valve.rated_flow_m3_s * opening / math.sqrt(valve.rated_pressure_drop_Pa)
    F = 250.0 * 9.81 + VISCOUS * v
    push = Ps * A1 - Pt * A2 - F if volts > 0 else Ps * A2 - Pt * A1 + F
    assert v == pytest.approx(math.copysign(gain * math.sqrt(push / (A1**3 + A2**3)), volts), rel=1e-3)
    drop_1, drop_2 = (v * A1 / gain) ** 2, (v * A2 / gain) ** 2
    by_hand = (Ps - drop_1, Pt + drop_2) if volts > 0 else (Pt + drop_1, Ps - drop_2)
    assert pytest.approx(by_hand, rel=2e-3) == (P1, P2)
    if cylinder.through_rod:
        assert pytest.approx(Ps + Pt, rel=1e-4) == P1 + P2


def test_pressure_step_at_the_turn():
    """Between out and in P1 falls by (r - r^3)/(1 + r^3) (Ps - Pt) but for friction, r = A2/A1; symmetric: none."""
    for form, changes in FORMS.items():
        machine = changed(load_machine("servo_bench"), SMOOTH | changes)
        r = machine.cylinder.area_top_m2 / machine.cylinder.area_bottom_m2
        steady = [driven(machine, np.full(2000, u))[1] for u in (1.0, -1.0)]
        out, back = ((s.pressure_bottom[-1, 0], s.velocity[-1, 0]) for s in steady)
        friction = VISCOUS * (out[1] - back[1]) / machine.cylinder.area_bottom_m2 / (1 + r**3)
        whole = machine.supply.pressure_Pa - machine.supply.tank_pressure_Pa
        step = (out[0] - friction) - back[0]
        assert step == pytest.approx(-(r - r**3) / (1 + r**3) * whole, abs=0.001 * whole), form


@pytest.mark.parametrize("timestep", [1e-4, None])
def test_rest_by_hand(machine, timestep):
    """P1 A1 - P2 A2 = m g and P1 + P2 = Ps + Pt hold the load; with the valve in its overlap nothing moves in 0.3 s."""
    A1, A2 = machine.cylinder.area_bottom_m2, machine.cylinder.area_top_m2
    total = machine.supply.pressure_Pa + machine.supply.tank_pressure_Pa
    _, s, _ = driven(machine, np.zeros(300), timestep)
    P1 = (250.0 * 9.81 + total * A2) / (A1 + A2)
    assert s.pressure_bottom[0, 0] == pytest.approx(P1, rel=1e-6)
    assert s.pressure_top[0, 0] == pytest.approx(total - P1, rel=1e-6)
    assert np.ptp(s.position) < 1e-9


def test_stiffness_with_the_valve_shut(machine):
    """A force of 500 N moves the piston by F / (E (A1^2/V1 + A2^2/V2)): both chambers are springs; 2e-3."""
    cylinder, E = machine.cylinder, machine.oil.bulk_modulus_Pa
    A1, A2, half = cylinder.area_bottom_m2, cylinder.area_top_m2, cylinder.stroke_m / 2
    V1, V2 = cylinder.pipeline_volume_m3 + A1 * half, cylinder.rod_side_volume_m3 + A2 * half
    damped = changed(machine, {f"friction.viscous_{way}_N_s_m": 2e4 for way in ("extend", "retract")})
    _, s, _ = driven(damped, np.zeros(400), at_start=lambda plant: plant.change_row(0, P.EXTRA_FORCE, 500.0))
    moved = s.position[-1, 0] - half
    assert moved == pytest.approx(500.0 / (E * (A1**2 / V1 + A2**2 / V2)), rel=2e-3)


def test_volume_balance_of_both_chambers(machine):
    """Over a run the oil that came in is what the piston displaced and what is compressed, in each chamber to 1e-3."""
    cylinder, E = machine.cylinder, machine.oil.bulk_modulus_Pa
    A1, A2 = cylinder.area_bottom_m2, cylinder.area_top_m2
    u = 1.5 * np.sin(2 * np.pi * 2.0 * np.arange(5000) * 2e-4)
    plant = Plant(machine)
    plant.prepare(5000.0, len(u))
    for value in u:
        plant.sense()
        plant.tick(np.array([value]))
    record, time = plant.record, np.arange(len(u)) * 2e-4
    s = readout.leg_signals(plant, time, record.qpos, record.qvel, record.act, record.spool_volts)
    y, P1, P2 = s.position[:, 0], s.pressure_bottom[:, 0], s.pressure_top[:, 0]
    V1, V2 = cylinder.pipeline_volume_m3 + A1 * y, cylinder.rod_side_volume_m3 + A2 * (cylinder.stroke_m - y)
    row, x = plant.rows[0], s.spool[:, 0]
    into_b = np.array([ports.top_inflow(row, x[k], P1[k], P2[k], 1.6e7) for k in range(len(u))])
    for flow, oil, pressure, area in ((s.flow[:, 0], V1, P1, A1), (into_b, V2, P2, -A2)):
        middle = 0.5 * (oil[1:] + oil[:-1])
        came = np.trapezoid(flow, time)
        kept = area * (y[-1] - y[0]) + float(np.sum(middle * np.diff(pressure))) / E
        assert abs(came - kept) < 1e-3 * np.trapezoid(np.abs(flow), time)


@pytest.mark.parametrize("fast", [False, True])
def test_energy_closes_with_a_power_unit(fast):
    """Motor's work = heat + work at the piston + stored in gas and oil, within 1e-3 of the motor's."""
    unit = {"motor_power_W": 3e4, "pump_flow_max_m3_s": 1e-3, "relief_pressure_Pa": 2e7}
    machine = changed(load_machine("servo_bench"), {"power_unit": unit, "supply.tank_pressure_Pa": 0.0})
    run = simulate(machine, load_scenario("heave", duration_s=3.0), fast=fast)
    assert run.complete, run.reason
    log = {name: run.log[name].to_numpy() for name in run.log.columns}
    energy = {name: np.trapezoid(log[name], log["time_s"]) for name in ("motor_power_W", "heat_W", "platform_power_W")}
    stored = log["accumulator_energy_J"][-1] - log["accumulator_energy_J"][0]
    rest = energy["motor_power_W"] - energy["heat_W"] - energy["platform_power_W"] - stored
    assert abs(rest) < 1e-3 * energy["motor_power_W"]


def test_the_chosen_step_gives_the_same_motion():
    """Chosen step against 20 us: peak 50 Hz acceleration of a heave within 0.1 %."""
    peaks = []
    for timestep in (2e-5, None):
        run = simulate(load_machine("servo_bench"), load_scenario("heave", duration_s=3.0), timestep=timestep)
        peaks.append(run.summary["axes"]["leg"]["peak_band_m_s2"])
    assert peaks[1] == pytest.approx(peaks[0], rel=1e-3)


def test_log_has_the_measured_rod_side():
    """pressure_top_Pa carries the transducer's noise, true_pressure_top_Pa does not; a three-way leg has the truth alone."""
    log = simulate(load_machine("servo_bench"), load_scenario("heave", duration_s=1.0), fast=True).log
    error = (log["pressure_top_Pa"] - log["true_pressure_top_Pa"]).to_numpy()
    assert np.std(error) == pytest.approx(8e3, rel=0.1)
    assert (
        "true_pressure_top_Pa"
        not in simulate(load_machine("bench"), load_scenario("heave", duration_s=0.5), fast=True).log.columns
    )


@pytest.mark.skipif(not MEASURED.exists(), reason=f"the measured set {MEASURED} is not there")
def test_a_measured_set_is_answered_to_its_noise():
    """The same actuator, simulated by code that shares nothing with this one: position, both pressures and acceleration
    of its `validate` run within 1.1 of the declared noise (1.0 = noise alone).

    Its writer begins with P2 = Ps/2.
    """
    true = json.loads((MEASURED / "truth.json").read_text())["parameters"]
    keys = {
        "supply.pressure_Pa": "supply_pressure",
        "valve.rated_flow_m3_s": "rated_flow",
        "oil.bulk_modulus_Pa": "bulk_modulus",
        "load.moving_mass_kg": "moving_mass",
        "valve.spool_frequency_Hz": "spool_frequency",
        **{
            f"friction.{kind}_{way}": f"{kind.split('_')[0]}_{sign}"
            for kind in ("viscous", "coulomb", "static")
            for way, sign in (
                (f"extend_N{'_s_m' * (kind == 'viscous')}", "pos"),
                (f"retract_N{'_s_m' * (kind == 'viscous')}", "neg"),
            )
        },
    }
    machine = changed(load_machine(MEASURED / "machine.toml"), {key: true[name] for key, name in keys.items()})
    plant, log = Plant(machine), pl.read_csv(MEASURED / "validate.csv.gz")
    row, top = plant.rows[0], true["supply_pressure"] / 2
    plant.data.act[int(plant.layout[0, A.ROD_SIDE])] = top / 1e6
    bottom = (true["moving_mass"] * 9.81 + top * row[P.AREA_TOP]) / row[P.AREA_BOTTOM]
    plant.data.act[plant.pressure_places] = bottom / 1e6
    plant.prepare(1000.0, len(log))
    setpoint, u = log["setpoint_m"].to_numpy(), np.zeros(1)
    for k in range(len(log)):
        y = plant.sense()
        u = np.clip(40.0 * (setpoint[k] - y), -10.0, 10.0) if k % 2 == 0 else u  # 500 Hz
        plant.tick(u)
    record = plant.record
    time = log["time_s"].to_numpy()
    s = readout.leg_signals(plant, time, record.qpos, record.qvel, record.act, record.spool_volts)
    sensors = machine.sensors
    answers = {
        "position_m": (s.position[:, 0], math.hypot(sensors.position_noise_m, sensors.position_resolution_m / 12**0.5)),
        "pressure_bottom_Pa": (s.pressure_bottom[:, 0], sensors.pressure_noise_Pa),
        "pressure_top_Pa": (s.pressure_top[:, 0], sensors.pressure_noise_Pa),
        "acceleration_m_s2": (record.qacc[:, 0], sensors.acceleration_noise_m_s2),
    }
    for name, (answer, noise) in answers.items():
        assert np.sqrt(np.mean((log[name].to_numpy() - answer) ** 2)) < 1.1 * noise, name
