"""examples/learned_policy.py: the kept policy beats plain control where nothing was learned, and learning it runs."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("gymnasium", reason="pip install hexsim[gym]")

EXAMPLE = Path(__file__).parents[2] / "examples" / "learned_policy.py"


@pytest.fixture(scope="module")
def example():
    return runpy.run_path(str(EXAMPLE))


@pytest.mark.slow  # test_gym.py pays a policy more than plain control
def test_the_kept_policy_beats_plain_control(example):
    """On three machines that nothing was learned from, at half a hertz: reward above, peak below 0.7 of plain control's, each."""
    gains = np.array(json.loads(example["KEPT"].read_text())["gains"])
    plain, learned = (example["judged"](w, 3, 77_001) for w in (0.0 * gains, gains))
    assert (learned["reward"] > plain["reward"]).all()
    assert (learned["peak_m_s2"] < 0.7 * plain["peak_m_s2"]).all()


def test_what_is_kept_says_so(example):
    """The kept comparison is of machines that all do better at half a hertz; its table and its picture are made of it."""
    kept = json.loads(example["KEPT"].read_text())
    ways = kept["unseen"]["0.5 Hz"]
    assert len(kept["gains"]) == len(kept["features"]) == len(example["FEATURES"])
    for key, sign in (("reward", 1.0), ("peak_m_s2", -1.0)):
        assert (sign * (np.array(ways["learned"][key]) - np.array(ways["plain"][key])) > 0.0).all()
    assert f"{len(ways['plain']['reward'])} of {len(ways['plain']['reward'])}" in example["said"](kept)


def test_learning_runs(example):
    """One update on two machines: gains that are no longer zero, and a curve from none to what was learned from."""
    pytest.importorskip("stable_baselines3", reason="pip install hexsim[learn]")
    gains, curve = example["train"](machines=2, updates=1, watched=1)
    assert gains.shape == (9,) and np.abs(gains).max() > 0.0
    assert [row["seconds"] for row in curve] == [0, 4]
