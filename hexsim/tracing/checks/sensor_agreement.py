"""Sensors against each other: accelerometers against the second derivative of the positions, without a model.

With a sampled controller the log itself biases this comparison: between two updates the valve's staircase makes the
acceleration a parabola, and samples on the updates miss the mean of it (w0^2 T^2/(12 n^2) of the acceleration, w0 the
oil resonance, T the update period, n samples an update; one leg with 40 kg, 500 Hz, logged at 1 kHz: 4 %). The kinks
in the samples themselves show what is missing, and nothing in a log of means. With one sample an update they cannot.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.machine.geometry import machine_kinematics
from hexsim.signals.log import Log
from hexsim.signals.table import accelerations_of
from hexsim.signals.weak_form import WIDE_S, Window
from hexsim.tracing import rules
from hexsim.tracing.balances.bends import kinks, tick_samples

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """reference(t) = gain * channel(t + delay) + offset, with standard errors. size: rms of the reference's motion."""

    gain: float
    gain_error: float
    offset: float
    delay_s: float
    delay_error_s: float
    correlation: float
    size: float


def staircase_bias(machine: Machine, rate_Hz: float) -> float:
    """How much less a logged acceleration may read under a sampled controller (see above), where kinks cannot show it."""
    if round(rate_Hz / machine.controller.rate_Hz) >= 2:
        return 0.0
    cylinder, load = machine.cylinder, machine.load
    mass = load.moving_mass_kg or (load.platform_mass_kg or 1.0) / 6
    volume = cylinder.area_bottom_m2 * cylinder.stroke_m / 2 + cylinder.pipeline_volume_m3
    resonance_squared = machine.oil.bulk_modulus_Pa * cylinder.area_bottom_m2**2 / (volume * mass)
    return float(resonance_squared / machine.controller.rate_Hz**2 / 12)


def acceleration_agreement(log: Log, machine: Machine, order: tuple[int, ...] | None = None) -> dict[str, Agreement]:
    """Each accelerometer channel against the positions. Empty where there is none or the log is too short or still.

    order: numbers of the legs (0-based) as which the position columns are taken; default as they are named.
    """
    look = Window(log.rate, max(WIDE_S, 5.0 / log.rate))
    if len(log.time) < 8 * look.half or log.duration_s < 2.0:
        return {}
    names = [*log.names("acceleration"), *log.names("angular_acceleration")]
    positions = log.names("position")
    if not names or len(positions) != log.n_legs:
        return {}
    y = np.stack([log.columns[name] for name in positions])
    y = y if order is None else y[list(order)]
    if log.n_legs == 1:
        reference = {names[0]: inner(look, look.second_rate(y[0]))}
    else:
        reference = platform_acceleration(y, machine, look)
    updates = tick_samples(log, 0, machine.controller.rate_Hz)
    if updates is None:
        updates = sharpest(log.columns[names[0]], round(log.rate_of(names[0]) / machine.controller.rate_Hz))
    sigma = machine.sensors.position_error_m + 1e-7
    impulse = np.zeros(4 * look.half + 1)
    impulse[2 * look.half] = sigma
    noise = float(np.linalg.norm(look.second_rate(impulse)))
    return {
        name: agreement(
            reference[name],
            inner(look, look.mean(log.columns[name] + kinks(log.columns[name], updates))),
            log.rate,
            noise,
            look.half,
        )
        for name in names
        if np.std(reference[name]) > 5 * noise
    }


def whole_correlation(results: dict[str, Agreement], machine: Machine) -> float:
    """Of all channels together, each by the square of its motion; an angle counts by the travel that it gives the joints.

    One leg that is late spoils the axes in which the platform hardly moves, not the one in which it does.
    """
    reach = float(np.sqrt(np.mean(np.sum(machine_kinematics(machine).platform_joints ** 2, axis=-1))))
    weights = [(own.size * (reach if name.startswith("angular") else 1.0)) ** 2 for name, own in results.items()]
    return float(np.average([own.correlation for own in results.values()], weights=weights)) if results else 0.0


def sharpest(acceleration: Array, every: int) -> slice | None:
    """The controller's updates, one sample in `every`, where no volts tell them: there an acceleration bends up.

    Between updates a'' = -w0^2 a, so the second difference has the sign of -a, and at the updates that of a.
    """
    if every < 2:
        return None
    up = acceleration * np.diff(acceleration, 2, prepend=acceleration[0], append=acceleration[-1])
    return slice(max(range(every), key=lambda first: float(np.sum(up[first::every]))), None, every)


def order_that_fits(log: Log, machine: Machine) -> tuple[int, int] | None:
    """Two legs (1-based) whose exchange makes the positions agree with the accelerometers, if they do not as named."""
    few = slice(0, min(len(log.time), round(6.0 * log.rate)))
    short = log.part(few)
    best, found = 0.9, None
    for first, second in combinations(range(6), 2):
        order = list(range(6))
        order[first], order[second] = second, first
        try:
            results = acceleration_agreement(short, machine, tuple(order))
        except HexsimError:  # these lengths belong to no pose
            continue
        worst = min((result.correlation for result in results.values()), default=0.0)
        if worst > best:
            best, found = worst, (first + 1, second + 1)
    return found


def inner(look: Window, x: Array) -> Array:
    """Without the ends that a window cannot see."""
    return x[..., look.half : x.shape[-1] - look.half]


def platform_acceleration(y: Array, machine: Machine, look: Window) -> dict[str, Array]:
    """Accelerations in the platform frame, at the centre of the joints, from the positions (forward kinematics)."""
    legs = machine_kinematics(machine)
    poses = legs.forward(y.T).T
    pose, rate, second = (inner(look, x).T for x in (look.mean(poses), look.rate(poses), look.second_rate(poses)))
    motion = legs.to_platform_frame(pose, legs.twist_rate(pose, rate, second)).T
    return dict(zip(accelerations_of(6), motion, strict=True))


def agreement(reference: Array, channel: Array, rate_Hz: float, noise: float, half: int) -> Agreement:
    """Gain, offset and delay of `channel` against `reference`, both through the same window of half width `half`.

    The delay maximises the correlation (parabola through the best three whole samples). A window leaves n / (2 half)
    independent samples; they carry the standard errors.
    """
    longest = min(int(rules.LONGEST_DELAY_S * rate_Hz), len(reference) // 4)
    core = slice(longest, len(reference) - longest)
    r = reference[core] - reference[core].mean()
    lags = np.arange(-longest, longest + 1)
    found = np.array([correlation(r, channel[longest + lag : len(channel) - longest + lag]) for lag in lags])
    best = int(np.argmax(np.abs(found)))
    shift = float(lags[best])
    if 0 < best < len(lags) - 1:
        left, middle, right = np.abs(found[best - 1 : best + 2])
        shift += 0.5 * float((left - right) / min(left - 2 * middle + right, -1e-15))
    x = np.interp(np.arange(len(reference))[core] + shift, np.arange(len(channel)), channel)
    spread = max(float(np.std(x)), 1e-12)
    gain = float(found[best] / np.abs(found[best] or 1.0) * np.std(r) / spread)  # noise on either side does not bias it
    rest = r - gain * (x - x.mean())
    sigma = max(float(np.std(rest)), noise)
    n_independent = max(len(x) / (2 * half), 4.0)
    slope = max(abs(gain) * float(np.std(np.gradient(x))), 1e-12)
    return Agreement(
        gain=gain,
        gain_error=sigma / spread / np.sqrt(n_independent),
        offset=float(reference[core].mean() - gain * x.mean()),
        delay_s=shift / rate_Hz,
        delay_error_s=sigma / slope / np.sqrt(n_independent) / rate_Hz,
        correlation=float(abs(found[best])),
        size=float(np.std(r)),
    )


def correlation(a: Array, b: Array) -> float:
    """Correlation of a (mean zero) with b; 0 where b stands still."""
    b = b - b.mean()
    size = float(np.sqrt(np.dot(a, a) * np.dot(b, b)))
    return float(np.dot(a, b)) / size if size > 0 else 0.0
