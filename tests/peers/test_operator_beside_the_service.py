"""Three processes connected by MAVLink only: fake PX4, service, `moar-companion command`.

The pilot, who arms, takes off, gives the mode and lands, is MAVSDK in this process.
"""

from __future__ import annotations

import asyncio
import contextlib
import math

import pytest
from mavsdk.asyncio.plugins.telemetry import FlightMode
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.planner.site import Site
from tests.real_time import real_time

from .pilot import pilot
from .processes import SITE, companion_beside_autopilot, ordered, truth_of


def said(done):
    """Output of a command; its stderr must be empty."""
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.mark.slow
def test_on_the_ground_the_companion_is_received_and_orders_are_refused_with_the_reason(tmp_path):
    with companion_beside_autopilot(tmp_path) as (port, _):
        status = ordered(port, "status", "--timeout", "20")
        refused = ordered(port, "inspection")
        unknown = ordered(port, "inspection", "--target", "9")
        nothing_held = ordered(port, "continue")
    assert status.returncode == 0
    lines = said(status)
    assert lines[0] == "companion  system 1, component 195: idle, streams nothing"
    assert lines[1] == "autopilot  px4, disarmed, HOLD"
    assert "not received" not in "".join(lines)
    assert refused.returncode == 1
    assert said(refused)[0] == "inspection: TEMPORARILY_REJECTED"
    assert said(refused)[1].endswith(", rejected")
    assert unknown.returncode == 1
    assert said(unknown) == ["inspection: DENIED", "MOAR: no target 9 of 2, denied"]
    assert nothing_held.returncode == 1
    assert said(nothing_held)[-1] == "MOAR: nothing is held, rejected"


@real_time
def test_an_inspection_is_ordered_flown_paused_drawn_continued_held_left_and_released(
    tmp_path,
):
    with companion_beside_autopilot(tmp_path) as (pilot_port, operator_port):
        asyncio.run(operated(pilot_port, operator_port, tmp_path))
    end = truth_of(tmp_path)[-1]
    assert (end["armed"], end["on_ground"]) == (0.0, 1.0)


async def operated(pilot_port, operator_port, folder):
    async def order(*arguments):
        done = await asyncio.to_thread(ordered, operator_port, *arguments)
        assert done.returncode == 0, done
        return said(done)

    async with pilot(pilot_port) as mavsdk:
        await mavsdk.take_off(3.0)
        await mavsdk.wait_for_mode(FlightMode.HOLD)
        lines = await order("inspection", "--target", "splice-outer", "--site", SITE)
        assert lines[-2:] == ["MOAR: ready for inspection", "inspection: ACCEPTED"]
        assert "streams setpoints" in (await order("status"))[0]
        await mavsdk.give_offboard()
        await moving(mavsdk)
        assert (await order("pause"))[-1] == "pause: ACCEPTED"
        lines = await order("status")
        assert lines[1] == "autopilot  px4, armed, OFFBOARD"
        assert speed_mps(folder) < 0.5
        items = await asyncio.to_thread(downloaded_mission, operator_port)
        assert_leads_to(items, "splice-outer")
        assert (await order("continue"))[-1] == "continue: ACCEPTED"
        await moving(mavsdk)
        assert (await order("hold"))[-1] == "hold: ACCEPTED"
        assert (await order("exit", "--target", "0"))[-1] == "exit: ACCEPTED"
        await moving(mavsdk)
        assert (await order("release"))[-1] == "release: ACCEPTED"
        await mavsdk.until(
            "the autopilot on its own",
            mavsdk.telemetry.subscribe_flight_mode(),
            lambda mode: mode != FlightMode.OFFBOARD,
        )
        assert "streams nothing" in (await order("status"))[0]
        await mavsdk.land()


def downloaded_mission(port):
    """Items of the companion's mission, by pymavlink's client."""
    with contextlib.closing(
        mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=254)
    ) as link:
        assert link.wait_heartbeat(timeout=20) is not None
        link.target_system, link.target_component = 1, 195

        def answered(kind, ask, *fields):
            for _ in range(5):
                ask(*fields)
                answer = link.recv_match(type=kind, blocking=True, timeout=2)
                if answer is not None and answer.get_srcComponent() == 195:
                    return answer
            raise AssertionError(f"no {kind}")

        count = answered("MISSION_COUNT", link.waypoint_request_list_send).count
        ask = link.mav.mission_request_int_send
        items = [answered("MISSION_ITEM_INT", ask, 1, 195, number) for number in range(count)]
        link.mav.mission_ack_send(1, 195, mavlink.MAV_MISSION_ACCEPTED)
        return items


def assert_leads_to(items, target):
    """The last item is at the target, within a cell of the plan; none is twice."""
    site = Site.load(SITE)
    (x_m, z_m) = next(each.position_m for each in site.targets if each.name == target)
    assert [item.seq for item in items] == list(range(len(items)))
    end = items[-1]
    at_m = site.frame.place_of(end.x * 1e-7, end.y * 1e-7)
    assert math.dist(at_m, (x_m, 0.0)) < site.workspace.resolution_m
    assert abs(end.z - site.frame.origin.altitude_amsl_m - z_m) < site.workspace.resolution_m


async def moving(mavsdk):
    await mavsdk.until(
        "moving",
        mavsdk.telemetry.subscribe_velocity_ned(),
        lambda speed: math.hypot(speed.north_m_s, speed.east_m_s, speed.down_m_s) > 0.5,
    )


def speed_mps(folder):
    row = truth_of(folder)[-1]
    return math.hypot(row["vn_mps"], row["ve_mps"], row["vd_mps"])
