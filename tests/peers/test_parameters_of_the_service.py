"""Ground stations' own clients list and set the component's parameters, by sockets.

MAVSDK and pymavlink stand beside the fake PX4, which routes between them and the service.
"""

from __future__ import annotations

import asyncio
import contextlib
import time

import pytest
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.plugins.param import ParamError, ProtocolVersion
from pymavlink import mavparm, mavutil

from moar_companion.settings.flight_parameters import flight_parameters

from .pilot import FOUND_WITHIN_S, vehicle
from .processes import companion_beside_autopilot

COMPONENT = 195
NAMES = list(flight_parameters())
LIST_WITHIN_S = 20.0
INT32 = 6


@pytest.mark.slow
def test_pymavlink_and_mavsdk_list_and_set_what_a_restart_keeps(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    with companion_beside_autopilot(tmp_path) as (mavsdk_port, pymavlink_port):
        asyncio.run(set_by_mavsdk(mavsdk_port))
        set_by_pymavlink(pymavlink_port)
    with (
        companion_beside_autopilot(tmp_path) as (_, pymavlink_port),
        station(pymavlink_port) as link,
    ):
        values = listed(link)
        assert (values["LIM_BATTERY"], values["LIM_GCS_ACTION"]) == (pytest.approx(0.3), 0.0)
        assert values["SAFE_D_MAX"] == pytest.approx(3.0), "the command line names the vehicle"
    assert "set in flight: LIM_BATTERY 0.3" in (tmp_path / "companion.log").read_text()


@contextlib.contextmanager
def station(port):
    """pymavlink's ground station, which speaks to the component."""
    link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)
    with contextlib.closing(link):
        assert link.wait_heartbeat(timeout=FOUND_WITHIN_S) is not None
        link.target_system, link.target_component = 1, COMPONENT
        yield link


def listed(link):
    """All parameters as pymavlink lists them."""
    values, end_s = {}, time.monotonic() + LIST_WITHIN_S
    link.param_fetch_all()
    while len(values) < len(NAMES):
        assert time.monotonic() < end_s, f"{len(values)} of {len(NAMES)}"
        message = link.recv_match(type="PARAM_VALUE", blocking=True, timeout=1.0)
        if message is None:
            link.param_fetch_all()
        elif message.get_srcComponent() == COMPONENT:
            values[message.param_id] = message.param_value
    return values


def set_by_pymavlink(port):
    with station(port) as link:
        values = listed(link)
        assert list(values) == NAMES
        assert values["LIM_WIND"] == pytest.approx(11.5), "which MAVSDK has set"
        parameters = mavparm.MAVParmDict()
        assert parameters.mavset(link, "LIM_BATTERY", 0.3)
        assert parameters.mavset(link, "SAFE_D_MAX", 4.0)
        assert parameters.mavset(link, "LIM_GCS_ACTION", 0, parm_type=INT32)
        assert parameters.mavset(link, "SAFE_D_MIN", 9.0), "which is answered, and refused"
        values = listed(link)
        assert values["SAFE_D_MAX"] == pytest.approx(4.0)
        assert values["SAFE_D_MIN"] == pytest.approx(1.2)


async def set_by_mavsdk(port):
    async with vehicle(port) as system:
        parameters = ParamAsync(system)
        for protocol, wind in ((ProtocolVersion.V1, 12.5), (ProtocolVersion.EXT, 11.5)):
            with contextlib.suppress(ParamError):  # has no result, which MAVSDK reads as one
                await parameters.select_component(COMPONENT, protocol)
            await parameters.set_param_float("LIM_WIND", wind)
            assert await parameters.get_param_float("LIM_WIND") == wind
            await parameters.set_param_int("ADAPTATION", 1)
            assert await parameters.get_param_int("ADAPTATION") == 1
            with pytest.raises(ParamError):
                await parameters.set_param_float("SAFE_D_MAX", 0.1)
            found = await parameters.get_all_params()
            names = {item.name for item in (*found.float_params, *found.int_params)}
            assert names == set(NAMES)
