"""Settings of all tests: repeatable Hypothesis examples, branch coverage, tests in real time.

Counting branches makes Python code 2.7 times slower. Only tests of the packages without I/O count
them: not their long flights, and in most folders only the first case of a test. Of a test marked
`uncounted` a run that counted each test by itself has shown that others reach all its branches.
"""

from __future__ import annotations

import gc
import importlib
import pkgutil
import sys

import pytest
from hypothesis import settings

import moar_companion
from tests.real_time import inconclusive, witness  # noqa: F401 - a fixture of all tests

settings.register_profile(
    "repeatable", max_examples=50, derandomize=True, database=None, deadline=None
)
settings.register_profile("quick", settings.get_profile("repeatable"), max_examples=10)
settings.load_profile("repeatable")

_EVERY_CASE = {
    "component",
    "inspection",
    "mavlink",
    "mqtt",
    "planner/test_site.py",
    "planning",
    "preflight",
    "recording",
    "replay",
    "survey",
}
_FIRST_CASES = {
    "autopilots",
    "companion",
    "contingency",
    "estimation",
    "guidance",
    "mission",
    "perception",
    "planner",
    "power",
    "risk",
    "safety",
}
"""Folders of the packages without I/O."""
_UNCOUNTED = {
    "companion/test_any_input.py",
    "companion/test_ardupilot.py",
    "companion/test_command_bytes.py",
    "companion/test_command_repeats.py",
    "companion/test_conditions.py",
    "companion/test_last_setpoint.py",
    "companion/test_leading_out.py",
    "companion/test_operator_commands_crossing.py",
    "companion/test_position.py",
    "companion/test_supervision.py",
    "companion/test_unmonitored.py",
    "estimation/test_frame_agreement.py",
    "guidance/test_keep_out.py",
    "guidance/test_path_follower.py",
    "guidance/test_tracking.py",
    "guidance/test_trajectory.py",
    "mavlink/test_translate.py",
    "mission/test_state_machine_properties.py",
    "perception/test_catenary.py",
    "perception/test_conductors.py",
    "perception/test_occupancy.py",
    "perception/test_ouster.py",
    "perception/test_scan_conductors.py",
    "perception/test_velodyne.py",
    "planner/test_cost_to_go_tables.py",
    "planner/test_free_distance.py",
    "planner/test_optimality.py",
    "planner/test_properties.py",
    "planner/test_regions.py",
    "preflight/test_loss_findings.py",
    "risk/test_battery.py",
    "risk/test_communication.py",
    "risk/test_indices.py",
    "risk/test_localization.py",
    "risk/test_properties.py",
    "risk/test_wind_recordings.py",
    "safety/test_obstacle_inflation.py",
    "safety/test_offboard_loss.py",
}
"""Other tests pass through the same branches, nearly all."""
_COUNTED_TOO = {
    "cases/test_batteries_and_receivers.py",
    "cases/test_lost_packets.py",
    "cases/test_parameter_names.py",
    "cases/test_plan.py",
    "cases/test_radios.py",
    "cases/test_recordings.py",
    "cases/test_senders.py",
    "cases/test_takeoff.py",
    "scenarios/test_ardupilot.py",
    "scenarios/test_blown_off.py",
    "scenarios/test_continued.py",
    "scenarios/test_margin.py",
    "scenarios/test_shut_down.py",
}
"""Their first cases reach branches that no test of a package reaches."""
_SLOW_TOO = {
    "commands/test_plan_tour.py",
    "commands/test_site_new.py",
    "companion/test_by_the_line.py",
    "companion/test_visits.py",
    "contingency/test_contingency_planner.py",
    "flights/test_inspection.py",
    "perception/test_line_offset.py",
    "planner/test_whole_front.py",
    "recordings/test_recordings.py",
    "replay/test_exact.py",
    "scenarios/test_parameters_in_flight.py",
}
"""So do the first cases of their slow tests."""
_counted = set()


def _import_counted_modules():
    """A module's own lines run once, which may be within a test that is not counted."""
    counted = _EVERY_CASE | _FIRST_CASES
    for module in pkgutil.walk_packages(moar_companion.__path__, "moar_companion."):
        packages = module.name.split(".")[1:-1]
        if counted.intersection(packages) and not module.name.endswith("__main__"):
            importlib.import_module(module.name)


def _is_counted(item):
    folder, name = item.path.parts[-2:]
    file = f"{folder}/{name}"
    is_slow = item.get_closest_marker("slow") and file not in _SLOW_TOO
    if file in _UNCOUNTED or is_slow or item.get_closest_marker("uncounted"):
        return False
    first = item.function not in _counted
    _counted.add(item.function)
    others = _COUNTED_TOO | _SLOW_TOO
    return bool({folder, file} & _EVERY_CASE) or (
        first and (folder in _FIRST_CASES or file in others)
    )


def pytest_collection_finish(session):
    """Modules and tests stay until the end: the collector need not look at them again and again."""
    if sys.gettrace() is not None:
        _import_counted_modules()
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Every case is run; of those that are not counted no line is traced."""
    if _is_counted(item):
        return (yield)
    tracer = sys.gettrace()
    sys.settrace(None)
    try:
        return (yield)
    finally:
        sys.settrace(tracer)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    """A test in real time that the machine never gave a chance is skipped, with the reason."""
    report = yield
    if report.failed and (reason := inconclusive(item)):
        report.outcome = "skipped"
        report.longrepr = (str(item.path), item.location[1], f"Skipped: {reason}")
    return report


def pytest_unconfigure():
    """Frozen objects would outlive the interpreter, and a decoder's library would report leaks."""
    gc.unfreeze()
    gc.collect()
