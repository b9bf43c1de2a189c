"""The setpoint's future where nobody gives it."""

from __future__ import annotations

import numpy as np
import pytest
from leg_plant import sine

from compensation import prediction, records


def watched(predictor: records.Record, preview_m: np.ndarray, setpoint_m: float) -> bool:
    """One tick: whether the future must be predicted."""
    middle = (len(preview_m) - 1) // 2
    bend = float(preview_m[0] - 2.0 * preview_m[middle] + preview_m[2 * middle])
    return prediction.watch_setpoint(predictor, len(preview_m), bend, setpoint_m)


def predictor_unused() -> records.Record:
    """A predictor that has seen nothing."""
    predictor = records.empty(prediction.PREDICTION)
    prediction.start_prediction(predictor)
    return predictor


def test_the_future_of_a_smooth_setpoint_is_predicted() -> None:
    """A sine of 0.05 m at 0.5 Hz without preview, nine ticks on: within 5 um, its acceleration within 0.02 m/s2."""
    predictor, made = predictor_unused(), []
    wanted = sine()(np.arange(5000) * 0.002)
    for setpoint in wanted:
        assert watched(predictor, np.array([setpoint]), float(setpoint))
        made.append(prediction.predict(predictor, prediction.prediction_table(), 9, float(setpoint))[1])
    late, asked = np.array(made)[3000:-9], wanted[3009:]
    assert np.abs(np.diff(late - asked, 2)).max() / 0.002**2 < 0.02
    assert np.std(late - asked) < 5e-4  # it follows the prediction softly: a lag of a millisecond or two


def test_a_jump_of_packets_comes_in_later() -> None:
    """A setpoint that stands, then stands 100 um further: what is given accelerates by at most 0.11 m/s2."""
    predictor, made = predictor_unused(), []
    for k in range(1500):
        setpoint = 0.1 if k < 500 else 0.1001
        watched(predictor, np.array([setpoint]), setpoint)
        made.append(prediction.predict(predictor, prediction.prediction_table(), 9, setpoint)[1])
    assert abs(predictor.offset_m) < prediction.FOLLOWING.max_offset_m
    assert np.abs(np.diff(made, 2)).max() / 0.002**2 < 0.11
    assert made[-1] == pytest.approx(0.1001, abs=2e-5)


def test_a_preview_that_tells_the_future_is_taken() -> None:
    """A sine's own preview is never replaced; a straight line is, once the motion has been curved for 50 ms."""
    given, straight = predictor_unused(), predictor_unused()
    wanted = sine()(np.arange(1200) * 0.002)
    for k in range(1, 1000):
        assert not watched(given, wanted[k : k + 15], float(wanted[k]))
        line = wanted[k] + (wanted[k] - wanted[k - 1]) * np.arange(15)
        watched(straight, line, float(wanted[k]))
    assert straight.active
