"""Rerun recordings, read back from the file."""

from pathlib import Path

import numpy as np
import pytest
from made_up_run import BUMP_M_S2, log_of, made_up_log, made_up_machine, made_up_run
from rerun.chunk import RrdReader

from hexsim.recording import rerun_recording
from hexsim.recording.signals import Signals


class Recording:
    """What is in a .rrd file: entity -> (time_s, component values)."""

    def __init__(self, path: Path) -> None:
        self.reader = RrdReader(path)
        self.chunks = list(self.reader.stream().to_chunks())
        self.blueprints = self.reader.blueprints()

    def time_plots(self) -> list[set[str]]:
        """The entities that each time series view of the file's one blueprint asks for."""
        [blueprint] = self.blueprints
        told: dict[str, dict] = {}
        for chunk in self.reader.stream(store=blueprint).to_chunks():
            batch = chunk.to_record_batch()
            told.setdefault(chunk.entity_path, {}).update(
                {name: batch.column(name).to_pylist() for name in batch.schema.names if name.startswith("View")}
            )
        return [
            {query.removeprefix("+ ") for query in told[f"{view}/ViewContents"]["ViewContents:query"][0]}
            for view, columns in told.items()
            if columns.get("ViewBlueprint:class_identifier") == [["TimeSeries"]]
        ]

    def entities(self, moving: bool = True) -> set[str]:
        return {chunk.entity_path for chunk in self.chunks if not (moving and chunk.is_static)}

    def read(self, entity: str, component: str) -> tuple[np.ndarray, np.ndarray]:
        """Time [s] and values, one row a sample, over all chunks of the entity."""
        times, values = [], []
        for chunk in self.chunks:
            if chunk.entity_path != entity or chunk.is_static:
                continue
            batch = chunk.to_record_batch()
            times.append(batch.column("time").cast("int64").to_numpy() * 1e-9)
            values.append(np.array([row[0] for row in batch.column(component).to_pylist()]))
        order = np.argsort(np.concatenate(times), kind="stable")
        return np.concatenate(times)[order], np.concatenate(values)[order]


def recorded(folder: Path, hexapod: bool = True) -> tuple[Recording, Signals]:
    run = made_up_run(hexapod, duration_s=4.0)
    signals = Signals.of_run(run)
    rerun_recording.write_recording(
        folder / "run.rrd", {"heave": signals}, {"heave": "| axis |"}, {"heave": run.messages}
    )
    return Recording(folder / "run.rrd"), signals


def test_series_are_the_log_in_the_units_people_read(tmp_path):
    """Position in mm and valve volts come back exactly as logged; nanosecond time stamps are the log's."""
    recording, signals = recorded(tmp_path)
    time, values = recording.read("/heave/legs/3/position", "Scalars:scalars")
    every = slice(None, None, 2)  # leg signals are sent at 500 Hz of the log's 1000 Hz
    assert np.array_equal(np.rint(time * 1e9), np.rint(signals.time_s[every] * 1e9))
    position = signals.leg(3, "position")
    assert np.array_equal(values, 1e3 * position[every])
    _, error = recording.read("/heave/legs/3/error", "Scalars:scalars")
    assert np.allclose(error, 1e3 * (signals.leg(3, "setpoint") - position)[every], rtol=0, atol=1e-12)
    time, acceleration = recording.read("/heave/acceleration/z/raw", "Scalars:scalars")
    assert np.array_equal(acceleration, signals.acceleration("z"))  # at the full rate: bumps are short


def test_rods_meet_the_platform(tmp_path):
    """In every frame each leg's rod ends on its platform joint and its cylinder points there (float32: 1e-6 m)."""
    recording, signals = recorded(tmp_path)
    time, centre = recording.read("/heave/machine/platform", "Transform3D:translation")
    pose = signals.pose()[:: len(signals.time_s) // len(time)]
    kinematics = signals.kinematics
    assert np.allclose(centre, pose[:, :3] + [0, 0, kinematics.neutral_height_m], rtol=0, atol=1e-6)
    for leg in range(6):
        _, end = recording.read(f"/heave/machine/leg_{leg + 1}/rod", "Transform3D:translation")
        _, foot = recording.read(f"/heave/machine/leg_{leg + 1}/cylinder", "Transform3D:translation")
        _, q = recording.read(f"/heave/machine/leg_{leg + 1}/cylinder", "Transform3D:quaternion")
        assert np.allclose(foot, kinematics.base_joints[leg], rtol=0, atol=1e-6)
        length = kinematics.leg_lengths(pose)[:, leg]
        assert np.allclose(np.linalg.norm(end - foot, axis=1), length, rtol=0, atol=2e-6)
        x, y, z, w = q.T
        axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
        assert np.allclose(axis, (end - foot) / length[:, None], rtol=0, atol=1e-5)


def test_peaks_stand_at_the_reversals(tmp_path):
    """Each reversal after the fade-in is marked once, where the drawn bump is largest and with its size.

    The 50 Hz filter (gain 0.98 at 30 Hz, less on the packet's upper side band) takes 5 to 10 % of the 30 Hz packet.
    """
    recording, _ = recorded(tmp_path)
    time, peaks = recording.read("/heave/deviation/z/reversal_peaks", "Scalars:scalars")
    assert np.allclose(time, [2.5, 3.5], rtol=0, atol=0.002)
    assert np.array_equal(np.sign(peaks), [1, -1])
    assert np.all((np.abs(peaks) > 0.88 * BUMP_M_S2) & (np.abs(peaks) < 1.02 * BUMP_M_S2))


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("hexapod", [True, False])
def test_every_plot_of_the_blueprint_shows_something(tmp_path, count, hexapod):
    """Each time series view names at least one entity that the recording holds, and the file carries a blueprint."""
    log = made_up_log(made_up_machine(hexapod), 3.0)
    axis = "z" if hexapod else "leg"
    runs = {
        f"run {k}": Signals(
            log=log_of(log, made_up_machine(hexapod)),
            machine=made_up_machine(hexapod),
            driven=(axis,),
            frequency_Hz=0.5,
        )
        for k in range(count)
    }
    rerun_recording.write_recording(tmp_path / "run.rrd", runs, {name: "text" for name in runs})
    recording = Recording(tmp_path / "run.rrd")
    plots = recording.time_plots()
    assert len(plots) >= 8
    present = recording.entities()
    for wanted in plots:
        assert wanted & present, f"a plot shows none of {wanted}"


def test_several_runs_share_one_time_line_and_stand_apart(tmp_path):
    """Runs of different length lie on the same time line from 0, and their machines do not overlap."""
    short, long = made_up_run(duration_s=3.0), made_up_run(duration_s=4.0)
    rerun_recording.write_recording(
        tmp_path / "two.rrd", {"none": Signals.of_run(short), "my.module:Mine": Signals.of_run(long)}
    )
    recording = Recording(tmp_path / "two.rrd")
    ends = {}
    for root in ("none", "my_module_Mine"):
        time, _ = recording.read(f"/{root}/deviation/z/within_band", "Scalars:scalars")
        ends[root] = time[-1]
    assert ends == pytest.approx({"none": 2.999, "my_module_Mine": 3.999}, abs=1e-9)
    places = []
    for root in ("none", "my_module_Mine"):
        chunk = next(c for c in recording.chunks if c.entity_path == f"/{root}/machine" and c.is_static)
        places.append(chunk.to_record_batch().column("Transform3D:translation").to_pylist()[0][0])
    assert np.linalg.norm(np.subtract(*places)) > 2 * 0.6 + 0.1  # two base radii and room between


def test_a_measured_log_is_recorded_too(tmp_path):
    """A log without truth, pose or supply still gives legs, pose by forward kinematics, and the machine in 3-D."""
    machine = made_up_machine()
    log = made_up_log(machine, 3.0)
    kept = [n for n in log.columns if not n.startswith(("true_", "platform_", "commanded_", "flow", "pressure_supply"))]
    signals = Signals(log=log_of(log.select(kept), machine), machine=machine, frequency_Hz=0.5)
    assert signals.driven_axes == ("z",)
    rerun_recording.write_recording(tmp_path / "measured.rrd", {"measured": signals})
    recording = Recording(tmp_path / "measured.rrd")
    assert "/measured/machine/leg_6/rod" in recording.entities()
    assert "/measured/legs/1/flow" not in recording.entities()
    _, heave = recording.read("/measured/pose/z/actual", "Scalars:scalars")
    assert np.allclose(heave, 1e3 * log["platform_z_m"].to_numpy()[::2], rtol=0, atol=1e-6)


def test_messages_and_figures_are_in_the_recording(tmp_path):
    """What the motion computer said stands at its time, the table of figures beside it."""
    recording, _ = recorded(tmp_path)
    time, text = recording.read("/heave/messages", "TextLog:text")
    assert time == pytest.approx([1.0]) and list(text) == ["leg 1: a message"]
    assert "/heave/summary" in recording.entities(moving=False)
