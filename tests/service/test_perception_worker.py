"""Reports of the perception process to the service, over a socket with faults."""

from __future__ import annotations

import errno
import json
import logging
import os

import pytest

from moar_companion.perception.perception_report import PerceptionReport
from moar_companion.planner.site import Polygon, Site
from moar_companion.service.perception_process import Setup
from moar_companion.service.perception_worker import _Worker
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.perception_config import Perception

SITE = Site.load(shipped_configs() / "sites/315kv_double_circuit.yaml")
SOLID = Polygon(name="seen", vertices_m=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))


class Channel:
    """A socket that refuses the first messages, each with an error of the system."""

    def __init__(self, *faults):
        self.sent = []
        self._faults = list(faults)

    def send(self, message):
        if self._faults:
            fault = self._faults.pop(0)
            raise OSError(fault, os.strerror(fault))
        self.sent.append(json.loads(message))


@pytest.mark.parametrize("fault", [errno.EMSGSIZE, errno.ENOBUFS])
def test_a_report_that_the_kernel_refuses_is_dropped_and_the_next_one_has_everything(fault, caplog):
    caplog.set_level(logging.INFO)
    channel = Channel(fault, fault)
    worker = _Worker(Setup(settings=Perception(), site=SITE), channel)
    for time_s in (1.0, 2.0, 3.0):
        worker._send(PerceptionReport(time_s=time_s, solids=(SOLID,)))
    (report,) = channel.sent
    assert report["time_s"] == 3.0
    assert len(report["solids"]) == 1
    (line,) = caplog.messages
    assert line.endswith(f" dropped: {os.strerror(fault)}")


def test_a_service_that_has_ended_ends_the_process():
    worker = _Worker(Setup(settings=Perception(), site=SITE), Channel(errno.EPIPE))
    worker._send(PerceptionReport(time_s=1.0))
    assert worker._ended.is_set()
