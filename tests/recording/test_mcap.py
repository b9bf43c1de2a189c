"""A run as MCAP: what stands in it is the log, its messages are as its schemas say, and it can be read back."""

import json
from dataclasses import replace

import jsonschema
import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from hexsim import HexsimError, load_scenario
from hexsim.cli import app
from hexsim.files import log_files
from hexsim.readers import files
from hexsim.recording import mcap as written
from hexsim.recording import run_files
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
    raw = files.raw_log(path)
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


def test_a_run_folder_becomes_the_same_file(run, path, tmp_path):
    """`hexsim export mcap` of a run's folder, and of its log as CSV with a column of one's own: the messages are the log's rows, and
    the configuration is in it; damage, a wrong name and a missing log are one sentence, and leave nothing behind."""

    def export(*arguments):
        return CliRunner().invoke(app, ["export", "mcap", *map(str, arguments)])

    folder = tmp_path / "run"
    folder.mkdir()
    run_files.write_essentials(run, folder, "parquet")
    assert export(folder).exit_code == 0

    def topics(file):
        with open(file, "rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            found = {}
            for _, channel, message in reader.iter_messages():
                found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
            return found, json.loads(next(reader.iter_metadata()).metadata["config"])

    written_first, _ = topics(path)
    again, config = topics(folder / "run.mcap")
    assert again == {topic: rows for topic, rows in written_first.items() if topic != "/messages"}
    assert config["run"]["scenario"] == "heave"

    other = tmp_path / "bench.csv.gz"
    time = np.arange(3) * 1e-3
    log_files.write_log(
        pl.DataFrame({"time_s": time, "position_m": [0.1, np.nan, 0.3], "oil_level_m": [1.0, 2.0, 3.0]}), other
    )
    assert export(other, "-o", tmp_path / "b.mcap").exit_code == 0
    found, config = topics(tmp_path / "b.mcap")
    assert [row for _, row in found["/measured"]] == [
        {"position_m": 0.1, "oil_level_m": 1.0},
        {"position_m": None, "oil_level_m": 2.0},
        {"position_m": 0.3, "oil_level_m": 3.0},
    ]
    assert [stamp for stamp, _ in found["/measured"]] == [0, 1_000_000, 2_000_000] and config == {}

    (tmp_path / "text.csv").write_text("a,b\n1,2\n")
    (tmp_path / "torn.parquet").write_bytes(b"PAR1 no")
    for wrong in ("text.csv", "torn.parquet", "missing.csv", "."):
        before = sorted(tmp_path.rglob("*"))
        refused = export(tmp_path / wrong)
        assert refused.exit_code == 2 and "Traceback" not in refused.output and refused.stderr.startswith("hexsim: "), (
            wrong
        )
        assert sorted(tmp_path.rglob("*")) == before
    assert "ends in .mcap" in export(other, "-o", tmp_path / "b.txt").stderr
