"""Wind from tilt in recordings with a known wind, with the drag of the simulated aircraft."""

from __future__ import annotations

import pytest

from tests.benchmarks.wind import RECORDINGS, drag_of, estimates_in
from tests.mavlink.conftest import SHARED

pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif(
        not (SHARED / "traces").is_dir(), reason="no recordings beside the checkout"
    ),
]


@pytest.mark.parametrize("recording", RECORDINGS, ids=lambda recording: recording.path)
def test_the_true_wind_is_estimated_from_the_lean(recording):
    estimates = estimates_in(recording.path, drag_of(recording.manner))
    for begin_s, end_s, true_mps in recording.segments:
        wind = estimates[(estimates[:, 0] >= begin_s) & (estimates[:, 0] < end_s), 1]
        assert len(wind) > 0.9 * (end_s - begin_s) / 0.1
        assert wind.mean() == pytest.approx(true_mps, abs=0.7)
        assert wind.std() < 0.7
