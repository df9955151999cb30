"""Every call into the machine is logged once, with its answer."""

import inspect

from moar_companion.companion.companion import Companion
from moar_companion.service.recording.calls import _ARGUMENTS, INPUTS, OUTPUTS, START

from ..flights.lockstep import COMPANION_LINK, Lockstep

QUESTIONS = {"peers", "received_packets"}
"""Methods that neither change nor return a decision of the machine."""


def test_every_method_of_the_machine_is_logged_except_those_that_only_read():
    methods = {
        name
        for name, item in inspect.getmembers(Companion, inspect.isfunction)
        if not name.startswith("_")
    }
    assert methods == {*INPUTS, *OUTPUTS, *QUESTIONS}


def test_every_input_with_arguments_has_their_types():
    for name in INPUTS:
        parameters = list(inspect.signature(getattr(Companion, name)).parameters)[1:]
        assert len(_ARGUMENTS.get(name, ())) == len(parameters), name


def test_a_call_inside_a_logged_call_is_not_logged_again():
    companion = Lockstep().companion
    companion.take_in([(0.0, COMPANION_LINK, b"noise", None)], 0.02)
    companion.tick(0.02)
    sent = companion.data_to_send(control=True)
    calls = companion.calls()
    assert [call.method for call in calls] == [START, "take_in", "tick", "data_to_send"]
    assert calls[-1].options == {"control": True}
    assert calls[-1].result == sent
    assert companion.calls() == []
