"""Files for ground stations: what each of them sends, and what the companion makes of it."""

from __future__ import annotations

import json
import subprocess
import sys
import types
from dataclasses import replace
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.commands import cli
from moar_companion.commands.order_files import order_files, orders_of
from moar_companion.companion.mission.values import Order, Task
from moar_companion.companion.operator_commands import understood
from moar_companion.mavlink.commands import interpret
from moar_companion.mavlink.statustext import Severity, StatusTexts
from moar_companion.planner.site import Site, Target
from moar_companion.settings.config import Authority, shipped_configs
from moar_companion.types import Mission
from tests.one_line import one_line

from .answering import (
    ACCEPTED,
    COMPANION,
    DENIED,
    IN_PROGRESS,
    Aircraft,
    acknowledgement,
    always,
    text,
)

FILE = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
NAMES = ("splice 1", '"it\'s" \\n', "Größe ⚡ 😀", "{0} %s $x", "x" * 60, "7", "all&<b>")
"""Names of targets; the last but one is an index of another."""
AUTOPILOT = 1
KEYS = {
    "label": str,
    "description": str,
    "mavCmd": int,
    "compId": int,
    **{f"param{number}": float for number in range(1, 8)},
}
"""Keys and types of an action, as QGroundControl's MavlinkActionManager reads them."""


@pytest.fixture(scope="module")
def site():
    """The shipped site, with targets whose names need care."""
    shipped = Site.load(FILE)
    place = shipped.targets[0].position_m
    targets = tuple(Target(name=name, position_m=place, dwell_s=1.0) for name in NAMES)
    return replace(shipped, name='315 kV "double\\" circuit é', targets=targets)


def meaning(site, command, component, params):
    """The companion's understanding of a COMMAND_LONG of ground station 255."""
    padded = [*params, *[0.0] * (7 - len(params))]
    message = mavlink.MAVLink_command_long_message(1, component, command, 0, *padded)
    message.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))
    received = interpret(message, link="udp", system_id=1, component_id=COMPANION)
    return understood(received, site, Authority.STREAM)


def expected(site):
    """Every order that a site has, in the order of the buttons."""
    inspection = Mission.INSPECTION
    escapes = [
        Task(mission=mission, landing=index)
        for mission in (Mission.EXIT, Mission.EVACUATION)
        for index in (None, *range(len(site.landing_m[mission])))
    ]
    return [
        Order.HOLD,
        Order.CONTINUE,
        Task(mission=inspection, stops=NAMES),
        *(Task(mission=inspection, stops=(name,)) for name in NAMES),
        *escapes,
        Order.RELEASE,
    ]


def test_each_action_of_qgroundcontrol_is_an_order_of_the_site(site):
    document = json.loads(order_files(site, COMPANION)["qgroundcontrol.json"])
    assert (document["version"], document["fileType"]) == (1, "MavlinkActions")
    actions = document["actions"]
    for action in actions:
        assert {"label", "description", "mavCmd", "compId"} <= set(action)
        assert all(type(value) is KEYS[key] for key, value in action.items())
    sent = [(each["mavCmd"], each["compId"], (each["param1"], each["param2"])) for each in actions]
    assert [meaning(site, *each) for each in sent] == expected(site)


def test_labels_are_different_and_name_the_place(site):
    labels = [order.label for order in orders_of(site)]
    assert len(set(labels)) == len(labels)
    assert [label.removeprefix("MOAR inspection: ") for label in labels[3:10]] == list(NAMES)


def test_a_site_without_targets_and_landing_points_has_orders_that_stop(site):
    bare = replace(site, targets=(), landing_m={})
    assert [order.label for order in orders_of(bare)] == [
        "MOAR hold", "MOAR continue", "MOAR release"
    ]  # fmt: skip


def test_the_component_id_is_in_every_file(site):
    for name, content in order_files(site, 77).items():
        assert ('"compId": 77' if name.endswith(".json") else "COMPONENT = 77\n") in content


def script(site, name, **modules):
    """Namespace of a script that was run, with stand-ins for the modules of its program."""
    source = order_files(site, COMPANION)[name]
    assert source.isascii()
    namespace = {"__name__": "script", **modules.pop("variables", {})}
    before = {name: sys.modules.get(name) for name in modules}
    sys.modules.update(modules)
    try:
        exec(compile(source, name, "exec"), namespace)
    finally:
        for each, module in before.items():
            sys.modules.pop(each)
            if module is not None:
                sys.modules[each] = module
    return namespace


# Mission Planner


class Control:
    """A control of Windows Forms: any property, child controls, and a click."""

    def __init__(self):
        self.Controls = SimpleNamespace(Add=self._add)
        self.children = []
        self.Click = Click()

    def _add(self, child):
        self.children.append(child)

    def Refresh(self):  # noqa: N802
        pass

    def ShowDialog(self):  # noqa: N802
        Control.shown = self


class Click(list):
    """An event, to which handlers are added."""

    def __iadd__(self, handler):
        self.append(handler)
        return self


def mission_planner(site, answer):
    """Window of Mission Planner's script; `answer` takes the arguments of MAV.doCommand."""
    forms = SimpleNamespace(
        **dict.fromkeys(("Button", "FlowLayoutPanel", "Form", "Label"), Control),
        DockStyle=SimpleNamespace(Fill=5, Bottom=2),
        FlowDirection=SimpleNamespace(TopDown=1),
    )
    commands = SimpleNamespace(USER_1=31010, DO_PAUSE_CONTINUE=193)
    modules = {
        "clr": SimpleNamespace(AddReference=lambda _: None),
        "MAVLink": SimpleNamespace(MAV_CMD=commands),
        "System": SimpleNamespace(Byte=int, Single=float),
        "System.Drawing": SimpleNamespace(Size=lambda *size: size),
        "System.Windows.Forms": forms,
    }
    connection = SimpleNamespace(MAV=SimpleNamespace(sysid=1), doCommand=answer)
    script(site, "mission_planner_moar.py", variables={"MAV": connection}, **modules)
    return Control.shown


def test_each_button_of_mission_planner_is_an_order_of_the_site(site):
    sent = []
    window = mission_planner(site, lambda *given: sent.append(given) or len(sent) % 2 == 0)
    panel, status = window.children
    texts = []
    for button in panel.children:
        (clicked,) = button.Click
        clicked(button, None)
        texts.append(status.Text)
    assert [given[0] for given in sent] == [1] * len(sent)
    understandings = [meaning(site, given[2], given[1], given[3:]) for given in sent]
    assert understandings == expected(site)
    assert {len(given) for given in sent} == {10}
    assert texts[:2] == ["MOAR hold: not accepted, see Messages", "MOAR continue: accepted"]


def test_mission_planner_shows_that_no_answer_came(site):
    def silent(*_):
        raise TimeoutError("Timeout on read - doCommand")

    panel, status = mission_planner(site, silent).children
    panel.children[0].Click[0](None, None)
    assert status.Text == "MOAR hold: no answer (Timeout on read - doCommand)"


# MAVProxy


class MPModule:
    """MAVProxy's base class of modules, as far as the module uses it."""

    def __init__(self, mpstate, name, description):
        self.mpstate, self.name, self.description = mpstate, name, description
        self.settings, self.master = mpstate.settings, mpstate.master
        self.commands, self.completions = mpstate.commands, {}

    @property
    def target_system(self):
        return self.settings.target_system

    def add_command(self, name, callback, _description, completions):
        self.commands[name] = callback
        self.completions[name] = completions

    def remove_command(self, name):
        del self.commands[name]

    def add_completion_function(self, name, callback):
        self.completions[name] = callback

    def message_is_from_primary_vehicle(self, message):
        return self.settings.target_component in {0, message.get_srcComponent()}


class MAVProxy:
    """MAVProxy with the module: time, and the packets that it sends."""

    def __init__(self, site):
        self.now_s, self.sent = 100.0, []
        self.settings = SimpleNamespace(
            target_system=1, target_component=AUTOPILOT, source_system=255
        )
        send = SimpleNamespace(command_long_send=lambda *given: self.sent.append(given))
        self.commands = {}
        library = types.ModuleType("MAVProxy.modules.lib")
        library.mp_module = SimpleNamespace(MPModule=MPModule)
        namespace = script(
            site,
            "mavproxy_moar.py",
            **{
                "MAVProxy": types.ModuleType("MAVProxy"),
                "MAVProxy.modules": types.ModuleType("MAVProxy.modules"),
                "MAVProxy.modules.lib": library,
            },
        )
        namespace["time"] = SimpleNamespace(time=lambda: self.now_s)
        self.master = SimpleNamespace(mav=send)
        self.module = namespace["init"](self)

    def passed(self, seconds):
        for _ in range(round(seconds * 10)):
            self.now_s += 0.1
            self.module.idle_task()

    def receive(self, message, component=COMPANION):
        message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=component))
        self.module.mavlink_packet(message)

    def answer(self, result, command=31010, component=COMPANION):
        ack = mavlink.MAVLink_command_ack_message(command, result, 0, 0, 255, 230)
        self.receive(ack, component)


@pytest.fixture
def mavproxy(site):
    return MAVProxy(site)


def test_each_order_of_mavproxys_module_is_an_order_of_the_site(site, mavproxy):
    for order in orders_of(site):
        mavproxy.commands["moar"]([order.word, *order.place.split(" ")])
    understandings = [
        meaning(site, command, component, params)
        for _, component, command, _, *params in mavproxy.sent
    ]
    assert understandings == expected(site)


def test_a_target_may_be_named_by_its_index_but_its_name_goes_first(site, mavproxy):
    for word in ("4", "7"):
        mavproxy.commands["moar"](["inspection", word])
    indices = [given[5] for given in mavproxy.sent]
    assert indices == [4.0, NAMES.index("7")]


def test_unknown_words_send_nothing_and_list_the_orders(mavproxy, capsys):
    for words in ([], ["fly"], ["inspection", "nowhere"], ["hold", "9"], ["exit", "٣"]):
        mavproxy.commands["moar"](words)
    assert mavproxy.sent == []
    listed = capsys.readouterr().out
    assert "    moar inspection splice 1 (or 0)\n" in listed
    assert listed.count("    moar hold \n") == 3  # after a known word, its own orders alone


def test_an_order_is_repeated_with_a_rising_confirmation_until_its_answer(mavproxy, capsys):
    mavproxy.commands["moar"](["hold"])
    mavproxy.passed(2.5)
    mavproxy.answer(mavlink.MAV_RESULT_ACCEPTED, command=193)  # of another command
    mavproxy.answer(mavlink.MAV_RESULT_ACCEPTED, component=AUTOPILOT)
    mavproxy.receive(mavlink.MAVLink_command_ack_message(31010, 0, 0, 0, 245, 190))  # of another
    mavproxy.passed(1.0)
    assert [given[3] for given in mavproxy.sent] == [0, 1, 2, 3]
    assert len({given[:3] + given[4:] for given in mavproxy.sent}) == 1
    mavproxy.answer(mavlink.MAV_RESULT_DENIED)
    mavproxy.answer(mavlink.MAV_RESULT_DENIED)
    mavproxy.passed(9.0)
    assert len(mavproxy.sent) == 4
    assert capsys.readouterr().out == "moar: MOAR hold: DENIED\n"


def test_silence_is_reported_once_and_planning_prolongs_the_wait(mavproxy, capsys):
    mavproxy.commands["moar"](["inspection"])
    for _ in range(3):
        mavproxy.passed(4.0)
        mavproxy.answer(mavlink.MAV_RESULT_IN_PROGRESS)
    assert capsys.readouterr().out == ""
    mavproxy.passed(20.0)
    assert capsys.readouterr().out == "moar: no answer to MOAR inspection\n"


def test_the_companions_texts_are_shown_whole_and_once(mavproxy, capsys):
    words = "MOAR: a text that is longer than fifty characters, in two parts"
    chunks = StatusTexts().messages(Severity.WARNING, words, 0.0)
    mavproxy.receive(mavlink.MAVLink_statustext_message(4, b"MOAR: ready for exit", 0, 0))
    for chunk in chunks:
        mavproxy.receive(chunk)
    mavproxy.receive(mavlink.MAVLink_statustext_message(4, b"Takeoff", 0, 0), AUTOPILOT)
    mavproxy.settings.target_component = 0  # then MAVProxy shows them itself
    mavproxy.receive(mavlink.MAVLink_statustext_message(4, b"MOAR: exit", 0, 0))
    assert capsys.readouterr().out == f"MOAR: ready for exit\n{words}\n"


@pytest.mark.parametrize(
    ("autopilot", "mode"),
    [
        (mavlink.MAV_AUTOPILOT_PX4, ("HOLD", (4.0, 3.0))),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, ("BRAKE", (17.0, 0.0))),
    ],
)
def test_a_takeover_reaches_the_autopilot_even_with_the_companion_as_target(
    mavproxy, autopilot, mode, capsys
):
    mavproxy.commands["moar"](["takeover"])
    assert (mavproxy.sent, capsys.readouterr().out) == ([], "moar: the autopilot is not received\n")
    mavproxy.receive(mavlink.MAVLink_heartbeat_message(2, autopilot, 81, 0, 4, 3), AUTOPILOT)
    mavproxy.receive(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))
    mavproxy.settings.target_component = COMPANION
    mavproxy.passed(3.0)
    warning = capsys.readouterr().out
    assert warning.startswith("moar: target_component is 195, the companion: `mode` does not")
    assert warning.count("\n") == 1
    mavproxy.commands["moar"](["takeover"])
    ((system, component, command, _, custom, *params),) = mavproxy.sent
    assert (system, component, command) == (1, AUTOPILOT, mavlink.MAV_CMD_DO_SET_MODE)
    assert (custom, tuple(params[:2])) == (1, mode[1])
    mavproxy.answer(mavlink.MAV_RESULT_ACCEPTED, command=command, component=AUTOPILOT)
    assert capsys.readouterr().out == f"moar: {mode[0]}: ACCEPTED\n"


def test_the_tab_key_offers_orders_and_names_of_one_word(mavproxy):
    (rule,) = mavproxy.module.completions["moar"]
    words = "hold|continue|inspection|exit|evacuation|release|takeover"
    assert rule == f"<{words}> (MOARPLACE)"
    offered = mavproxy.module.completions["(MOARPLACE)"]("")
    assert set(offered) == {"x" * 60, "7", "all&<b>", "0", "1"}
    mavproxy.module.unload()
    assert mavproxy.commands == {}


# MAVSDK


def by_mavsdk(tmp_path, site, *arguments):
    """Runs MAVSDK's script in a process of its own, like its user."""
    file = tmp_path / "mavsdk_moar.py"
    file.write_text(order_files(site, COMPANION)[file.name])
    return subprocess.run(
        [sys.executable, file, *arguments], capture_output=True, text=True, check=False, timeout=60
    )


def test_mavsdks_script_sends_an_order_and_prints_the_answer(site, tmp_path):
    reason = "MOAR: no free path to splice 1, denied"
    for result, name in ((ACCEPTED, "accepted"), (DENIED, "denied")):
        with Aircraft(always(acknowledgement(result), text(reason))) as aircraft:
            url = aircraft.url.replace("udpout:", "udpout://")
            done = by_mavsdk(tmp_path, site, url, "inspection", "splice", "1")
        assert done.stderr == ""
        assert done.returncode == (result != ACCEPTED)
        assert f"MOAR inspection: splice 1: {name}\n" in done.stdout
        assert (result == ACCEPTED) or f"{reason}\n" in done.stdout
        (sent,) = {
            (each.command, each.target_component, each.param1, each.param2)
            for each in aircraft.commands
        }
        command, component, *params = sent
        understanding = meaning(site, command, component, params)
        assert understanding == Task(mission=Mission.INSPECTION, stops=("splice 1",))


def test_mavsdks_script_lists_the_orders_without_one(site, tmp_path):
    done = by_mavsdk(tmp_path, site, "udpin://127.0.0.1:0", "exit", "9")
    assert (done.returncode, done.stderr) == (2, "")
    assert done.stdout.endswith("    exit\n    exit 0\n")


# The command line


def test_the_files_are_written_and_a_replaced_one_is_named(tmp_path, capsys):
    folder = tmp_path / "new" / "folder"
    arguments = ["site", "actions", str(FILE), "--out", str(folder)]
    assert cli.main(arguments) == 0
    names = sorted(path.name for path in folder.iterdir())
    assert names == [
        "mavproxy_moar.py", "mavsdk_moar.py", "mission_planner_moar.py", "qgroundcontrol.json"
    ]  # fmt: skip
    assert all(f"wrote {folder / name}\n" in capsys.readouterr().out for name in names[:1])
    (folder / names[0]).unlink()
    assert cli.main([*arguments, "--component", "42"]) == 0
    written = capsys.readouterr().out
    assert f"wrote {folder / names[0]}\n" in written
    assert written.count("replaced ") == 3
    assert '"compId": 42' in (folder / "qgroundcontrol.json").read_text()


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ((FILE,), "--out: is missing: the folder to write into"),
        ((FILE, "--out", "{file}"), "but the folder cannot be made: File exists"),
        (("none.yaml", "--out", "{folder}"), "none.yaml: no such file"),
        ((FILE, "--out", "{folder}", "--component", "1"), "--component: is '1', must be the comp"),
        ((FILE, "--out", "{folder}", "--component", "x"), "--component: is 'x', must be the comp"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(arguments, reported, tmp_path, capsys):
    file = tmp_path / "file"
    file.touch()
    words = [str(word).format(file=file, folder=tmp_path / "out") for word in arguments]
    assert reported in one_line(["site", "actions", *words], 2, capsys)
    assert list(tmp_path.iterdir()) == [file]


def test_the_page_has_a_program_by_pymavlink_that_orders_and_shows_the_answer():
    page = (shipped_configs() / "guides" / "ground_stations.md").read_text()
    program = page.split("```python\n")[1].split("```")[0]
    answers = [acknowledgement(IN_PROGRESS), text("MOAR: ready for inspection")]
    with Aircraft(always(*answers, acknowledgement(ACCEPTED))) as aircraft:
        source = program.replace("udpin:0.0.0.0:14550", aircraft.url).replace(
            "system = ", "link.mav.heartbeat_send(6, 8, 0, 0, 4)\nsystem = "
        )  # this aircraft answers the first packet
        done = subprocess.run(
            [sys.executable, "-c", source], capture_output=True, text=True, check=True, timeout=60
        )
    assert aircraft.commands[0].command == 31010
    assert "MOAR: ready for inspection" in done.stdout
    assert "result : 0" in done.stdout
