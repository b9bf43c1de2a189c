"""The report's experiment 2.3.3: friction against velocity from a log, and the Stribeck parameters behind it.

    F_f = P1 A1 - Ps A2 - M (a + g)                                                       Eq. 2.3
    F_f = sigma v + sign(v) [F_c + F_s exp(-|v|/c_s)], each direction its own numbers     Eq. 2.4

Both sides go through the same window, so no noisy signal is differentiated: <w, F_f(v)> is fitted to the measured
<w, F_f>.
A bench's mass is fitted within its declared uncertainty: its error looks like a difference between the Coulomb frictions
of the two directions (8 N for 2 % of 40 kg), and the standard errors contain it. A hexapod's is the declared one, with its
uncertainty: the legs' own masses are known as they act at neutral, and 1 N of that is 3 kg of platform to a fit.

Limits: near v = 0 the regularised sign stands for sticking, so slow samples are left out; what no sample visited is not
known, and what is crossed faster than a few windows is blurred (a note says so).
On a hexapod the load of each leg comes from the platform's accelerations and the geometry.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.machine.files import changed
from hexsim.signals.log import Log
from hexsim.signals.table import accelerations_of
from hexsim.signals.weak_form import HALF_WIDTH_S, SHORT_S, Window, velocity
from hexsim.tracing import rules
from hexsim.tracing.friction.stribeck import KEYS, curve, row_with
from hexsim.tracing.leg_loads import leg_loads

Array = np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class FrictionResult:
    """Stribeck parameters of one leg with standard errors, and the friction-velocity map.

    parameters, standard_error: by KEYS, SI; mass_kg with its error; map_*: bins of the map (velocity, mean friction,
    its standard error, samples); points: thinned (velocity, friction) samples; rest_N: rms that the curve leaves;
    noise_N: what the sensors' noise alone would leave; notes: what could not be identified.
    """

    leg: int
    log: str
    parameters: dict[str, float]
    standard_error: dict[str, float]
    declared: dict[str, float]
    mass_kg: float
    mass_error_kg: float
    map_velocity_m_s: Array
    map_friction_N: Array
    map_error_N: Array
    map_samples: Array
    points_velocity_m_s: Array
    points_friction_N: Array
    rest_N: float
    noise_N: float
    notes: tuple[str, ...]
    machine: Machine

    def friction(self, v: Array) -> Array:
        """The fitted curve [N] at velocities v [m/s]."""
        return curve(row_with(self.machine, np.array([self.parameters[key] for key in KEYS])), v)

    def to_json(self) -> dict[str, Any]:
        """Plain numbers for a JSON file."""
        plain = (
            "leg",
            "log",
            "parameters",
            "standard_error",
            "declared",
            "mass_kg",
            "mass_error_kg",
            "rest_N",
            "noise_N",
        )
        out = {name: getattr(self, name) for name in plain}
        out["map"] = {
            "velocity_m_s": self.map_velocity_m_s.tolist(),
            "friction_N": self.map_friction_N.tolist(),
            "standard_error_N": self.map_error_N.tolist(),
            "samples": self.map_samples.tolist(),
        }
        return {**out, "notes": list(self.notes)}

    def fitted_machine(self) -> Machine:
        """The machine with these frictions (one Stribeck velocity, the mean of both, as its file has one)."""
        p = self.parameters
        keys = [key for key in KEYS if not key.startswith("stribeck")]
        speed = 0.5 * (p["stribeck_velocity_extend_m_s"] + p["stribeck_velocity_retract_m_s"])
        changes = {f"friction.{key}": p[key] for key in keys} | {"friction.stribeck_velocity_m_s": speed}
        return changed(self.machine, changes, "friction")


@dataclass(frozen=True, kw_only=True, eq=False)
class ForceData:
    """Signals of one leg: net oil force, its load per unit mass and velocity, (n,); noise of the net force a sample.

    mass_from_motion: whether the load is exact enough for its mass to be fitted.
    """

    oil_N: Array
    load_per_mass_m_s2: Array
    v: Array
    mass_kg: float
    mass_error_kg: float
    mass_from_motion: bool
    noise_N: float


def force_data(log: Log, machine: Machine, leg: int) -> ForceData:
    """Measured side of Eq. 2.3. Raises HexsimError when a channel is missing."""
    mark = "" if log.n_legs == 1 else f"_{leg}"
    of_rod_side = f"pressure_top{mark}_Pa" if machine.cylinder.rod_side == "valve" else "pressure_supply_Pa"
    need = [f"position{mark}_m", f"pressure_bottom{mark}_Pa", of_rod_side]
    need += accelerations_of(log.n_legs)
    for name in need:
        if name not in log.columns:
            raise HexsimError(f"log {log.name} has no column {name}: friction cannot be identified without it")
    cylinder, sensors = machine.legs[leg - 1].cylinder, machine.sensors
    A1, A2 = cylinder.area_bottom_m2, cylinder.area_top_m2
    y = log.columns[need[0]]
    oil = log.columns[need[1]] * A1 - log.columns[need[2]] * A2
    noise = machine.legs[leg - 1].sensors.pressure_noise_Pa * float(np.hypot(A1, A2))
    if log.n_legs == 1:
        a = log.columns["acceleration_m_s2"]
        mass = float(machine.load.moving_mass_kg or 0.0)
        load, v = a + machine.machine.gravity_m_s2, velocity(y, a, log.rate, HALF_WIDTH_S)
        error = mass * machine.uncertainty.get("moving_mass_kg", 0.005) / np.sqrt(3)
        noise = float(np.hypot(noise, mass * sensors.acceleration_noise_m_s2))
    else:
        mass = float(machine.load.platform_mass_kg or 0.0)
        loads, along = leg_loads(log, machine)
        load, v = loads[leg - 1] / mass, velocity(y, along[leg - 1], log.rate, HALF_WIDTH_S)
        error = mass * machine.uncertainty.get("platform_mass_kg", 0.005) / np.sqrt(3)
    return ForceData(
        oil_N=oil, load_per_mass_m_s2=load, v=v, mass_kg=mass, mass_error_kg=error, mass_from_motion=log.n_legs == 1,
        noise_N=max(noise, 1e-3),
    )  # fmt: skip


def identify_friction(log: Log, machine: Machine, leg: int = 1, least_widths: float = 4.0) -> FrictionResult:
    """Stribeck parameters of a leg (1-based) from one log: constant velocities, sines, or any motion.

    least_widths: of friction's sharpness; slower samples are left out, for there noise of v bends the curve.

    Raises HexsimError when a channel is missing or a direction was hardly visited.
    """
    if log.n_legs != machine.n_legs:
        raise HexsimError(f"log {log.name} is of a {log.kind}, machine {machine.name} is a {machine.machine.kind}")
    if not 1 <= leg <= machine.n_legs:
        raise HexsimError(f"leg {leg} does not exist: {machine.name} has legs 1 to {machine.n_legs}")
    data = force_data(log, machine, leg)
    look = Window(log.rate, max(SHORT_S, 3.0 / log.rate))
    slow = least_widths * max(machine.legs[leg - 1].friction.sharpness_m_s, 1e-4)
    step = max(1, look.half)
    keep = np.zeros(len(data.v), dtype=bool)
    keep[look.half + round(0.05 * log.rate) : len(keep) - look.half - round(0.05 * log.rate) : step] = True
    stopped = np.convolve(np.abs(data.v) < slow, np.ones(2 * look.half + 1), mode="same") > 0
    keep &= ~stopped
    counts = [int((keep & (data.v > 0)).sum()), int((keep & (data.v < 0)).sum())]
    for count, way in zip(counts, ("out", "in"), strict=True):
        if count < 2 * len(KEYS):
            raise HexsimError(
                f"log {log.name}: leg {leg} hardly moves {way} faster than {slow * 1e3:.1f} mm/s ({count} windows): "
                "give strokes in both directions"
            )
    return fit(log, machine, leg, data, look, keep)


def fit(log: Log, machine: Machine, leg: int, data: ForceData, look: Window, keep: Array) -> FrictionResult:
    """Least squares of the windowed friction; standard errors from blocks in time."""
    f = machine.legs[leg - 1].friction
    declared = np.array([f.viscous_extend_N_s_m, f.coulomb_extend_N, f.static_extend_N, f.stribeck_velocity_m_s,
                         f.viscous_retract_N_s_m, f.coulomb_retract_N, f.static_retract_N,
                         f.stribeck_velocity_m_s])  # fmt: skip
    oil, load = look.mean(data.oil_N)[keep], look.mean(data.load_per_mass_m_s2)[keep]
    impulse = np.zeros(4 * look.half + 1)
    impulse[2 * look.half] = 1.0
    noise = data.noise_N * float(np.linalg.norm(look.mean(impulse)))
    scale = np.maximum(declared, [200.0, 10.0, 10.0, 1e-3] * 2)

    prior = 1.0 if data.mass_from_motion else 1.0 / rules.HELD

    def misfit(x: Array) -> Array:
        model = look.mean(curve(row_with(machine, x[:8] * scale), data.v))[keep]
        rest = oil - (data.mass_kg + x[8] * data.mass_error_kg) * load - model
        return np.append(rest / noise, x[8] * prior)

    start = np.append(np.maximum(declared, 0.1 * scale) / scale, 0.0)
    low, high = np.append(np.zeros(8), -6.0), np.append(np.full(8, 100.0), 6.0)
    low[[3, 7]] = 2.0 * max(f.sharpness_m_s, 1e-4) / scale[[3, 7]]
    found = least_squares(misfit, np.clip(start, low + 1e-9, high), bounds=(low, high), x_scale="jac", max_nfev=60)
    # few accelerations decide on the mass: what they are worth shows in blocks, and sets the weight of the declared one
    if data.mass_from_motion:
        white = np.linalg.pinv(found.jac[:-1].T @ found.jac[:-1])
        prior = float(np.sqrt(max(block_covariance(found, 0.0)[8, 8] / white[8, 8], 1.0)))
        found = least_squares(misfit, found.x, bounds=(low, high), x_scale="jac", max_nfev=60)
    rest = found.fun[:-1] * noise
    covariance = block_covariance(found, prior)
    errors = np.sqrt(np.diag(covariance)) * np.append(scale, data.mass_error_kg)
    values = found.x[:8] * scale
    friction = oil - (data.mass_kg + found.x[8] * data.mass_error_kg) * load
    bins = friction_map(look.mean(data.v)[keep], friction)
    thin = slice(None, None, max(1, len(friction) // 3000))
    return FrictionResult(
        leg=leg, log=log.name, machine=machine,
        parameters=dict(zip(KEYS, map(float, values), strict=True)),
        standard_error=dict(zip(KEYS, map(float, errors[:8]), strict=True)),
        declared=dict(zip(KEYS, map(float, declared), strict=True)),
        mass_kg=data.mass_kg + float(found.x[8]) * data.mass_error_kg, mass_error_kg=float(errors[8]),
        map_velocity_m_s=bins[0], map_friction_N=bins[1], map_error_N=bins[2], map_samples=bins[3],
        points_velocity_m_s=look.mean(data.v)[keep][thin], points_friction_N=friction[thin],
        rest_N=float(np.std(rest)), noise_N=float(noise), notes=notes_on(values, errors, rest, noise, data.v[keep],
                       np.gradient(data.v)[keep] * log.rate),
    )  # fmt: skip


def block_covariance(found: OptimizeResult, prior: float) -> Array:
    """Sandwich covariance (9, 9) of the scaled parameters over 60 blocks in time; residuals may be correlated.

    `prior` is the weight of the declared mass in the fit; its own variance (1 declared standard deviation) is added.
    """
    jacobian, rest = found.jac[:-1], found.fun[:-1]
    mass = np.zeros(9)
    mass[8] = prior**2
    bread = np.linalg.pinv(jacobian.T @ jacobian + np.diag(mass))
    blocks = np.array_split(np.arange(len(rest)), min(60, max(len(rest) // 10, 2)))
    scores = np.stack([jacobian[block].T @ rest[block] for block in blocks])
    return bread @ (scores.T @ scores + np.diag(mass**2)) @ bread * len(blocks) / (len(blocks) - 1)


def friction_map(v: Array, friction: Array) -> tuple[Array, Array, Array, Array]:
    """Bins of the friction-velocity map (Fig. 2.9), 12 a decade either way: velocity, friction, error, samples."""
    speed = np.maximum(np.abs(v), 1e-6)
    place = np.sign(v) * (np.floor(12 * np.log10(speed)) + 1000)
    out = []
    for key in np.unique(place):
        inside = place == key
        if inside.sum() >= 5:
            spread = float(np.std(friction[inside])) / np.sqrt(inside.sum())
            out.append((float(np.mean(v[inside])), float(np.mean(friction[inside])), spread, int(inside.sum())))
    columns = list(zip(*sorted(out), strict=True))
    return tuple(np.array(column) for column in columns)  # pyright: ignore


def notes_on(values: Array, errors: Array, rest: Array, noise: float, v: Array, a: Array) -> tuple[str, ...]:
    """What the numbers do not say by themselves."""
    notes = []
    for key, value, error in zip(KEYS, values, errors, strict=False):
        if error > 0.5 * abs(value):
            notes.append(f"{key} is not determined by this log ({value:.3g} +- {error:.2g})")
    for way, speeds in (("extend", v[v > 0]), ("retract", -v[v < 0])):
        c = values[3 if way == "extend" else 7]
        inside = (np.sign(v) == (1 if way == "extend" else -1)) & (np.abs(v) < 2 * c)
        if inside.any() and np.median(np.abs(a[inside])) * 2 * SHORT_S > c:
            notes.append(
                f"{way}: the Stribeck part is crossed within a few windows, static and c_s may be off: move slowly"
            )
        if np.mean(speeds < 2 * c) < 0.02:
            notes.append(
                f"{way}: only {np.mean(speeds < 2 * c):.1%} of the samples are slow enough to see the Stribeck part"
            )
    if np.std(rest) > 2 * noise:
        notes.append(
            f"the curve leaves {np.std(rest):.2g} N rms, the sensors' noise {noise:.2g} N: "
            "friction has more to it than velocity"
        )
    return tuple(notes)
