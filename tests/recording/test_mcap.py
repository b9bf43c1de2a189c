"""A run as MCAP: what stands in it is the log, its messages are as its schemas say, and it can be read back."""

import json
from dataclasses import replace

import jsonschema
import numpy as np
import pytest

from hexsim.errors import HexsimError
from hexsim.readers.files import raw_log
from hexsim.recording import mcap as written
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate

mcap = pytest.importorskip("mcap", reason="pip install hexsim[ros]")
from mcap.reader import make_reader  # noqa: E402


@pytest.fixture(scope="module")
def run(hexapod):
    done = simulate(hexapod, replace(load_scenario("heave"), duration_s=0.5), fast=True)
    done.messages.append((0.25, 3, "stopped"))
    return done


@pytest.fixture(scope="module")
def path(run, tmp_path_factory):
    out = tmp_path_factory.mktemp("mcap") / "run.mcap"
    written.write_mcap(run, out)
    return out


def test_messages_are_as_their_schemas_say(run, path):
    """Every message against the JSON schema of its channel, with the fields of Foxglove's own where it has that name."""
    counts: dict[str, int] = {}
    with open(path, "rb") as stream:
        for schema, channel, message in make_reader(stream, validate_crcs=True).iter_messages():
            fields = json.loads(schema.data)
            content = json.loads(message.data)
            if counts.setdefault(channel.topic, 0) % 50 == 0:
                jsonschema.validate(content, fields)
            assert set(content) == set(fields["properties"])
            counts[channel.topic] += 1
    assert counts == {"/measured": run.log.height, "/truth": run.log.height, "/tf": 25, "/messages": 1}


def test_read_back_it_is_the_log(run, path):
    """Every column of the log to the bit, the time within a nanosecond."""
    raw = raw_log(path)
    for name in run.log.columns[1:]:
        signal = raw.one(name, name, path)
        assert np.abs(signal.stamps["time of receipt"] - run.log["time_s"].to_numpy()).max() <= 1e-9
        assert np.array_equal(signal.values, run.log[name].to_numpy(), equal_nan=True), name


def test_the_platform_turns_as_the_log_says(hexapod, tmp_path):
    """The quaternion of /tf against the logged roll: pitch and yaw are small beside it."""
    scenario = load_scenario("roll")
    done = simulate(hexapod, replace(scenario, duration_s=1.0), fast=True)
    written.write_mcap(done, tmp_path / "run.mcap")
    with open(tmp_path / "run.mcap", "rb") as stream:
        frames = [json.loads(m.data) for _, c, m in make_reader(stream).iter_messages(topics=["/tf"])]
    every = round(0.02 / (done.log["time_s"][1] - done.log["time_s"][0]))
    roll = done.log["platform_roll_rad"].to_numpy()[::every]
    turned = np.array([2 * np.arctan2(f["rotation"]["x"], f["rotation"]["w"]) for f in frames])
    assert np.ptp(roll) > 1e-3
    assert turned == pytest.approx(roll, abs=1e-5)


def test_without_the_library_the_sentence_says_what_to_install(run, tmp_path, monkeypatch):
    """Before anything is written."""
    monkeypatch.setattr(written.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(HexsimError, match=r"pip install 'hexsim\[ros\]'"):
        written.write_mcap(run, tmp_path / "no.mcap")
    assert not list(tmp_path.iterdir())
