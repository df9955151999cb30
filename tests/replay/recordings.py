"""Content of each recording beside the checkout, by its file of events and pymavlink.

Keyed by folder and file; times in seconds since the first packet.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """modes: the first four. armed_s: when it was armed, disarmed, armed ..., the first eight."""

    autopilot: str = "ardupilot"
    vehicle_type: str | None = "quadrotor"
    modes: tuple[str, ...] = ()
    armed_s: tuple[float, ...] = ()
    unknown: frozenset[str] = frozenset()
    """The indices that are never known."""


_BLIND = frozenset({"wind", "localization", "battery"})
"""ArduPilot tells a ground station that asks for no streams nothing but its heartbeat."""
_NO_WIND = frozenset({"wind"})
"""Never armed, or for a moment: it never leaned against a wind."""

RECORDED = {
    "ardupilot/a1_boot.companion.tlog": Recorded(modes=("STABILIZE", "GUIDED"), armed_s=(43.2,)),
    "ardupilot/a1_boot.gcs.tlog": Recorded(
        modes=("STABILIZE", "GUIDED"), armed_s=(44.0,), unknown=_BLIND
    ),
    "ardupilot/a2_square.companion.tlog": Recorded(modes=("GUIDED",), armed_s=(0.4,)),
    "ardupilot/a2_square.gcs.tlog": Recorded(modes=("GUIDED",), armed_s=(0.0,), unknown=_BLIND),
    "ardupilot/a3_land.companion.tlog": Recorded(modes=("LAND",), armed_s=(0.0, 22.6)),
    "ardupilot/a3_land.gcs.tlog": Recorded(modes=("LAND",), armed_s=(0.0, 23.4), unknown=_BLIND),
    "ardupilot/b2_nobatt.companion.tlog": Recorded(
        modes=("STABILIZE",), unknown=frozenset({"wind", "battery"})
    ),
    "ardupilot/b2_nobatt.gcs.tlog": Recorded(modes=("STABILIZE",), unknown=_BLIND),
    "ardupilot/b_batt.companion.tlog": Recorded(
        modes=("GUIDED", "RTL", "GUIDED", "LAND"), armed_s=(0.1, 86.1)
    ),
    "ardupilot/b_batt.gcs.tlog": Recorded(
        modes=("GUIDED", "RTL", "GUIDED", "LAND"), armed_s=(0.1, 86.1)
    ),
    "ardupilot/c1_wind.companion.tlog": Recorded(modes=("GUIDED",), armed_s=(0.3,)),
    "ardupilot/c1_wind.gcs.tlog": Recorded(modes=("GUIDED",), armed_s=(0.0,), unknown=_BLIND),
    "ardupilot/c2_wind_drag.companion.tlog": Recorded(modes=("GUIDED",), armed_s=(0.3,)),
    "ardupilot/c2_wind_drag.gcs.tlog": Recorded(modes=("GUIDED",), armed_s=(0.0,), unknown=_BLIND),
    "ardupilot/c3_wind_const.companion.tlog": Recorded(modes=("GUIDED",), armed_s=(0.3,)),
    "ardupilot/c3_wind_const.gcs.tlog": Recorded(modes=("GUIDED",), armed_s=(0.0,), unknown=_BLIND),
    "ardupilot/d1_gps_sats.companion.tlog": Recorded(modes=("GUIDED", "LAND"), armed_s=(0.4,)),
    "ardupilot/d1_gps_sats.gcs.tlog": Recorded(
        modes=("GUIDED", "LAND"), armed_s=(0.4,), unknown=_BLIND
    ),
    "ardupilot/d2_gps_loss.companion.tlog": Recorded(
        modes=("GUIDED", "LAND", "GUIDED", "LOITER"), armed_s=(0.4, 35.4)
    ),
    "ardupilot/d2_gps_loss.gcs.tlog": Recorded(
        modes=("GUIDED", "LAND", "GUIDED", "LOITER"), armed_s=(0.4, 35.4), unknown=_BLIND
    ),
    "ardupilot/d4_gps_input.companion.tlog": Recorded(modes=("STABILIZE",), unknown=_NO_WIND),
    "ardupilot/d4_gps_input.gcs.tlog": Recorded(modes=("STABILIZE",), unknown=_BLIND),
    "ardupilot/d5_hdop_flight.companion.tlog": Recorded(
        modes=("GUIDED", "LAND", "GUIDED", "LAND"), armed_s=(0.5,)
    ),
    "ardupilot/d5_hdop_flight.gcs.tlog": Recorded(
        modes=("GUIDED", "LAND", "GUIDED", "LAND"), armed_s=(0.5,), unknown=_BLIND
    ),
    "ardupilot/e1_override.companion.tlog": Recorded(
        modes=("GUIDED", "LOITER", "GUIDED", "LOITER"), armed_s=(0.4,)
    ),
    "ardupilot/e1_override.gcs.tlog": Recorded(
        modes=("GUIDED", "LOITER", "GUIDED", "LOITER"), armed_s=(0.0,), unknown=_BLIND
    ),
    "ardupilot/f1_rssi.companion.tlog": Recorded(modes=("STABILIZE",), unknown=_NO_WIND),
    "ardupilot/f1_rssi.gcs.tlog": Recorded(modes=("STABILIZE",), unknown=_BLIND),
    "ardupilot/g1_routing.companion.tlog": Recorded(
        modes=("STABILIZE", "GUIDED"), unknown=_NO_WIND
    ),
    "ardupilot/g1_routing.gcs.tlog": Recorded(modes=("STABILIZE", "GUIDED"), unknown=_BLIND),
    "ardupilot/h1_signing.companion.tlog": Recorded(
        modes=("STABILIZE", "GUIDED", "LAND", "STABILIZE"), armed_s=(36.1, 75.1)
    ),
    "ardupilot/h1_signing.gcs.tlog": Recorded(
        modes=("STABILIZE", "GUIDED", "LAND", "STABILIZE"), armed_s=(36.0, 75.1), unknown=_BLIND
    ),
    "ardupilot/h2_signing.companion.tlog": Recorded(
        modes=("STABILIZE", "GUIDED", "LAND", "STABILIZE"), armed_s=(23.1, 62.1)
    ),
    "ardupilot/h2_signing.gcs.tlog": Recorded(
        modes=("STABILIZE", "GUIDED", "LAND", "STABILIZE"), armed_s=(23.0, 62.0), unknown=_BLIND
    ),
    "ardupilot/j1_failsafe.companion.tlog": Recorded(
        modes=("GUIDED", "LAND", "GUIDED", "RTL"), armed_s=(0.4,)
    ),
    "ardupilot/j1_failsafe.gcs.tlog": Recorded(
        modes=("GUIDED", "LAND", "GUIDED", "RTL"), armed_s=(0.0,), unknown=_BLIND
    ),
    "ardupilot/k1a_takeoff_rates.companion.tlog": Recorded(
        modes=("GUIDED",), armed_s=(0.0, 10.1, 12.1, 22.1, 23.1)
    ),
    "ardupilot/k1a_takeoff_rates.gcs.tlog": Recorded(
        modes=("GUIDED",), armed_s=(0.0, 10.1, 12.1, 22.1, 23.1), unknown=_BLIND
    ),
    "ardupilot/k2_reboot.companion.tlog": Recorded(modes=("STABILIZE",), unknown=_NO_WIND),
    "ardupilot/k2_reboot.gcs.tlog": Recorded(modes=("STABILIZE",), unknown=_BLIND),
    "ardupilot/m1_masks.companion.tlog": Recorded(modes=("GUIDED",), armed_s=(0.3,)),
    "ardupilot/m1_masks.gcs.tlog": Recorded(modes=("GUIDED",), armed_s=(0.0,), unknown=_BLIND),
    "ardupilot/m2_masks.companion.tlog": Recorded(modes=("GUIDED",), armed_s=(0.4,)),
    "ardupilot/m2_masks.gcs.tlog": Recorded(modes=("GUIDED",), armed_s=(0.0,), unknown=_BLIND),
    "ardupilot/r_battery_inner.service.tlog.gz": Recorded(
        modes=("STABILIZE", "GUIDED", "LAND"), armed_s=(38.0, 124.0)
    ),
    "ardupilot/r_gcsfs.service.tlog.gz": Recorded(
        modes=("STABILIZE", "GUIDED", "LAND"), armed_s=(27.9, 75.0)
    ),
    "ardupilot/r_rcfail.service.tlog.gz": Recorded(
        modes=("STABILIZE", "GUIDED", "BRAKE", "GUIDED"), armed_s=(15.9, 72.9)
    ),
    "ardupilot/r_windback.service.tlog.gz": Recorded(
        modes=("STABILIZE", "GUIDED", "LAND"), armed_s=(33.8, 109.8)
    ),
    "px4/a1_boot_offboard_takeoff.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "HOLD", "OFFBOARD"), armed_s=(11.5, 14.6, 18.6)
    ),
    "px4/a1_boot_offboard_takeoff.gcs.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "HOLD", "OFFBOARD"), armed_s=(11.4, 14.5, 18.5)
    ),
    "px4/b1_battery_drain.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "HOLD", "LAND"), armed_s=(8.6,)
    ),
    "px4/c1_wind_v118.companion.tlog": Recorded(
        autopilot="px4", modes=("OFFBOARD",), armed_s=(0.4,)
    ),
    "px4/d1_gps_degradation.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "ALTCTL", "OFFBOARD"), armed_s=(8.4,)
    ),
    "px4/d3_gps_silent_v117.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "ALTCTL", "OFFBOARD"), armed_s=(10.4,)
    ),
    "px4/e1_pilot_override.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "HOLD", "OFFBOARD"), armed_s=(7.6,)
    ),
    "px4/e1_pilot_override.gcs.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "HOLD", "OFFBOARD"), armed_s=(7.5,)
    ),
    "px4/f1_radio_rc.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "POSCTL"), unknown=_NO_WIND
    ),
    "px4/f1_radio_rc.gcs.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "POSCTL"), unknown=_NO_WIND
    ),
    "px4/g1_routing.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "POSCTL"), unknown=_NO_WIND
    ),
    "px4/g1_routing.gcs.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "POSCTL"), unknown=_NO_WIND
    ),
    "px4/h0_boot_rates.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD",), unknown=_NO_WIND
    ),
    "px4/h1_msg_intervals.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD",), armed_s=(138.4, 139.4, 144.5, 146.5), unknown=_NO_WIND
    ),
    "px4/i1_mavsdk_offboard.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "HOLD", "LAND"), armed_s=(16.1,)
    ),
    "px4/k1_nogcs_autopilot_restart.companion.tlog": Recorded(
        autopilot="px4", modes=("HOLD", "OFFBOARD", "HOLD"), armed_s=(7.3, 20.2)
    ),
    "px4/r_battery.service.tlog.gz": Recorded(
        autopilot="px4", modes=("HOLD", "TAKEOFF", "HOLD", "OFFBOARD"), armed_s=(5.0, 154.4)
    ),
    "px4/r_fence.service.tlog.gz": Recorded(
        autopilot="px4", modes=("HOLD", "TAKEOFF", "HOLD", "OFFBOARD"), armed_s=(4.4,)
    ),
    "px4/r_nominal.service.tlog.gz": Recorded(
        autopilot="px4", modes=("HOLD", "TAKEOFF", "HOLD", "OFFBOARD"), armed_s=(4.5, 104.8)
    ),
    "mavlink_tlog/ardusub_small.tlog": Recorded(
        vehicle_type="submarine",
        modes=("MANUAL",),
        armed_s=(206.7, 222.7),
        unknown=frozenset({"wind", "battery"}),
    ),
    "mavlink_tlog/codelever_2013-10-13_16-58-51.tlog": Recorded(
        modes=("STABILIZE", "LOITER", "AUTO", "LOITER"),
        armed_s=(137.9, 472.3),
        unknown=frozenset({"battery"}),
    ),
    "mavlink_tlog/codelever_2013-10-13_18-31-24.tlog": Recorded(
        modes=("STABILIZE", "LOITER", "STABILIZE"),
        armed_s=(0.0, 362.3),
        unknown=frozenset({"battery"}),
    ),
    "mavlink_tlog/dronekit_flight_replay.tlog": Recorded(
        modes=("STABILIZE", "LOITER", "AUTO", "LOITER"),
        armed_s=(462.0, 574.7, 591.8, 734.7, 771.1, 776.4, 780.4, 785.2),
    ),
    "mavlink_tlog/pymavlink_capture.mav2.battery_status.tlog": Recorded(
        autopilot="unknown",
        vehicle_type=None,
        unknown=frozenset({"localization", "wind", "battery", "communication"}),
    ),
    "mavlink_tlog/pymavlink_swift_flight.tlog.gz": Recorded(
        modes=("AUTO", "RTL", "STABILIZE", "LOITER"),
        armed_s=(364.6, 487.5, 527.3, 563.8, 604.6, 655.3, 990.2, 1012.3),
    ),
}
