"""The machine as a learning task: Gymnasium's own check, one machine and many alike, and what the reward sees."""

import warnings

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="pip install hexsim[gym]")
from gymnasium.utils.env_checker import check_env  # noqa: E402

import hexsim as hx  # noqa: E402
from hexsim import HexsimError, Scenario, gym  # noqa: E402
from hexsim.gym import task as tasks  # noqa: E402
from hexsim.machine import load_machine  # noqa: E402
from hexsim.machine.files import changed  # noqa: E402
from hexsim.setpoints import signals  # noqa: E402

MOTION = Scenario(
    name="m", mode="dof", signals={"z": signals.Sine(amplitude=0.04, frequency_Hz=0.8)}, duration_s=2.0, fade_s=0.5
)
EFFECTS = {
    "effects.valve_delay.delay_s": (0.004, 0.004),
    "effects.valve_hysteresis.half_width_V": (0.01, 0.05),
    "valve.hysteresis_percent": (1.0, 1.0),
    "valve.threshold_percent": (0.4, 0.4),
}


def test_gymnasium_has_nothing_to_say():
    """`check_env` on the registered environment, warnings as errors."""
    made = gymnasium.make("hexsim.gym:Hexsim-v0", machine="bench", duration_s=0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(made.unwrapped)


@pytest.mark.parametrize(("machine", "effects"), [("bench", EFFECTS), ("micro_motion_system", {})])
def test_many_machines_are_what_each_is_alone(machine, effects, monkeypatch):
    """Three drawn machines side by side, in two threads, under the same actions as each alone at the same constant step:
    observations to float32, rewards to 1e-9. Numbers differ between the machines."""
    monkeypatch.setattr(gym.Task, "drawn_motion", lambda self, random: MOTION)
    task = gym.Task(machine=load_machine(machine), effects=effects, duration_s=1.0)
    step = 1e-4
    many = gym.HexsimVectorEnv(3, task, threads=2, timestep=step)
    seen = [many.reset(seed=7)[0]]
    random = np.random.default_rng(1)
    actions = random.uniform(-1, 1, (60, 3, task.machine.n_legs)).astype(np.float32)
    rewards = []
    for action in actions:
        observation, reward, *_ = many.step(action)
        seen.append(observation)
        rewards.append(reward)
    for i, drawn in enumerate(many.machines):
        alone = gym.HexsimEnv(task, timestep=step)
        observation, _ = alone.reset(seed=0, options={"machine": drawn, "motion": MOTION})
        assert observation == pytest.approx(seen[0][i], abs=1e-6)
        for k, action in enumerate(actions[:, i]):
            observation, reward, *_ = alone.step(action)
            assert observation == pytest.approx(seen[k + 1][i], abs=1e-5)
            assert reward == pytest.approx(rewards[k][i], rel=1e-9, abs=1e-9)
    assert len({tuple(row) for row in np.round(seen[-1], 4)}) == 3


def test_same_seed_same_machines_and_episodes():
    """To the bit; another seed draws others."""
    found = []
    for seed in (3, 3, 4):
        many = gym.HexsimVectorEnv(2, machine="bench", duration_s=0.2)
        many.reset(seed=seed)
        found.append(np.array([many.step(np.full((2, 1), 0.1))[0] for _ in range(20)]))
    assert np.array_equal(found[0], found[1])
    assert not np.array_equal(found[0], found[2])


def test_an_episode_that_ends_is_begun_anew():
    """At its duration: truncated, the last observation kept in the infos, the next one at rest."""
    many = gym.HexsimVectorEnv(2, machine="bench", duration_s=0.1)
    many.reset(seed=0)
    for k in range(50):
        seen, _, failed, over, infos = many.step(np.full((2, 1), 0.5))
        assert over.all() == (k == 49)
        assert not failed.any()
    assert infos["_final_obs"].all()
    assert (infos["final_obs"][:, 7] == pytest.approx(0.5)) and (seen[:, 7] == 0).all()
    assert (many.episodes.step == 0).all()
    one = gym.HexsimEnv(machine="bench", duration_s=0.1)
    one.reset(seed=0)
    assert [one.step(np.zeros(1))[3] for _ in range(50)] == [False] * 49 + [True]


@pytest.mark.parametrize(("frequency_Hz", "low", "high"), [(0.3, 0.0, 0.03), (10.0, 0.95, 1.01), (200.0, 0.0, 0.1)])
def test_the_reward_looks_into_the_band(frequency_Hz, low, high):
    """A deviation that is a sine of the leg's acceleration: its share that is paid for, below, in and above the band."""
    task = gym.Task(duration_s=8.0)
    episodes = tasks.Episodes(task, 1)
    velocity, paid = np.zeros((1, 1)), []
    for k in range(4000):
        t = (k + 0.5) * task.tick_s
        velocity = velocity + task.tick_s * np.sin(2 * np.pi * frequency_Hz * t)
        paid.append(episodes.advance(np.zeros((1, 1)), velocity)[0])
    amplitude = tasks.SEEN.deviation_m_s2 * np.sqrt(2 * np.mean(-np.array(paid[2000:])))
    assert low <= amplitude <= high


def test_a_hand_made_policy_is_paid_more_than_plain_control():
    """Volts about the dead band in the direction of the error: what a learner should find first."""
    sums = []
    for kick in (0.0, 0.06):
        env = gym.HexsimEnv(machine="bench", spread=0.0)
        seen, _ = env.reset(seed=2, options={"motion": MOTION})
        total = 0.0
        for _ in range(1000):
            seen, reward, *_ = env.step(kick * np.tanh(10 * seen[:1]))
            total += reward
        sums.append(total)
    assert sums[1] > 0.9 * sums[0]


def test_uncertain_values_of_all_machines_are_drawn():
    """Each name in [uncertainty] of the shipped machines is a value of the file; draws stay within the declared width."""
    for name in hx.available()["machines"]:
        machine = load_machine(name)
        for key in machine.uncertainty:
            place, value = tasks.uncertain_key(machine, key)
            assert changed(machine, {place: value}) == machine
    bench = load_machine("bench")
    drawn = [
        gym.Task(machine=bench).drawn_machine(np.random.default_rng(k)).friction.coulomb_extend_N for k in range(50)
    ]
    width = bench.uncertainty["coulomb_extend_N"] * bench.friction.coulomb_extend_N
    assert np.abs(np.array(drawn) - bench.friction.coulomb_extend_N).max() <= width
    assert np.ptp(drawn) > width


def test_a_task_that_is_none_is_a_sentence():
    with pytest.raises(HexsimError, match="role 'boss': compensator or controller"):
        gym.Task(role="boss")
    with pytest.raises(HexsimError, match=r"amplitude_m = \(2, 1\): the first must not be above"):
        gym.Task(amplitude_m=(2.0, 1.0))
    with pytest.raises(HexsimError, match="reset the environment before its first step"):
        gym.HexsimEnv(machine="bench").step(np.zeros(1))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_actions_that_are_no_numbers_are_refused(bad):
    """NaN and both infinities, in one environment and in one of many: a sentence that names the leg and the environment; so are
    other shapes and things that are no numbers. The episode stands as it was."""
    one, many = gym.HexsimEnv(machine="bench", duration_s=0.1), gym.HexsimVectorEnv(2, machine="bench", duration_s=0.1)
    one.reset(seed=0)
    many.reset(seed=0)
    with pytest.raises(HexsimError, match=r"the action of leg 1 is .*: finite numbers are needed"):
        one.step([bad])
    with pytest.raises(HexsimError, match=r"the action of environment 1, leg 1 is"):
        many.step([[0.0], [bad]])
    for wrong in ([0.0, 0.0], 0.0, "full"):
        with pytest.raises(HexsimError, match=r"one number a leg is needed|numbers in \[-1, 1\] are needed"):
            one.step(wrong)
    assert one.episodes.step[0] == 0 and many.episodes.step.tolist() == [0, 0]


def test_actions_beyond_the_space_are_cut_and_said():
    """1e308 and 1.5 act as 1 to the bit, and info says that they were cut; 1 itself is not."""
    seen = []
    for size in (1.0, 1.5, 1e308):
        env = gym.HexsimEnv(machine="bench", duration_s=0.1)
        env.reset(seed=0)
        observation, *_, info = env.step(np.array([size]))
        seen.append((observation.tolist(), info["action_cut"]))
    assert seen[0][0] == seen[1][0] == seen[2][0]
    assert [cut for _, cut in seen] == [False, True, True]
    many = gym.HexsimVectorEnv(2, machine="bench", duration_s=0.1)
    many.reset(seed=0)
    assert many.step(np.array([[0.5], [-2.0]]))[4]["action_cut"].tolist() == [False, True]


def test_options_of_a_reset_are_checked():
    """Unknown names, wrong types, a machine with other legs: a sentence; what is right acts."""
    env, bench = gym.HexsimEnv(machine="bench", duration_s=0.1), load_machine("bench")
    for options, says in (
        ({"motions": MOTION}, "reset has no option 'motions': there are motion, machine"),
        ({"motion": "heave"}, "option motion of reset is a str: give a Scenario"),
        ({"machine": {"name": "x"}}, "option machine of reset is a dict: give a Machine"),
        ({"machine": load_machine("micro_motion_system")}, "has 6 legs, the task's machine 1"),
    ):
        with pytest.raises(HexsimError, match=says):
            env.reset(options=options)
    assert env.reset(options={"machine": bench, "motion": MOTION})[1]["machine"] is bench
    with pytest.raises(HexsimError, match="reset has no option 'motion': it has none"):
        gym.HexsimVectorEnv(2, machine="bench").reset(options={"motion": MOTION})
