"""MAVSDK flies the fake autopilot like a real PX4; judged by the truth log."""

from __future__ import annotations

import asyncio
import math
from itertools import pairwise

import pytest
from mavsdk.asyncio.plugins.telemetry import FlightMode

from .pilot import pilot
from .processes import autopilot, free_ports, truth_of

HEIGHT_M = 5.0
LEGS_NED_M = [(8.0, 0.0, -5.0), (8.0, 6.0, -7.0), (0.0, 0.0, -5.0)]
SPEED_MPS = 2.0


async def flown(port):
    async with pilot(port) as mavsdk:
        await mavsdk.take_off(HEIGHT_M)
        await mavsdk.reference((0.0, 0.0, -HEIGHT_M))
        await mavsdk.offboard.start()
        await mavsdk.wait_for_mode(FlightMode.OFFBOARD)
        await mavsdk.fly_to(LEGS_NED_M[0], SPEED_MPS)
        await mavsdk.action.hold()
        await mavsdk.wait_for_mode(FlightMode.HOLD)
        await mavsdk.reference(LEGS_NED_M[0])
        await mavsdk.offboard.start()
        await mavsdk.wait_for_mode(FlightMode.OFFBOARD)
        for end_ned_m in LEGS_NED_M[1:]:
            await mavsdk.fly_to(end_ned_m, SPEED_MPS)
        await mavsdk.land()


@pytest.mark.slow
def test_arm_take_off_offboard_hold_offboard_again_land(tmp_path):
    (port,) = free_ports(1)
    link = f"gcs=udpout:127.0.0.1:{port}"
    # MAVSDK's 20 setpoints per real second are few in time that runs so fast.
    hurried = ("--speed", "6", "--param", "COM_OF_LOSS_T=10")
    with autopilot(tmp_path, "--link", link, *hurried):
        asyncio.run(flown(port))
    truth = truth_of(tmp_path)
    modes = [truth[0]["mode"], *(b["mode"] for a, b in pairwise(truth) if a["mode"] != b["mode"])]
    assert modes[:7] == [
        "AUTO.LOITER",
        "AUTO.TAKEOFF",
        "AUTO.LOITER",
        "OFFBOARD",
        "AUTO.LOITER",
        "OFFBOARD",
        "AUTO.LAND",
    ]
    offboard = [row for row in truth if row["mode"] == "OFFBOARD"]
    passed = iter(offboard)
    for end_ned_m in LEGS_NED_M:
        assert any(distance_m(row, end_ned_m) < 1.0 for row in passed), end_ned_m
    speed_mps = max(math.hypot(row["vn_mps"], row["ve_mps"], row["vd_mps"]) for row in offboard)
    assert SPEED_MPS < speed_mps < 2.5 * SPEED_MPS  # velocity feed-forward, one metre ahead
    end = truth[-1]
    assert (end["armed"], end["on_ground"]) == (0.0, 1.0)
    assert math.hypot(end["north_m"], end["east_m"]) < 1.0


def distance_m(row, place_ned_m):
    return math.dist((row["north_m"], row["east_m"], row["down_m"]), place_ned_m)
