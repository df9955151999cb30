"""An autopilot without a profile: never controlled, and every value the worst of the known ones.

No assumption lowers a risk: the slowest landing, the greatest errors, and no mode that follows
setpoints. The actions of failsafes and after an offboard loss are unknown.
"""

from __future__ import annotations

from ...types import UNKNOWN
from .parameter_names import ParameterTable
from .profile import Profile
from .px4 import to_local_ned

PROFILE = Profile(
    kind=UNKNOWN,
    name="an unknown autopilot",
    mav_autopilot=None,
    measured_releases=(),
    newest_release=(0, 0),
    oldest_release=(0, 0),
    mode_name=lambda _: None,
    mode_enums={},
    is_own_mode=lambda _: False,
    own_mode="its mode",
    own_mode_numbers=None,
    land_mode="LAND",
    land_mode_numbers=None,
    armed_in_mode_request=False,
    homeward_modes=frozenset(),
    follow_up_modes={},
    streams_by_itself=True,
    line_share=0.5,
    rates_hz={},
    integers_bytewise=False,
    rssi_max=254,  # the definition of RC_CHANNELS; 255 is unknown
    channels_without_receiver=False,
    summary_is_battery_0=False,
    better_gnss_taken=False,
    gnss_switch=None,
    gnss_switch_better=frozenset(),
    gnss_primary=None,
    motor_range=None,
    unused_pulse_us=900.0,
    failsafe_flies=True,
    failsafe_texts=(),
    innovation_limit=0.0,
    to_local_ned=to_local_ned,
    projection_known=False,
    home_by_projection=False,
    position_error_m=1.4,
    tracking_error_m=1.15,
    stray_s2=0.58,
    landing_mps=0.5,
    landed_hover_s=5.0,
    speed_parameters=(),
    cells_parameter=None,
    capacity_parameter=None,
    tilt_limits=(),
    hover_thrust=None,
    parameters=ParameterTable(),
    loss_parameters=(),
    read_loss=None,
    failsafe_parameters=(),
    read_failsafes=None,
    fence_parameters=(),
    read_fence=None,
    rules=(),
)
