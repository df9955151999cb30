"""A pilot by MAVSDK, which supports PX4 and does not depend on this project."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math

from mavsdk import ComponentType, Configuration, log_subscribe
from mavsdk.asyncio import Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync, MavlinkMessage
from mavsdk.asyncio.plugins.offboard import OffboardAsync, PositionNedYaw, VelocityNedYaw
from mavsdk.asyncio.plugins.telemetry import FlightMode, LandedState, TelemetryAsync

FOUND_WITHIN_S = 20.0


@contextlib.asynccontextmanager
async def vehicle(port):
    """The vehicle that a ground station of MAVSDK finds on a UDP port."""
    log_subscribe(lambda *_: True)
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    # As QGroundControl's; the operator beside the pilot has MAVSDK's default.
    configuration.system_id = 255
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}")
        system = await mavsdk.first_autopilot(timeout_s=FOUND_WITHIN_S)
        assert system is not None, f"MAVSDK finds no autopilot on {port}"
        yield system


@contextlib.asynccontextmanager
async def pilot(port):
    """A pilot whose ground station listens on a UDP port, with an aircraft found."""
    async with vehicle(port) as system:
        yield Pilot(system)


class Pilot:
    """The aircraft through MAVSDK's interface."""

    def __init__(self, system):
        self.action = ActionAsync(system)
        self.offboard = OffboardAsync(system)
        self.telemetry = TelemetryAsync(system)
        self.direct = MavlinkDirectAsync(system)

    async def until(self, what, stream, holds, timeout_s=30.0):
        """First item of a stream that meets a condition."""
        try:
            return await asyncio.wait_for(_first(stream, holds), timeout_s)
        except asyncio.TimeoutError:
            raise AssertionError(f"{what}: not within {timeout_s:g} s") from None

    async def give_offboard(self):
        """Change the mode only; another process sends the setpoints."""
        main_mode = {"param1": 1 | 128, "param2": 6}
        fields = {"target_system": 1, "target_component": 1, "command": 176, **main_mode}
        message = MavlinkMessage(message_name="COMMAND_LONG", fields_json=json.dumps(fields))
        answer = await self.direct.send_command(message)
        assert json.loads(answer.fields_json)["result"] == 0
        await self.wait_for_mode(FlightMode.OFFBOARD)

    async def take_off(self, height_m):
        """Fly from a cold start to a hover."""
        telemetry = self.telemetry
        await self.until("healthy", telemetry.subscribe_health_all_ok(), bool)
        await self.action.set_takeoff_altitude(height_m)
        await self.action.arm()
        await self.until("armed", telemetry.subscribe_armed(), bool)
        await self.action.takeoff()
        await self.until(
            f"{height_m:g} m up",
            telemetry.subscribe_position(),
            lambda place: place.relative_altitude_m > 0.9 * height_m,
        )
        await self.until(
            "in the air",
            telemetry.subscribe_landed_state(),
            lambda state: state == LandedState.IN_AIR,
        )

    async def wait_for_mode(self, mode):
        """Wait until the autopilot reports a flight mode."""
        await self.until(
            mode.name, self.telemetry.subscribe_flight_mode(), lambda received: received == mode
        )

    async def reference(self, place_ned_m, velocity_ned_mps=(0.0, 0.0, 0.0)):
        """The setpoint that MAVSDK streams."""
        await self.offboard.set_position_velocity_ned(
            PositionNedYaw(*place_ned_m, 0.0), VelocityNedYaw(*velocity_ned_mps, 0.0)
        )

    async def fly_to(self, end_ned_m, speed_mps=2.0):
        """Fly along a line with a reference a metre ahead, to rest at its end."""
        async with contextlib.aclosing(self.telemetry.subscribe_position_velocity_ned()) as stream:
            async for received in stream:
                here = ned(received.position, "_m")
                left_m = math.dist(here, end_ned_m)
                if left_m < 1.5:
                    break
                direction = [(to - at) / left_m for at, to in zip(here, end_ned_m, strict=True)]
                await self.reference(
                    [at + part for at, part in zip(here, direction, strict=True)],
                    [speed_mps * part for part in direction],
                )
        await self.rest_at(end_ned_m)

    async def rest_at(self, place_ned_m):
        """Send a place as setpoint and wait until the aircraft reports rest there."""
        await self.reference(place_ned_m)

        def there(received):
            place, velocity = ned(received.position, "_m"), ned(received.velocity, "_m_s")
            return math.dist(place, place_ned_m) < 0.5 and math.hypot(*velocity) < 0.3

        await self.until(
            f"at {place_ned_m}", self.telemetry.subscribe_position_velocity_ned(), there
        )

    async def land(self):
        """Land and wait until the aircraft is disarmed."""
        await self.action.land()
        await self.until("disarmed", self.telemetry.subscribe_armed(), lambda armed: not armed)


def ned(value, unit):
    """North, east, down of a MAVSDK value."""
    return [getattr(value, f"{axis}{unit}") for axis in ("north", "east", "down")]


async def _first(stream, holds):
    async with contextlib.aclosing(stream):
        async for item in stream:
            if holds(item):
                return item
    raise AssertionError("the stream has ended")
