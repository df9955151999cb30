"""A desk on two links; the orders that it carried out and its answers."""

from __future__ import annotations

from moar_companion.settings.link_config import LinkConfig, LinkRole

from .desk import LINK, Desk

OPERATOR_LINK = "udp:127.0.0.1:14550"
LINKS = (LinkConfig(url=LINK), LinkConfig(url=OPERATOR_LINK, role=LinkRole.OPERATOR))


def hovering(**options):
    return Desk(links=LINKS, **options).come_to("idle")


def carried_out(desk):
    return [order["order"] for order in desk.decided("order")]


def answers(desk):
    """Every answer: (link, system and component of the addressee, command, result)."""
    return [
        (link, (ack.target_system, ack.target_component), ack.command, ack.result)
        for _, link, ack in desk.sent
        if ack.get_type() == "COMMAND_ACK"
    ]


def results(desk):
    return [result for *_, result in answers(desk)]
