"""The machine as a whole: deterministic, independent of step size, fast enough to be useful."""

import pytest

from sitl.autopilot import FakeAutopilot, LinkOptions, Options
from sitl.px4 import streams
from sitl.scenario import Scenario
from sitl.wire import layout

GUSTS = Scenario.parse({"name": "g", "changes": [{"at_s": 0, "wind_mps": 5, "gust_mps": 1}]}, "g")


def _fly(make_flight, **options):
    flight = make_flight(scenario=GUSTS, **options)
    flight.take_off()
    flight.run(5.0)
    return flight


def test_the_same_seed_and_input_give_the_same_bytes(make_flight):
    first, second = _fly(make_flight), _fly(make_flight)
    assert first.truth == second.truth
    assert first.companion.raw_bytes == second.companion.raw_bytes
    messages = [(t, m.get_msgbuf()) for t, m in first.companion.received]
    assert messages == [(t, m.get_msgbuf()) for t, m in second.companion.received]


def test_another_seed_gives_another_flight(make_flight):
    assert _fly(make_flight).truth != _fly(make_flight, seed=2).truth


def test_step_size_and_link_set_do_not_change_the_physics():
    fine, coarse = FakeAutopilot(), FakeAutopilot(Options(links=(LinkOptions(name="only"),)))
    for vehicle in (fine, coarse):
        vehicle.conditions.wind_mps = 3.0
    for i in range(1, 501):
        fine.step(i * 0.01)
    coarse.step(5.0)
    assert fine.truth == coarse.truth


def test_time_that_does_not_advance_has_no_effect():
    vehicle = FakeAutopilot()
    vehicle.step(2.0)
    vehicle.data_to_send()
    vehicle.step(1.0)
    vehicle.step(2.005)
    assert vehicle.data_to_send() == []
    assert vehicle.time_s == 2.0


@pytest.mark.slow
def test_a_link_without_a_reader_does_not_grow_without_limit():
    vehicle = FakeAutopilot(Options(links=(LinkOptions(name="only"),)))
    vehicle.step(300.0)
    ((_, data),) = vehicle.data_to_send()
    assert len(data) <= 4_000_000


def test_every_streamed_message_has_a_layout_of_its_own():
    for name in streams.KNOWN - {"ESC_STATUS", "RAW_RPM"}:
        assert layout(name).name == name
