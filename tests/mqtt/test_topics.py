"""Published topics: their table, their payloads and their times."""

import copy
import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from moar_companion.service.mqtt import payloads
from moar_companion.service.mqtt.schemas import FOLDER, schemas
from moar_companion.service.mqtt.topics import TOPICS, Publication

from ..companion.desk import Desk
from .statuses import flying, status_of

EVENTS = {"mission", "conditions", "plan"}


def strict(payload):
    """JSON as its standard has it, without NaN and infinities."""

    def refuse(word):
        raise AssertionError(f"{word} in JSON")

    return json.loads(payload, parse_constant=refuse)


def published(status, publication=None, now_s=0.0):
    messages = (publication or Publication("a1")).due(status, now_s)
    return {message.topic.removeprefix("moar/a1/"): message for message in messages}


def test_before_the_first_packet_every_payload_but_plan_and_perception_marks_unknown_values():
    reported = published(status_of(Desk()))
    assert set(reported) == {topic.name for topic in TOPICS} - {"plan", "perception", "inspection"}
    assert strict(reported["battery"].payload)["remaining"] is None
    assert strict(reported["position"].payload)["latitude_deg"] is None
    risks = strict(reported["risk"].payload)["risk"]
    assert [index["known"] for index in risks.values()] == [False] * 4


def test_in_flight_the_payloads_have_the_values_of_the_status():
    status = status_of(flying())
    reported = {name: strict(item.payload) for name, item in published(status).items()}
    assert set(reported) == {topic.name for topic in TOPICS}
    assert reported["mission"]["state"] == "flying"
    assert reported["mission"]["target"] == flying().site.targets[1].name
    assert reported["mission"]["since_s"] == pytest.approx(
        status["time_s"] - status["mission"]["for_s"], abs=0.06
    )
    assert reported["position"]["position_m"] == pytest.approx(
        status["aircraft"]["position_m"], abs=1e-4
    )
    for name, index in reported["risk"]["risk"].items():
        assert index["value"] == pytest.approx(status["risk"][name]["value"], abs=1e-4)
        assert index["words"] == status["risk"][name]["words"]
    assert reported["weights"]["adjusted"]["safety"] == pytest.approx(
        status["weights"]["adjusted"]["safety"], abs=1e-4
    )
    assert reported["plan"]["path"][0]["z_m"] == pytest.approx(
        flying().decided("plan")[-1]["plan"]["waypoints"][0]["z_m"]
    )


def test_only_risk_inputs_that_were_received_are_published():
    status = status_of(flying())
    reported = strict(published(status)["risk/inputs"].payload)["inputs"]
    for name, index in status["risk"].items():
        received = [item["name"] for item in index["inputs"] if item["age_s"] is not None]
        assert [item["name"] for item in reported[name]] == received


@given(
    st.lists(
        st.tuples(st.integers(0, 10_000), st.sampled_from([math.nan, math.inf, -math.inf])),
        max_size=20,
    )
)
def test_a_number_that_is_not_finite_becomes_null_or_costs_its_topic_alone(places):
    status = copy.deepcopy(status_of(flying()))
    numbers = list(floats(status))
    for place, value in places:
        part, key = numbers[place % len(numbers)]
        part[key] = value
    publication = Publication("a1")
    reported = published(status, publication)
    assert set(reported) | set(publication.unfit) == {topic.name for topic in TOPICS}
    for message in reported.values():
        strict(message.payload)


def floats(value):
    """Every place of a float in a status: its container and key."""
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            if isinstance(item, float) and isinstance(value, dict):
                yield value, key
            else:
                yield from floats(item)


def test_each_topic_is_published_at_the_rate_of_the_table():
    publication, status, counts = Publication("a1"), status_of(flying()), {}
    for step in range(120):
        for name in published(status, publication, 100.0 + 0.5 * step):
            counts[name] = counts.get(name, 0) + 1
    assert counts == {
        topic.name: 1 if topic.period_s is None else 60.0 / topic.period_s for topic in TOPICS
    }


def test_events_are_published_at_once_and_only_when_their_content_changes():
    publication, status = Publication("a1"), status_of(flying())
    published(status, publication)
    later = {**status, "time_s": status["time_s"] + 1.0}
    later["mission"] = {**status["mission"], "for_s": status["mission"]["for_s"] + 1.0}
    later["mission"]["text_age_s"] = status["mission"]["text_age_s"] + 1.0
    later["plan"] = {**status["plan"], "age_s": status["plan"]["age_s"] + 1.0}
    assert not EVENTS & set(published(later, publication, 0.1))
    later["mission"] = {**later["mission"], "state": "holding"}
    reported = published(later, publication, 0.1)
    assert set(reported) == {"mission"}
    assert (reported["mission"].qos, reported["mission"].retain) == (1, True)


def test_what_the_gate_refused_last_is_an_event_that_no_age_repeats():
    publication, status = Publication("a1"), status_of(flying())
    assert strict(published(status, publication)["conditions"].payload)["gate"] is None
    gate = {"action": "held", "reason": "setpoint jumps by 0.3 m"}
    gate |= {"value": 0.3, "limit": 0.05, "unit": "m", "age_s": 2.0}
    reported = published({**status, "gate": gate}, publication, 0.1)
    event = strict(reported["conditions"].payload)["gate"]
    assert event.pop("since_s") == pytest.approx(status["time_s"] - 2.0, abs=0.06)
    assert event == {name: value for name, value in gate.items() if name != "age_s"}
    later = {**status, "time_s": status["time_s"] + 1.0, "gate": {**gate, "age_s": 3.0}}
    assert "conditions" not in published(later, publication, 0.2)


def test_after_a_new_connection_every_topic_is_published_again():
    publication, status = Publication("a1"), status_of(flying())
    published(status, publication)
    assert not published(status, publication)
    publication.start_anew()
    assert set(published(status, publication)) == {topic.name for topic in TOPICS}


def test_late_statuses_are_skipped():
    publication, status = Publication("a1"), status_of(flying())
    published(status, publication, 0.0)
    assert "position" in published(status, publication, 60.0)
    assert "position" not in published(status, publication, 60.1)


def test_no_topic_is_published_twice_and_every_row_of_the_table_has_its_schema():
    names = [topic.name for topic in TOPICS]
    assert len(set(names)) == len(names)
    assert all(f"{name.replace('/', '_')}.json" in schemas() for name in names)


def test_the_shipped_schemas_are_current():
    shipped = {path.name: path.read_text() for path in FOLDER.glob("*.json")}
    assert shipped == schemas(), "run moar-companion docs"


@pytest.mark.parametrize("name", [topic.name for topic in TOPICS])
def test_every_field_of_a_payload_is_in_its_schema_with_its_type(name):
    schema = json.loads(schemas()[f"{name.replace('/', '_')}.json"])
    content = strict(published(status_of(flying()))[name].payload)
    for kind in (schema, *schema.get("$defs", {}).values()):
        if "properties" in kind:
            kind["additionalProperties"] = False
    Draft202012Validator(schema).validate(content)


def test_a_last_will_has_no_time():
    assert strict(payloads.Online(online=False).model_dump_json()) == {
        "online": False,
        "since_s": None,
        "version": None,
    }
