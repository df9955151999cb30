"""A peer that sends packets by raw pymavlink."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.dialect import create


class Peer:
    """The other end of a link, with packets encoded by pymavlink, not by the product's codec."""

    def __init__(self, system_id: int, component_id: int) -> None:
        self._packer = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def pack(self, message: Any, *, mavlink1: bool = False) -> bytes:
        data = bytes(message.pack(self._packer, force_mavlink1=mavlink1))
        self._packer.seq = (self._packer.seq + 1) % 256
        return data

    def send(self, name: str, **fields: Any) -> bytes:
        return self.pack(create(name, **fields))

    def skip(self, packets: int) -> None:
        self._packer.seq = (self._packer.seq + packets) % 256

    def restart(self) -> None:
        self._packer.seq = 0

    def heartbeat(
        self,
        *,
        autopilot: int = mavlink.MAV_AUTOPILOT_PX4,
        vehicle: int = mavlink.MAV_TYPE_QUADROTOR,
        custom_mode: int = 0x03040000,
        base_mode: int = 29,
        system_status: int = mavlink.MAV_STATE_STANDBY,
    ) -> bytes:
        return self.send(
            "HEARTBEAT",
            type=vehicle,
            autopilot=autopilot,
            base_mode=base_mode,
            custom_mode=custom_mode,
            system_status=system_status,
            mavlink_version=3,
        )

    def ground_heartbeat(self) -> bytes:
        return self.heartbeat(autopilot=mavlink.MAV_AUTOPILOT_INVALID, vehicle=mavlink.MAV_TYPE_GCS)

    def attitude(self, boot_s: float, *, roll: float = 0.1) -> bytes:
        return self.send(
            "ATTITUDE",
            time_boot_ms=int(boot_s * 1000),
            roll=roll,
            pitch=0.2,
            yaw=0.3,
            rollspeed=0.0,
            pitchspeed=0.0,
            yawspeed=0.0,
        )

    def command(
        self,
        command: int,
        *parameters: float,
        target: tuple[int, int] = (1, 195),
        confirmation: int = 0,
    ) -> bytes:
        padded = [*parameters, *[0.0] * (7 - len(parameters))]
        return self.send(
            "COMMAND_LONG",
            target_system=target[0],
            target_component=target[1],
            command=command,
            confirmation=confirmation,
            **{f"param{number}": value for number, value in enumerate(padded, start=1)},
        )

    def command_int(
        self, command: int, *parameters: float, target: tuple[int, int] = (1, 195)
    ) -> bytes:
        padded = [*parameters, *[0.0] * (4 - len(parameters))]
        return self.send(
            "COMMAND_INT",
            target_system=target[0],
            target_component=target[1],
            frame=0,
            command=command,
            current=0,
            autocontinue=0,
            **{f"param{number}": value for number, value in enumerate(padded, start=1)},
            x=0,
            y=0,
            z=0.0,
        )

    def cancel(self, command: int, *, target: tuple[int, int] = (1, 195)) -> bytes:
        return self.send(
            "COMMAND_CANCEL",
            command=command,
            target_system=target[0],
            target_component=target[1],
        )

    def acknowledge(
        self, command: int, result: int, *, target: tuple[int, int] = (1, 195)
    ) -> bytes:
        return self.send(
            "COMMAND_ACK",
            command=command,
            result=result,
            progress=0,
            result_param2=0,
            target_system=target[0],
            target_component=target[1],
        )
