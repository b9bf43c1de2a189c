"""A compensator found by reinforcement learning: PPO of stable-baselines3 against the bump of benches that differ.

    python examples/learned_policy.py                           the kept policy and plain control, on machines it never saw
    python examples/learned_policy.py --train --out FOLDER      learn it anew: four minutes of one core

    u = sat(Kp (r - y) + 0.1 V  w' f)        f: nine signals of the leg at a tick, see `features`; w: what is learned

The learner sets w, which is held for one second, and is paid the mean reward of that second: one reversal at half a
hertz. It sees nothing beside that: each second is a task of its own (discount 0), so that what explores is the gains and
not volts from tick to tick, which would make more jerk than they find. Needs `pip install 'hexsim[learn]'` to learn
and `hexsim[gym]` to look. What is learned from: 80 s on each of 64 machines, no two of them alike.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hexsim.gym import HexsimVectorEnv, Task
from hexsim.recording import palette
from hexsim.recording.figure_style import legend, new_figure, png, styled

Array = NDArray[np.float64]
KEPT = Path(__file__).parents[1] / "docs" / "results" / "learned_policy.json"
FEATURES = (
    "tanh(error / 20 um)",
    "tanh(error / 0.1 mm)",
    "tanh(error / 1 mm)",
    "tanh(commanded velocity / 5 mm/s)",
    "tanh(velocity / 5 mm/s)",
    "velocity / 0.1 m/s",
    "pressure less that at rest / 0.05 Ps",
    "its change in a tick / 0.05 Ps",
    "commanded acceleration / 0.5 m/s2",
)
TASK = Task(authority_V=0.1, frequency_Hz=(0.5, 0.5), duration_s=4.0)  # 0.1 V: twice the overlap's 0.045 V
HELD_TICKS = 500  # a second
WATCH_EVERY = 4  # updates
MACHINES, TRAINING_SEED, WATCHED_SEED, UNSEEN_SEED = 64, 1, 1001, 9001
SETTLED_S = 1.5  # of an episode: its fade, and the lag of the loop


def features(seen: Array, before: Array) -> Array:
    """(n, 9) of observations (n, 8) at this tick and the one before."""
    error, pressure = seen[:, 0], 20.0 * seen[:, 6]
    return np.stack(
        [
            np.tanh(50 * error),
            np.tanh(10 * error),
            np.tanh(error),
            np.tanh(20 * seen[:, 1]),
            np.tanh(20 * seen[:, 5]),
            seen[:, 5],
            pressure,
            pressure - 20.0 * before[:, 6],
            seen[:, 4],
        ],
        axis=1,
    )


class Law:
    """Actions (n, 1) of observations, by gains (9,) or of each machine (n, 9)."""

    def __init__(self, gains: Array) -> None:
        self.gains, self.before = np.asarray(gains, dtype=float), None

    def __call__(self, seen: Array) -> Array:
        before = seen if self.before is None else self.before
        self.before = seen
        return np.sum(self.gains * features(seen, before), axis=1, keepdims=True)


def judged(gains: Array, machines: int, seed: int, task: Task = TASK) -> dict[str, Array]:
    """Mean reward and largest deviation in the band (machines,), and its course (ticks, machines), of a law that explores nothing."""
    env = HexsimVectorEnv(machines, task, threads=1)
    seen, _ = env.reset(seed=seed)
    law, paid, course = Law(gains), [], []
    for _ in range(task.ticks):
        seen, reward, *_, info = env.step(law(seen))
        paid.append(reward)
        course.append(info["deviation_m_s2"][:, 0])
    deviation = np.array(course)
    settled = np.abs(deviation[round(SETTLED_S / task.tick_s) :])
    return {"reward": np.mean(paid, axis=0), "peak_m_s2": settled.max(axis=0), "course_m_s2": deviation}


def train(machines: int = MACHINES, updates: int = 40, watched: int = 8, seed: int = 0) -> tuple[Array, list[dict]]:
    """Gains (9,), and the learning curve on machines that it does not learn from."""
    import gymnasium
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecEnv

    class Gains(VecEnv):
        """An action is the gains of a second, on every machine its own."""

        def __init__(self) -> None:
            box = gymnasium.spaces.Box
            self.machines, self.nothing = HexsimVectorEnv(machines, TASK, threads=1), np.ones((machines, 1), np.float32)
            super().__init__(machines, box(0, 1, (1,), np.float32), box(-2, 2, (len(FEATURES),), np.float32))

        def reset(self):
            self.seen, _ = self.machines.reset(seed=TRAINING_SEED)
            return self.nothing

        def step_async(self, actions):
            self.law = Law(actions)

        def step_wait(self):
            paid = np.zeros(machines)
            for _ in range(HELD_TICKS):
                self.seen, reward, *_ = self.machines.step(self.law(self.seen))
                paid += 10.0 * reward / HELD_TICKS
            infos = [{"terminal_observation": row} for row in self.nothing]
            return self.nothing, paid.astype(np.float32), np.ones(machines, dtype=bool), infos

        def close(self):
            pass

        def get_attr(self, attr_name, indices=None):
            return [None] * machines

        def set_attr(self, attr_name, value, indices=None):
            pass

        def env_method(self, method_name, *arguments, indices=None, **named):
            return [None] * machines

        def env_is_wrapped(self, wrapper_class, indices=None):
            return [False] * machines

    curve: list[dict] = []

    class Watch(BaseCallback):
        def _on_step(self) -> bool:
            return True

        def _on_rollout_start(self) -> None:
            rollout = self.num_timesteps // (2 * machines)
            if rollout % WATCH_EVERY == 0:
                curve.append(
                    {"seconds": self.num_timesteps} | _figures(judged(_mean(self.model), watched, WATCHED_SEED))
                )
                print(curve[-1], flush=True)

    learner = PPO(
        "MlpPolicy",
        Gains(),
        n_steps=2,
        batch_size=machines,
        n_epochs=10,
        gamma=0.0,
        gae_lambda=1.0,
        learning_rate=lambda left: 0.02 * max(left, 0.1),
        max_grad_norm=10.0,
        seed=seed,
        device="cpu",
        policy_kwargs={"net_arch": [], "log_std_init": float(np.log(0.08))},
    )
    with np.errstate(all="ignore"):
        learner.learn(2 * machines * updates, callback=Watch())
    gains = _mean(learner)
    curve.append({"seconds": 2 * machines * updates} | _figures(judged(gains, watched, WATCHED_SEED)))
    return gains, curve


def _mean(learner) -> Array:
    """The gains that the learner would choose."""
    return np.round(learner.predict(np.ones((1, 1), np.float32), deterministic=True)[0][0].astype(float), 4)


def _figures(found: dict[str, Array]) -> dict[str, float]:
    return {"reward": round(float(found["reward"].mean()), 5), "peak_m_s2": round(float(found["peak_m_s2"].mean()), 4)}


def compared(gains: Array, machines: int = 32) -> dict[str, dict]:
    """The law against plain control on machines that nothing was learned from: reward and peak of each, at three motions."""
    motions = {
        "0.5 Hz": TASK,
        "0.3 Hz": Task(authority_V=0.1, frequency_Hz=(0.3, 0.3), duration_s=5.0),
        "0.8 Hz": Task(authority_V=0.1, frequency_Hz=(0.8, 0.8), amplitude_m=(0.01, 0.03), duration_s=4.0),
    }
    table = {}
    for name, task in motions.items():
        of = {way: judged(w, machines, UNSEEN_SEED, task) for way, w in (("plain", 0.0 * gains), ("learned", gains))}
        table[name] = {
            way: {key: np.round(found[key], 4).tolist() for key in ("reward", "peak_m_s2")} for way, found in of.items()
        }
    return table


@styled
def picture(kept: dict) -> bytes:
    """The learning curve, the bump of each unseen machine, and one of them over time, as PNG."""
    figure, (curve, peaks, course) = new_figure(3, "A learned compensator on the bench, 0.5 Hz", height=8.0)
    seconds = [row["seconds"] for row in kept["curve"]]
    curve.plot(
        seconds, [row["peak_m_s2"] for row in kept["curve"]], "o-", color=palette.RESPONSE, ms=3.5, label="learned"
    )
    curve.axhline(kept["curve"][0]["peak_m_s2"], color=palette.DEVIATION, label="plain control")
    curve.set(xlabel="seconds of machine time that were learned from", ylabel="mean peak [m/s²]")
    test = kept["unseen"]["0.5 Hz"]
    order = np.argsort(test["plain"]["peak_m_s2"])
    for way, color in (("plain", palette.DEVIATION), ("learned", palette.RESPONSE)):
        peaks.plot(1 + np.arange(len(order)), np.array(test[way]["peak_m_s2"])[order], "o", ms=3.5, color=color)
        found = judged(np.array(kept["gains"]) * (way == "learned"), 1, UNSEEN_SEED)["course_m_s2"][:, 0]
        time = TASK.tick_s * np.arange(1, len(found) + 1)
        course.plot(time, found, color=color, lw=1.0, zorder=2 + (way == "learned"))
    peaks.set(xlabel="machine, none of which was learned from", ylabel="peak [m/s²]")
    course.set(xlabel="time [s]", ylabel="deviation, 4 to 50 Hz [m/s²]", xlim=(SETTLED_S, TASK.duration_s))
    for plot in (curve, peaks):
        plot.set_ylim(0.0, None)
    legend(curve)
    return png(figure, 120)


def said(kept: dict) -> str:
    """The comparison as a table."""
    lines = [
        "motion   mean reward: plain, learned   mean peak [m/s2]: plain, learned   largest   machines that are better"
    ]
    for name, ways in kept["unseen"].items():
        plain, learned = (np.array([ways[way]["reward"], ways[way]["peak_m_s2"]]) for way in ("plain", "learned"))
        better = int(np.sum(learned[1] < plain[1]))
        lines.append(
            f"{name:<8} {plain[0].mean():10.4f} {learned[0].mean():10.4f} {plain[1].mean():16.3f} {learned[1].mean():8.3f}"
            f" {plain[1].max():12.3f} {learned[1].max():6.3f} {better:12d} of {plain.shape[1]}"
        )
    return "\n".join(lines)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description="A learned compensator against plain control.")
    parser.add_argument("--train", action="store_true", help="learn anew in place of the kept policy")
    parser.add_argument("--out", type=Path, help="folder for learned_policy.json and learned_policy.png")
    options = parser.parse_args(arguments)
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    if options.train:
        gains, curve = train()
        kept = {"features": FEATURES, "gains": gains.tolist(), "curve": curve, "unseen": compared(gains)}
    print(said(kept))
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "learned_policy.json").write_text(json.dumps(kept) + "\n", encoding="utf-8")
        (options.out / "learned_policy.png").write_bytes(picture(kept))


if __name__ == "__main__":
    main(sys.argv[1:])
