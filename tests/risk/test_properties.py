"""Properties of all four indices together, for any measurements."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import Battery, LinkNode, LinkStatistics, Odometry
from moar_companion.settings.risk_model import RiskModel

INDICES = ("wind", "communication", "localization", "battery")
MODEL = RiskModel(cells=4)

# Measured values from good to bad: source and fields. Each is linear in `badness`.
MEASURED = {
    "wind reported": lambda bad: ("wind", {"velocity_ned_mps": (15.0 * bad, 0.0, 0.0)}),
    "lean": lambda bad: ("attitude", {"pitch_rad": 0.6 * bad}),
    "motor output": lambda bad: ("motors", {"pulse_us": (1500.0, 1500.0 + 500.0 * bad)}),
    "signal here": lambda bad: ("radio", {"rssi": 180.0 - 140.0 * bad}),
    "noise there": lambda bad: ("radio", {"remote_noise": 45.0 + 130.0 * bad}),
    "transmit buffer": lambda bad: ("radio", {"transmit_buffer_percent": 95.0 - 95.0 * bad}),
    "remote control": lambda bad: ("remote_control", {"rssi": 0.95 - 0.9 * bad}),
    "satellites": lambda bad: ("gnss", {"satellites": 14.0 - 14.0 * bad}),
    "hdop": lambda bad: ("gnss", {"hdop": 0.7 + 4.0 * bad}),
    "vdop": lambda bad: ("gnss", {"vdop": 1.1 + 6.0 * bad}),
    "receiver accuracy": lambda bad: ("gnss", {"horizontal_accuracy_m": 0.9 + 6.0 * bad}),
    "receiver height": lambda bad: ("gnss", {"vertical_accuracy_m": 1.8 + 9.0 * bad}),
    "estimator accuracy": lambda bad: ("estimator", {"horizontal_accuracy_m": 0.3 + 6.0 * bad}),
    "position innovation": lambda bad: ("estimator", {"position_innovation": 0.1 + bad}),
    "velocity innovation": lambda bad: ("estimator", {"velocity_innovation": 0.1 + bad}),
    "height innovation": lambda bad: ("estimator", {"height_innovation": 0.1 + bad}),
    "compass innovation": lambda bad: ("estimator", {"compass_innovation": 0.1 + bad}),
    "way home": lambda bad: ("local_position", {"position_ned_m": (30.0 + 9000.0 * bad, 0, -10)}),
}
OTHERS = {
    "battery left": lambda t, bad: (
        "batteries",
        {
            0: Battery(
                received_s=t, remaining=1.0 - bad, voltage_v=16.0, current_a=15.0, charge_state=1
            )
        },
    ),
    "voltage": lambda t, bad: (
        "batteries",
        {
            0: Battery(
                received_s=t,
                remaining=0.95,
                voltage_v=16.5 - 4.0 * bad,
                current_a=15.0,
                charge_state=1,
            )
        },
    ),
    "odometry accuracy": lambda t, bad: (
        "odometry",
        Odometry(received_s=t, reset_counter=0, horizontal_accuracy_m=0.2 + 6.0 * bad),
    ),
    "packets lost": lambda t, bad: ("link", _lossy(LinkStatistics, t, bad)),
    "packets lost there": lambda t, bad: ("link_node", _lossy(LinkNode, t, bad)),
}


def _lossy(kind, now_s, bad):
    sent = 100.0 * now_s
    return kind(
        received_s=now_s, packets_received=sent * (1.0 - 0.4 * bad), packets_lost=sent * 0.4 * bad
    )


def indices_at(new_flight, badness):
    """Indices of a settled flight with the given badness of each input."""
    flight = new_flight.healthy(model=MODEL)
    changes = {}
    for name, bad in badness.items():
        if name in MEASURED:
            source, values = MEASURED[name](bad)
            changes.setdefault(source, {}).update(values)
        else:
            source, _ = OTHERS[name](0.0, bad)
            flight.sources[source] = lambda t, name=name, bad=bad: OTHERS[name](t, bad)[1]
    for source, values in changes.items():
        flight.handle(source, **values)
    return flight.fly(12.0, step_s=0.2).indices.as_dict()


badness = st.floats(0.0, 1.0)
names = st.sampled_from([*MEASURED, *OTHERS])


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    name=names, first=badness, second=badness, others=st.dictionaries(names, badness, max_size=3)
)
def test_a_worse_input_never_lowers_any_index_for_any_other_inputs(
    new_flight, name, first, second, others
):
    low, high = sorted((first, second))
    better = indices_at(new_flight, {**others, name: low})
    worse = indices_at(new_flight, {**others, name: high})
    for index in INDICES:
        assert worse[index] >= better[index] - 1e-9, index


@settings(max_examples=40, deadline=None)
@given(values=st.dictionaries(names, badness, min_size=1, max_size=6), seed=st.integers(0, 9))
def test_a_little_noise_moves_an_index_a_little(new_flight, values, seed):
    noise = 1e-3
    noisy = {
        name: min(1.0, max(0.0, bad + noise * math.sin(seed + 7.0 * number)))
        for number, (name, bad) in enumerate(values.items())
    }
    before, after = indices_at(new_flight, values), indices_at(new_flight, noisy)
    for index in INDICES:
        # Steepest input, the flight home: 0.001 of 9 km is 1.8 s of 240 s; wind from lean: 4 %.
        assert after[index] == pytest.approx(before[index], abs=0.05), index


@pytest.mark.parametrize("name", [*MEASURED, *OTHERS])
def test_each_input_raises_one_index_and_no_other(new_flight, name):
    good, bad = (indices_at(new_flight, {name: value}) for value in (0.0, 1.0))
    assert max(good.values()) < 0.15
    assert sorted(bad[index] - good[index] > 0.1 for index in INDICES) == [False] * 3 + [True]
    assert max(bad.values()) > 0.5
