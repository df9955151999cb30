"""Settings that change in flight: from a parameter that was set to the settings in force.

Inputs: parameters that the session has taken, answers of the planner. What needs no other maps
counts at once. For the rest maps are made, and the flight goes on with the settings in force; where
these maps bar its path near by it brakes first. Where they leave no room at its place, or cannot be
made, the values are set back. Nothing is planned meanwhile: the planner has the new maps already.
"""

from __future__ import annotations

from dataclasses import replace

from ..mavlink.component.parameter_server import ParameterSet
from ..mavlink.session import Severity
from ..planner.site import Margin
from ..settings.flight_parameters import FlightParameters
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from .cycle_state import CycleState
from .error_margin import margin_of
from .flight_settings import at_once, need_maps, settings_of
from .guidance.flight_volume import FlightVolume
from .seen_obstacles import NewMaps


def take_parameter(state: CycleState, event: ParameterSet, now_s: float) -> None:
    """Takes a parameter that was set; requests maps where it needs others."""
    settings = state.parameters
    settings.wanted = state.session.parameters
    state.reports.record(
        "parameter",
        now_s,
        name=event.name,
        value=event.value,
        before=event.before,
        sender=event.sender.system_id,
    )
    settle(state)
    if settings.wanted is not settings.in_force:
        alone = settings.alone(event.name, event.value)
        if alone is not None:
            _put_without_maps(state, alone)


def settle(state: CycleState) -> None:
    """Puts all that was set into force where it needs no other maps; else requests these."""
    settings = state.parameters
    if settings.restores or settings.wanted is settings.in_force or settings.wanted is None:
        return
    if _put_without_maps(state, settings.wanted):
        state.seen_obstacles.want(None, state.margin)
        return
    config, vehicle = settings_of(settings.wanted, state.config)
    state.seen_obstacles.want(vehicle, margin_of(vehicle, config.supervision))


def _put_without_maps(state: CycleState, parameters: FlightParameters) -> bool:
    """Puts parameters into force, if they need no other maps; without a site nothing does."""
    config, vehicle = settings_of(parameters, state.config)
    margin = margin_of(vehicle, config.supervision)
    other = margin != state.margin or need_maps(vehicle, state.vehicle)
    if other and (state.site is not None or state.config.site is not None):
        return False
    state.parameters.put(parameters)
    state.take_settings(config, vehicle, margin)
    state.paths_changed = True
    return True


def note_request(state: CycleState, now_s: float) -> None:
    """Notes a request of maps for settings; until these are taken or refused no plan is made."""
    asked = state.seen_obstacles.settings_asked
    if asked:
        state.parameters.ask()
    state.routes.note_planner(now_s, busy=asked or state.parameters.restores)


def take_maps(state: CycleState, now_s: float) -> None:
    """Takes an answer with maps, for other settings or obstacles, unless a brake comes first."""
    settings, for_settings = state.parameters, state.seen_obstacles.for_settings
    if for_settings is not None:
        waiting = settings.waiting()
        if settings.asked is not None and not waiting:
            _refuse(state)
            return
        if _stops_first(state, for_settings):
            return
        if settings.asked is not None and not _leaves_room(state, for_settings):
            state.faults.note_settings_refused(waiting)
            _refuse(state)
            return
    maps = state.seen_obstacles.taken(now_s)
    if maps is None:
        return
    if maps.vehicle is None:
        _learn(state, maps, now_s)
    elif maps.site_maps is not None:
        _put(state, maps.vehicle, maps.site_maps.site.margin, now_s)
        _learn(state, maps, now_s)
        settle(state)
    elif settings.restores:
        state.seen_obstacles.want(state.vehicle, state.margin)
    else:
        waiting = settings.waiting()
        if waiting:
            text = pilot_texts.NO_NEW_MAPS(parameter=waiting)
            state.reports.send_text(Severity.WARNING, text, now_s, action="set back")
        _set_back(state)
        settle(state)


def _stops_first(state: CycleState, maps: NewMaps) -> bool:
    """True while the flight brakes before maps for other settings, which bar its place, count."""
    flight, volume = state.routes.flight, _volume_on(state, maps)
    if flight is None or volume is None or flight.stopped:
        return False
    if not flight.braked and not flight.is_barred_on(volume):
        return False
    flight.brake()
    return True


def _leaves_room(state: CycleState, maps: NewMaps) -> bool:
    """True if the flight's place is permitted on maps for other settings."""
    flight, volume = state.routes.flight, _volume_on(state, maps)
    if flight is None or volume is None:
        return True
    return flight.has_room_on(volume, state.config.supervision.plane_tolerance_m)


def _volume_on(state: CycleState, maps: NewMaps) -> FlightVolume | None:
    """The flight volume on maps for other settings; None while unknown."""
    volume, site_maps, vehicle = state.routes.limits.volume, maps.site_maps, maps.vehicle
    if volume is None or site_maps is None or vehicle is None:
        return None
    return replace(volume, site=site_maps.site, maps=site_maps.maps, vehicle=vehicle)


def _refuse(state: CycleState) -> None:
    """Drops maps with which the flight has no room, or for values that were set back meanwhile.

    The planner makes maps for the settings in force again.
    """
    _set_back(state)
    state.parameters.restores = True
    state.seen_obstacles.refuse(state.vehicle, state.margin)


def _set_back(state: CycleState) -> None:
    """Sets the values back for which there are no maps; ground stations receive those in force."""
    settings, server = state.parameters, state.session.services.parameters
    if settings.asked is not None and settings.in_force is not None and server is not None:
        server.set_back(settings.asked, settings.in_force)
        settings.wanted = server.parameters
    settings.asked = None


def _put(state: CycleState, vehicle: Vehicle, margin: Margin, now_s: float) -> None:
    """Puts the settings of new maps into force."""
    settings = state.parameters
    changes = settings.asked is not None
    settings.put_asked()
    config, wanted = state.config, state.vehicle
    if settings.in_force is not None:
        config, wanted = settings_of(settings.in_force, state.config)
        if changes:
            state.reports.record("settings", now_s, changed=dict(settings.in_force.changed))
    state.take_settings(config, at_once(wanted, vehicle), margin)


def _learn(state: CycleState, maps: NewMaps, now_s: float) -> None:
    """Takes the maps of an answer; their settings are in force."""
    if maps.site_maps is not None:
        state.routes.learn_maps(maps.site_maps, now_s, for_settings=maps.vehicle is not None)
        state.paths_changed = True
