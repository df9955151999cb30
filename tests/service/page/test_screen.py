"""The page as a person uses it, in a real browser: each control, both sizes, both colours."""

from __future__ import annotations

import re
import time
from pathlib import Path

import pytest

from moar_companion.analysis.what_if import WhatIf
from moar_companion.commands.cli import main
from moar_companion.commands.playback import McapPlayback, ReplayPlayback
from moar_companion.commands.replay import played
from moar_companion.planner.maps import build_maps
from moar_companion.planner.site import Margin, Site
from moar_companion.planner.site_view import maps_view, site_view
from moar_companion.service.page.live_feed import LiveFeed
from moar_companion.service.page.page_channel import ServiceAnswer
from moar_companion.service.page.page_recordings import PageRecordings
from moar_companion.service.page.page_server import PageContent
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import Mission
from tests.flights.recorded import recorded_flight
from tests.service.page.browser import SIZES, chromium, opened
from tests.service.page.serving import TOKEN, served

pytestmark = [pytest.mark.real_time, pytest.mark.slow]

SITE_FILE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
MARGIN = Margin(position_m=1.0, tracking_m=0.5)
FLIGHT = "flight_20261128T120000.000000Z"
VIEWS = ("live", "what-if", "recordings", f"recordings={FLIGHT}", "map")


class Flight:
    """A recorded flight as a service shows it, and the orders that it has got."""

    def __init__(self):
        self.orders = []
        self.answer = ServiceAnswer(result="ACCEPTED", final=True, reason="")
        self.feed = LiveFeed(lambda _: None)

    async def order(self, word, target):
        self.orders.append((word, target))
        return self.answer

    def show(self, page, status):
        page.call(lambda: self.feed.update(status, time.monotonic(), site_revision=1))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The file of a flight of 16 s that ends in a hold, and its statuses in order."""
    folder, statuses = recorded_flight(
        tmp_path_factory.mktemp("flights"), cycles=800, hold_from_s=12.0
    )
    return folder / "flight.mcap", [*statuses.values()]


@pytest.fixture
def state_in(recorded):
    """A status of the flight in the middle of a mission state."""

    def state_in(name):
        found = [each for each in recorded[1] if each["mission"]["state"] == name]
        return found[len(found) // 2]

    return state_in


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture
def flight():
    return Flight()


@pytest.fixture
def page(flight, recorded, state_in, tmp_path):
    (tmp_path / FLIGHT).mkdir()
    (tmp_path / FLIGHT / "flight.mcap").hardlink_to(recorded[0])
    (tmp_path / FLIGHT / "decisions.jsonl").write_bytes(b"{}\n")
    site = Site.load(SITE_FILE).flown_with(MARGIN)
    view = {"revision": 1, "site": site_view(site), "maps": maps_view(build_maps(site, VEHICLE))}
    text = SITE_FILE.read_text(encoding="utf-8")
    content = PageContent(
        about={
            "kind": "service",
            "recording": None,
            "vehicle": {"name": VEHICLE.name, "radius_m": 0.38, "reserve_s": 60.0},
        },
        site=lambda: view,
        feed=flight.feed,
        order=flight.order,
        token=TOKEN,
        recordings=PageRecordings(tmp_path),
        open_playback=lambda _: McapPlayback(recorded[0]),
        make_what_if=lambda: WhatIf(text=text, source="site", vehicle=VEHICLE, margin=MARGIN),
    )
    with served(content) as page:
        flight.show(page, state_in("flying"))
        yield page


@pytest.fixture
def live(browser, page):
    with opened(browser, f"http://{page.host}/#live") as tab:
        tab.get_by_text(re.compile("^Live, ")).wait_for()
        yield tab


@pytest.fixture
def what_if(browser, page):
    with opened(browser, f"http://{page.host}/#what-if") as tab:
        settled(tab)
        yield tab


def settled(tab):
    """Waits for all best paths: what is asked last."""
    tab.get_by_text("different paths are optimal").wait_for()


# Live


def test_the_headline_says_where_the_aircraft_goes_and_who_steers(live, state_in):
    status = state_in("flying")
    goal = status["mission"]["goal"]
    assert live.locator("h1").inner_text() == f"Flying {status['mission']['mission']} to {goal}"
    assert "the companion steers" in live.locator(".lead").inner_text()
    assert live.locator(".plane text.goal").text_content() == goal
    assert f"{status['path']['left_m']:.1f} m" in live.locator(".figures").inner_text()
    clearance = f"{status['aircraft']['clearance_m']:.1f} m, hull to "
    assert clearance in live.locator(".figures").inner_text()


def test_changes_come_by_themselves_and_none_is_read_twice(live, page, flight, state_in):
    flight.show(page, state_in("holding"))
    live.get_by_role("heading", name="Holding").wait_for()


def test_each_risk_opens_to_its_inputs(live):
    for name in ("Wind", "Communication", "Localization", "Battery"):
        gauge = live.locator("details.risk", has_text=name)
        gauge.locator("summary").click()
        gauge.locator("table").wait_for()
        gauge.locator("summary").press("Enter")
        assert not gauge.locator("table").is_visible()


def test_each_layer_of_the_plane_can_be_chosen(live):
    def paths(kind):
        return live.locator(f".plane path.line.{kind}").count()

    image = live.locator(".plane image")
    safety = image.get_attribute("href")
    live.get_by_role("button", name="Speed map").click()
    assert image.get_attribute("href") != safety
    live.get_by_role("button", name="No map").click()
    assert image.count() == 0
    live.get_by_role("button", name="Safety map").click()
    live.locator(".plane path.line.exit").wait_for(state="attached")
    assert (paths("exit"), paths("evacuation"), paths("other")) == (1, 1, 0)
    assert live.locator(".plane .end").count() == 2
    live.get_by_label("Other risk levels").check()
    live.locator(".plane path.line.other").first.wait_for(state="attached")
    assert paths("other") > 1
    live.get_by_label("Exit and evacuation").uncheck()
    assert paths("exit") == 0
    live.get_by_label("Path before").uncheck()
    assert paths("ghost") == 0


def test_a_condition_stands_first_with_value_and_action(live, page, flight, state_in):
    condition = {
        "name": "wind",
        "action": "hold",
        "reason": "wind 12.3 m/s > 10",
        "overridden": False,
    }
    status = state_in("flying") | {"supervision": {"action": "hold", "conditions": [condition]}}
    flight.show(page, status)
    card = live.locator(".card.caution", has_text="Against the flight")
    card.get_by_text("wind 12.3 m/s > 10").wait_for()
    assert "Holds" in card.inner_text()


def test_a_high_risk_without_a_condition_is_one_verdict_with_its_cause(
    live, page, flight, state_in
):
    state = state_in("flying")
    assert state["supervision"]["conditions"] == []
    gusts = {"name": "gusts", "reading": "9.1 m/s"}
    risk = {name: index | {"value": 0.1, "known": True} for name, index in state["risk"].items()}
    risk["wind"] |= {"value": 0.9, "target": 0.9, "worst": "gusts", "inputs": [gusts]}
    risk["battery"] |= {"known": False}
    # After the period of the sections that come twice a second.
    status = state | {"risk": risk}
    page.call(lambda: flight.feed.update(status, time.monotonic() + 1.0, site_revision=1))
    words = (
        "No limit is exceeded. Wind risk is high: gusts 9.1 m/s. No data for the risk of battery."
    )
    live.get_by_text(words, exact=True).wait_for()
    assert live.locator(".conditions li").count() == 1
    battery = live.locator("details.risk", has_text="Battery")
    assert battery.locator(".value").inner_text() == "no data"


def test_a_held_aircraft_that_still_moves_brakes(live, page, flight, state_in):
    state = state_in("holding")
    moving = state["aircraft"] | {"speed_mps": 1.5}
    flight.show(page, state | {"aircraft": moving})
    live.get_by_role("heading", name="braking: 1.5 m/s").wait_for()


def test_the_last_refused_setpoint_is_said_with_its_limit_and_its_age(live, page, flight, state_in):
    row = live.locator("dt:text-is('Last refused setpoint') + dd")
    assert row.inner_text() == "none so far"
    gate = {"action": "held", "reason": "setpoint jumps by 0.3 m", "value": 0.3, "limit": 0.05}
    flight.show(page, state_in("flying") | {"gate": gate | {"unit": "m", "age_s": 12.3}})
    words = "12 s ago, held at the last good setpoint: setpoint jumps by 0.3 m (limit 0.05 m)"
    live.get_by_text(words, exact=True).wait_for()
    gate |= {"action": "ended", "reason": "setpoint at 1.4 m/s > 1.1", "limit": 1.1}
    flight.show(page, state_in("flying") | {"gate": gate | {"unit": "m/s", "age_s": 0.4}})
    words = "0.4 s ago, stopped sending setpoints: setpoint at 1.4 m/s > 1.1"
    live.get_by_text(words, exact=True).wait_for()


def test_the_page_says_what_happens_when_a_link_is_lost(live, page, flight, state_in):
    live.get_by_text("companion holds after 10 s", exact=True).wait_for()
    flight.show(page, state_in("flying") | {"failsafes": None})
    live.get_by_text("unknown: the autopilot's parameters are not read yet").wait_for()
    actions = [
        {"trigger": "ground station", "by": "companion", "action": "hold", "after_s": 10.0},
        {"trigger": "GCS loss", "by": "autopilot", "action": "go on", "after_s": None},
        {"trigger": "companion loss", "by": "autopilot", "action": "land", "after_s": None},
    ]
    flight.show(page, state_in("flying") | {"failsafes": {"actions": actions}})
    live.get_by_text("companion holds after 10 s", exact=True).wait_for()
    live.get_by_text("PX4 lands", exact=True).wait_for()


def test_an_order_is_confirmed_given_with_the_token_and_answered(live, flight):
    live.get_by_role("button", name="Hold").click()
    live.get_by_label("Token of this page").fill(TOKEN)
    live.get_by_role("button", name="Cancel").click()
    assert flight.orders == []
    live.get_by_role("button", name="Hold").click()
    live.get_by_label("Token of this page").fill(TOKEN)
    live.get_by_role("button", name="Hold here").click()
    live.get_by_text("Answer to hold: accepted").wait_for()
    assert flight.orders == [("hold", None)]


def test_every_order_has_a_button(live, page, flight, state_in):
    live.evaluate("token => sessionStorage.setItem('moar-token', token)", TOKEN)
    flight.answer = ServiceAnswer(result="DENIED", final=True, reason="no path")
    flight.show(page, state_in("holding"))
    live.get_by_label("Target to inspect").select_option("splice-inner")
    for button, order in (
        ("Continue", "continue"),
        ("Inspect", "inspection"),
        ("Exit", "exit"),
        ("Evacuate", "evacuation"),
        ("Release control", "release"),
    ):
        live.get_by_role("button", name=button, exact=True).click()
        live.locator("#confirm-ok").click()
        live.get_by_text(f"Answer to {order}: denied: no path").wait_for()
    assert [word for word, _ in flight.orders] == [
        "continue",
        "inspection",
        "exit",
        "evacuation",
        "release",
    ]
    assert flight.orders[1][1] is not None


def test_each_order_is_in_sight_on_a_phone(browser, page):
    with opened(browser, f"http://{page.host}/#live", size="phone") as tab:
        tab.get_by_text(re.compile("^Live, ")).wait_for()
        buttons = tab.locator(".orders button")
        boxes = [buttons.nth(index).bounding_box() for index in range(buttons.count())]
        assert len(boxes) == 6
        width, height = SIZES["phone"]
        for box in boxes:
            assert box["x"] >= 0.0
            assert box["x"] + box["width"] <= width
            assert box["y"] + box["height"] <= height


@pytest.mark.parametrize("name", ["planning", "ready", "overridden", "holding", "idle"])
def test_hold_is_offered_in_each_state(live, page, flight, state_in, name):
    state = state_in("flying")
    flight.show(page, state | {"mission": state["mission"] | {"state": name, "text": name}})
    live.get_by_text(f" ago: {name}").wait_for()
    assert live.get_by_role("button", name="Hold").is_enabled()
    assert live.get_by_role("button", name="Continue").is_enabled()


def test_paths_that_the_planner_no_longer_answers_are_not_shown(browser, page, flight, state_in):
    with opened(browser, f"http://{page.host}/#live", fault="503") as tab:
        tab.get_by_label("Other risk levels").check()
        others = tab.locator(".plane path.other")
        others.first.wait_for(state="attached")
        tab.route("**/api/what-if", lambda route: route.fulfill(status=503, body="{}"))
        state = state_in("flying")
        with tab.expect_response("**/api/what-if"):
            flight.show(page, state | {"plan": state["plan"] | {"paths": 99}})
        answered(tab)
        assert others.count() == 0


def test_the_live_view_asks_for_no_plan_before_other_risk_levels_are_shown(browser, page):
    asked = []
    with opened(browser, f"http://{page.host}/#live") as tab:
        tab.on("request", lambda request: asked.append(request.url))
        tab.reload()
        tab.locator(".plane path.exit").first.wait_for(state="attached")
        assert not [url for url in asked if "what-if" in url]
        with tab.expect_response("**/api/what-if"):
            tab.get_by_label("Other risk levels").check()


def test_a_wrong_token_orders_nothing_and_is_said(browser, page, flight):
    address = f"http://{page.host}/#token=wrong-token-of-the-page"
    with opened(browser, address, fault="401") as tab:
        tab.get_by_text(re.compile("^Live, ")).wait_for()
        assert "token" not in tab.url
        tab.get_by_role("button", name="Hold").click()
        tab.locator("#confirm-ok").click()
        tab.get_by_text("Not ordered:").wait_for()
        assert flight.orders == []


def test_a_silent_service_is_said(live, page, flight):
    page.call(lambda: flight.feed.note_silence(time.monotonic() + 7.0))
    live.get_by_text("No data from the service for").wait_for()


def test_a_connection_that_brings_nothing_is_said_and_made_anew(browser, page):
    sockets = []

    def accept(socket):
        sockets.append(socket)

    with opened(browser, "about:blank") as tab:
        tab.clock.install()
        tab.route_web_socket("**/live", accept)
        tab.goto(f"http://{page.host}/#live")
        tab.clock.fast_forward(3000)
        tab.get_by_text("No data from the service for").wait_for()
        assert len(sockets) == 1
        tab.clock.fast_forward(5000)
        answered(tab)
        assert len(sockets) == 2


def answered(tab):
    """Waits for an answer to a later request than those of the page so far."""
    tab.evaluate("() => fetch('api/page').then((response) => response.text())")


def test_of_a_long_flight_the_newest_places_are_kept(live, state_in):
    state = state_in("flying")
    places = live.evaluate(
        """async (state) => {
            const { LiveView } = await import("/static/live.js");
            const view = new LiveView({ orders: false }, () => {}, () => {});
            view.readSite = () => {};
            view.receive({ all: state, flown: Array.from({ length: 5000 }, (_, x) => [x, 0, 0]) });
            return [view.flown.length, view.flown[0], view.flown.at(-1)];
        }""",
        state,
    )
    assert places == [5000, [1, 0, 0], pytest.approx(state["aircraft"]["position_m"])]


def test_what_is_live_does_not_wait_for_the_planner(browser, page):
    with opened(browser, "about:blank") as tab:
        tab.route("**/api/what-if", lambda _: None)
        tab.goto(f"http://{page.host}/#live")
        tab.get_by_text(re.compile("^Live, ")).wait_for()


def test_a_chosen_target_stays_when_the_site_changes(live, page, flight, state_in):
    target = live.get_by_label("Target to inspect")
    target.select_option("splice-inner")
    with live.expect_response("**/api/site"):
        state = state_in("flying")
        page.call(lambda: flight.feed.update(state, time.monotonic(), site_revision=2))
    answered(live)
    assert target.input_value() == "splice-inner"


def test_what_is_unknown_or_old_is_said_and_no_number(live, page, flight, state_in):
    state = state_in("flying")
    host = dict.fromkeys(state["host"])
    autopilot = state["autopilot"] | {"age_s": 40.0}
    # After the period of the sections that come twice a second.
    status = state | {"host": host, "autopilot": autopilot}
    page.call(lambda: flight.feed.update(status, time.monotonic() + 1.0, site_revision=1))
    for text in (
        "unknown memory, unknown disk free",
        "nothing for 40 s, ",
        "armed 40 s ago; no report since",
    ):
        live.get_by_text(text).wait_for()


@pytest.mark.parametrize(
    ("address", "requests", "last"),
    [(f"recordings={FLIGHT}", "**/frames*", "GET"), ("what-if", "**/api/what-if", "POST")],
)
def test_a_view_that_was_left_changes_nothing_in_the_next(browser, page, address, requests, last):
    with opened(browser, "about:blank") as tab:
        tab.route(requests, lambda _: None)
        with tab.expect_request(requests):
            tab.goto(f"http://{page.host}/#{address}")
        tab.get_by_role("link", name="Live").click()
        tab.get_by_text(re.compile("^Live, ")).wait_for()
        with tab.expect_response(lambda each: each.request.method == last):
            tab.unroute(requests)  # and what was held goes on
        answered(tab)
        assert tab.locator("#connection").inner_text().startswith("Live, ")
        assert tab.url.endswith("#live")


# What-if


def cost(tab):
    return tab.locator(".figures", has_text="cost J").inner_text()


def test_an_obstacle_is_dragged_and_the_path_changes(what_if):
    before = what_if.locator(".plane path.line.path").get_attribute("d")
    handle = what_if.get_by_role("button", name=re.compile("^conductor right-lower"))
    box = handle.bounding_box()
    at = (box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0)
    what_if.mouse.move(*at)
    what_if.mouse.down()
    what_if.mouse.move(at[0] + 60.0, at[1] - 40.0, steps=4)
    what_if.mouse.up()
    what_if.wait_for_function(
        "d => document.querySelector('.plane path.line.path').getAttribute('d') !== d", arg=before
    )


def test_start_target_and_landing_points_move_by_keys(what_if):
    for name in ("start", "target splice-outer", "target splice-inner"):
        handle = what_if.get_by_role("button", name=re.compile(f"^{name}:"))
        words = handle.get_attribute("aria-label")
        handle.focus()
        handle.press("ArrowLeft")
        what_if.wait_for_function(
            "([name, words]) => [...document.querySelectorAll('.handle')].some(each => "
            "each.ariaLabel?.startsWith(name + ':') && each.ariaLabel !== words)",
            arg=[name, words],
        )
    what_if.get_by_label("Far landing points").check()
    handle = what_if.get_by_role("button", name=re.compile("^landing point 0 of the exit"))
    handle.focus()
    handle.press("Shift+ArrowUp")
    what_if.get_by_role(
        "button", name=re.compile("landing point 0 of the exit: x 40.00 m, z 3.50")
    ).wait_for()


def test_every_slider_and_choice_reaches_the_planner(what_if):
    for name in (
        "Wind",
        "Communication",
        "Localization",
        "Battery",
        "d_min",
        "d_max",
        "Flight margin",
    ):
        slider = what_if.get_by_role("slider", name=name)
        words = slider.get_attribute("aria-valuetext")
        slider.press("ArrowRight")
        assert slider.get_attribute("aria-valuetext") != words
    asked = []
    what_if.on(
        "request",
        lambda request: asked.append(request.post_data_json) if request.post_data else None,
    )
    what_if.get_by_label("Rule of the weights").select_option("calibrated")
    what_if.get_by_label("Goal").select_option("splice-inner")
    what_if.get_by_label("Mission").select_option("evacuation")
    what_if.get_by_label("Goal").select_option("1")
    what_if.get_by_role("heading", name=re.compile("^Evacuation to landing point 1")).wait_for()
    settled(what_if)
    assert asked[-1]["adaptation"] == "calibrated"
    assert asked[-1]["risk"]["wind"] == pytest.approx(0.01)
    assert asked[-1]["d_min_m"] == pytest.approx(VEHICLE.safety.d_min_m + 0.05)
    what_if.get_by_role("button", name="Reset").click()
    what_if.get_by_role("heading", name=re.compile("^Inspection to splice-outer")).wait_for()


def test_the_triangle_shows_each_best_path(what_if):
    regions = what_if.locator(".triangle .region")
    count = regions.count()
    assert count > 3
    what_if.get_by_role("button", name="Path after").click()
    what_if.get_by_text(f"Path 1 of {count}").wait_for()
    what_if.get_by_role("button", name="Path before").click()
    what_if.get_by_text(f"Path {count} of {count}").wait_for()
    assert what_if.locator(".plane path.line.shown").count() == 1
    largest = "regions => regions.map(each => each.getBBox()).map(box => box.width * box.height)"
    sizes = regions.evaluate_all(largest)
    regions.nth(sizes.index(max(sizes))).click()
    what_if.get_by_text(re.compile(rf"^Path \d+ of {count}: safety")).wait_for()
    what_if.get_by_role("button", name="Own path").click()
    assert what_if.locator(".plane path.line.shown").count() == 0
    weights = what_if.get_by_role("button", name=re.compile("^base weights"))
    words = weights.get_attribute("aria-label")
    weights.press("ArrowUp")
    what_if.wait_for_function(
        "words => document.querySelector('.triangle .handle').ariaLabel !== words", arg=words
    )


def test_a_state_is_shared_by_its_address(what_if, browser):
    what_if.get_by_role("slider", name="Wind").press("End")
    settled(what_if)
    what_if.wait_for_function("location.hash.length > 20")
    time.sleep(0.6)
    before = cost(what_if)
    with opened(browser, what_if.url) as other:
        settled(other)
        assert cost(other).splitlines()[:6] == before.splitlines()[:6]
        assert other.get_by_role("slider", name="Wind").input_value() == "1"


def test_the_changed_site_is_a_file_that_check_accepts(what_if, tmp_path):
    handle = what_if.get_by_role("button", name=re.compile("^conductor left-lower"))
    handle.press("ArrowRight")
    target = what_if.get_by_role("button", name=re.compile("^target splice-inner"))
    target.press("ArrowUp")
    with what_if.expect_download() as download:
        what_if.get_by_role("button", name="Download site file").click()
    file = tmp_path / download.value.suggested_filename
    download.value.save_as(file)
    site, shipped = Site.load(file), Site.load(SITE_FILE)
    moved, before = site.obstacles[0], shipped.obstacles[0]
    assert moved.position_m[0] == pytest.approx(before.position_m[0] + 0.25, abs=0.03)
    assert site.target("splice-inner").position_m[1] == pytest.approx(
        shipped.target("splice-inner").position_m[1] + 0.25, abs=0.03
    )
    assert site.obstacles[1:] == shipped.obstacles[1:]
    assert site.landing_m[Mission.EXIT] == shipped.landing_m[Mission.EXIT]
    assert main(["check", "--files", "--site", str(file)]) == 0


def test_a_place_without_a_path_says_why(what_if):
    handle = what_if.get_by_role("button", name=re.compile("^target splice-outer"))
    for _ in range(4):
        handle.press("Shift+ArrowLeft")
    what_if.get_by_text("No path: target splice-outer").wait_for()


# Recordings and map


def test_a_recording_is_played_back_with_its_events(browser, page):
    with opened(browser, f"http://{page.host}/#recordings") as tab:
        tab.get_by_role("link", name="Play back").click()
        tab.locator("[data-loaded]").wait_for()
        slider = tab.get_by_role("slider", name="Time in the recording")
        slider.press("End")
        end = slider.input_value()
        slider.press("Home")
        events = tab.locator(".events button")
        assert events.count() > 5
        path = tab.locator(".events button", has_text="path").first
        path.click()
        assert float(slider.input_value()) > 0.0
        assert path.get_attribute("aria-current") == "true"
        began = float(slider.input_value())
        tab.get_by_label("Speed").select_option("1")
        tab.get_by_role("button", name="Play", exact=True).click()
        tab.wait_for_function(
            "began => Number(document.querySelector('.timeline input').value) > began + 0.3",
            arg=began,
        )
        tab.get_by_role("button", name="Pause").click()
        assert began < float(slider.input_value()) <= float(end)
        assert tab.locator(".timeline .mark").count() >= 1
        assert tab.locator(".plane path.line.flown").count() == 1


def test_a_replay_is_stamped_and_marks_the_event_at_or_before_the_play_head(browser, page):
    def seconds(text):
        minutes, rest = text.split(":")
        return 60.0 * float(minutes) + float(rest)

    with opened(browser, f"http://{page.host}/#recordings={FLIGHT}") as tab:
        tab.locator("[data-loaded]").wait_for()
        slider = tab.get_by_role("slider", name="Time in the recording")
        times = [seconds(each) for each in tab.locator(".events .at").all_inner_texts()]
        middle = (times[len(times) // 2] + times[-1]) / 2.0
        slider.fill(f"{middle:.1f}")
        head = seconds(tab.locator(".timeline output").inner_text().split(" of ")[0])
        marked = tab.locator(".events [aria-current] .at").inner_text()
        assert seconds(marked) == max(each for each in times if each <= head)
        stamp = tab.locator(".stamp").inner_text()
        assert re.fullmatch(r"REPLAY 2023-11-14 22:1\d:\d\d UTC", stamp)


def test_a_telemetry_log_is_played_back_as_far_as_it_tells(browser):
    file = Path("tests/data/ardupilot_failsafes.tlog").resolve()
    replay = played(str(file), VEHICLE, None)
    content = PageContent(
        about={"kind": "recording", "recording": file.name, "vehicle": None},
        site=lambda: None,
        recordings=PageRecordings(file=file),
        open_playback=lambda _: ReplayPlayback(replay, None),
    )
    with served(content) as page, opened(browser, f"http://{page.host}/") as tab:
        tab.locator("[data-loaded]").wait_for()
        assert not tab.get_by_role("link", name="What-if").is_visible()
        tab.get_by_role("slider", name="Time in the recording").press("End")
        tab.get_by_text("This recording has no conditions.").wait_for()
        assert tab.locator(".events button").count() == len(replay.events)


def test_recordings_are_listed_downloaded_and_deleted(browser, page, tmp_path):
    with opened(browser, f"http://{page.host}/#recordings") as tab:
        with tab.expect_download() as download:
            tab.get_by_role("link", name=re.compile("decisions.jsonl")).click()
        assert download.value.path().read_bytes() == b"{}\n"
        tab.get_by_role("button", name="Delete").click()
        tab.get_by_label("Token of this page").fill(TOKEN)
        tab.locator("#confirm-ok").click()
        tab.get_by_text(f"{FLIGHT} is deleted.").wait_for()
        assert not (tmp_path / FLIGHT).exists()


def test_the_map_has_the_coordinates_of_the_site(browser, page):
    site = Site.load(SITE_FILE)
    target = site.targets[0]
    point = site.frame.to_geodetic((target.position_m[0], 0.0, target.position_m[1]))
    with opened(browser, f"http://{page.host}/#map") as tab:
        row = tab.locator("tr", has_text=target.name)
        row.wait_for()
        cells = row.locator("td").all_inner_texts()[1:]
        assert cells == [
            f"{point.latitude_deg:.6f}",
            f"{point.longitude_deg:.6f}",
            f"{point.altitude_amsl_m:.1f}",
        ]
        tab.locator(".plane .aircraft").wait_for()


# All views


def test_colours_are_chosen_and_kept(live):
    button = live.locator("#theme")
    for theme in ("light", "dark", "light"):
        button.click()
        assert live.evaluate("document.documentElement.dataset.theme") == theme
    live.reload()
    assert live.evaluate("document.documentElement.dataset.theme") == "light"


def test_views_are_reached_by_keyboard(live):
    live.keyboard.press("Tab")
    assert live.evaluate("document.activeElement.textContent") == "Skip to the view"
    live.locator("#tab-what-if").press("Enter")
    settled(live)
    live.locator("#tab-live").press("Enter")
    live.get_by_text(re.compile("^Live, ")).wait_for()


@pytest.mark.parametrize(("size", "theme"), [("laptop", "dark"), ("phone", "light")])
def test_no_view_has_a_fault_of_accessibility_or_is_wider_than_the_screen(
    browser, page, size, theme
):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    with opened(browser, f"http://{page.host}/", size=size, theme=theme) as tab:
        for view in VIEWS:
            tab.goto(f"http://{page.host}/#{view}")
            tab.locator("h1").wait_for()
            tab.wait_for_timeout(400.0)
            found = axe.run(tab).response["violations"]
            grave = [item for item in found if item["impact"] not in (None, "minor")]
            assert [(view, item["id"], item["nodes"][0]["html"]) for item in grave] == []
            assert tab.evaluate("document.documentElement.scrollWidth") <= SIZES[size][0]
