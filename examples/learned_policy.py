"""A policy that is learned on the bench beats plain control: the cross-entropy method on `hexsim.gym`, with numpy alone.

    python examples/learned_policy.py --generations 12 --out runs/learned_policy

The policy adds volts from what the environment shows, six weights: the signs of the commanded velocity now, 10 and 20 ms
ahead, that velocity, the commanded acceleration, the load's pressure. Each generation draws weights about the mean of
the best quarter of the last one (de Boer et al., A Tutorial on the Cross-Entropy Method, 2005) and judges them all on
the same machine and motion, drawn anew. The curve is the mean's bump on eight machines and motions that it never learned
from, beside plain control. Stable-Baselines3 takes the same environment; this needs nothing but it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import gymnasium
import matplotlib.pyplot as plt
import numpy as np

SIGN = 20.0  # of the velocity seen: 5 mm/s is a motion
FIRST_SPREAD = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1])  # of the weights
POPULATION, BEST = 16, 4
LEAST_SPREAD = 0.005
UNSEEN = range(1000, 1008)  # seeds of the machines and motions of the curve


def action(weights: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """What is added, a share of the authority (1 V)."""
    features = [*np.tanh(SIGN * seen[1:4]), seen[3], seen[4], seen[6]]
    return np.array([np.clip(weights @ features, -1.0, 1.0)], np.float32)


def bump_m_s2(env: gymnasium.Env, weights: np.ndarray, seed: int) -> float:
    """Root mean square of the acceleration beyond the commanded one between 4 and 50 Hz, after the first second."""
    seen, _ = env.reset(seed=seed)
    squares, over = [], False
    while not over:
        seen, _, failed, over, info = env.step(action(weights, seen))
        squares.append(float(np.mean(info["deviation_m_s2"] ** 2)))
        if failed:
            return np.inf
    return float(np.sqrt(np.mean(squares[500:])))


def learn(env: gymnasium.Env, generations: int, seed: int = 0) -> tuple[np.ndarray, list[float]]:
    """Weights, and their bump on unseen episodes before each generation and at the end."""
    random = np.random.default_rng(seed)
    mean, spread, curve = np.zeros(6), FIRST_SPREAD, []
    for generation in range(generations):
        curve.append(unseen_m_s2(env, mean))
        print(f"generation {generation}: {curve[-1]:.4f} m/s2", flush=True)
        tried = mean + spread * random.normal(size=(POPULATION, 6))
        order = np.argsort([bump_m_s2(env, weights, generation) for weights in tried])
        best = tried[order[:BEST]]
        mean, spread = best.mean(axis=0), np.maximum(best.std(axis=0), LEAST_SPREAD)
    return mean, [*curve, unseen_m_s2(env, mean)]


def unseen_m_s2(env: gymnasium.Env, weights: np.ndarray) -> float:
    return float(np.mean([bump_m_s2(env, weights, seed) for seed in UNSEEN]))


def draw(curve: list[float], out: Path) -> None:
    """Bump over generations, plain control dashed."""
    figure, axes = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
    axes.axhline(curve[0], color="0.4", linestyle="--", label="plain control")
    axes.plot(range(len(curve)), curve, marker="o", label="learned policy")
    axes.set(xlabel="generation", ylabel="rms acceleration error, 4 to 50 Hz (m/s²)", ylim=(0, None))
    axes.legend()
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / "learned_policy.png", dpi=150)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--generations", type=int, default=12)
    parser.add_argument("--duration", type=float, default=5.0, help="of an episode (s)")
    parser.add_argument("--out", type=Path, default=Path("runs/learned_policy"))
    given = parser.parse_args()
    env = gymnasium.make("hexsim.gym:Hexsim-v0", machine="bench", duration_s=given.duration).unwrapped
    weights, curve = learn(env, given.generations)
    draw(curve, given.out)
    print(f"plain control {curve[0]:.4f} m/s2, learned {curve[-1]:.4f} m/s2; weights {np.round(weights, 3).tolist()}")


if __name__ == "__main__":
    main()
