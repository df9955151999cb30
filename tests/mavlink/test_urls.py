from __future__ import annotations

import pytest

from moar_companion.errors import InputError
from moar_companion.mavlink.urls import LinkAddress, LinkKind, parse_url


def udp_listen(host, port):
    return LinkAddress(kind=LinkKind.UDP_LISTEN, host=host, port=port)


def udp_send(host, port):
    return LinkAddress(kind=LinkKind.UDP_SEND, host=host, port=port)


def tcp(host, port):
    return LinkAddress(kind=LinkKind.TCP, host=host, port=port)


def serial(device, baud):
    return LinkAddress(kind=LinkKind.SERIAL, device=device, baud=baud)


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("udp:127.0.0.1:14540", udp_listen("127.0.0.1", 14540)),
        ("udpin:0.0.0.0:14540", udp_listen("0.0.0.0", 14540)),
        ("udpout:drone.local:14550", udp_send("drone.local", 14550)),
        ("tcp:localhost:5760", tcp("localhost", 5760)),
        ("serial:/dev/ttyTHS1:921600", serial("/dev/ttyTHS1", 921600)),
        ("udp://:14540", udp_listen("0.0.0.0", 14540)),
        ("udpin://0.0.0.0:14540", udp_listen("0.0.0.0", 14540)),
        ("udpout://192.168.1.2:14550", udp_send("192.168.1.2", 14550)),
        ("tcpout://127.0.0.1:5760", tcp("127.0.0.1", 5760)),
        ("serial:///dev/ttyACM0:57600", serial("/dev/ttyACM0", 57600)),
        ("UDP:127.0.0.1:14540", udp_listen("127.0.0.1", 14540)),
        ("udp:[::1]:14540", udp_listen("::1", 14540)),
        (
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0:57600",
            serial("/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0-port0", 57600),
        ),
    ],
)
def test_urls_of_the_contract_and_of_mavsdk_are_read(url, address):
    assert parse_url(url) == address
    assert parse_url(str(address)) == address


@pytest.mark.parametrize(
    ("url", "why"),
    [
        ("", "is not a link"),
        ("14540", "is not a link"),
        ("http://localhost:80", "is not a link"),
        ("tcpin://0.0.0.0:5760", "is not a link"),
        ("udp:127.0.0.1", "has no port"),
        ("udp:127.0.0.1:", "has no port"),
        ("udp:127.0.0.1:abc", "has no port"),
        ("udp:127.0.0.1:-1", "has no port"),
        ("udp:127.0.0.1:0", "not in 1 to 65535"),
        ("udp:127.0.0.1:70000", "not in 1 to 65535"),
        ("udp:127.0.0.1:14540:14550", "more than one port"),
        ("udp:::1:14540", "IPv6 address without brackets"),
        ("tcp::5760", "names no host"),
        ("udpout://:14550", "names no host"),
        ("serial:/dev/ttyACM0", "has no baud rate"),
        ("serial:/dev/ttyACM0:0", "has the baud rate 0, which is not in"),
        ("serial::57600", "names no device"),
    ],
)
def test_any_other_url_is_refused_in_one_line_with_the_allowed_forms(url, why):
    with pytest.raises(InputError) as refused:
        parse_url(url, source="companion.yaml", key="links[0].url")
    text = str(refused.value)
    assert text.startswith(f"companion.yaml: links[0].url: {url!r} ")
    assert why in text
    assert "udpout:HOST:PORT" in text
    assert "\n" not in text
    assert (refused.value.source, refused.value.key) == ("companion.yaml", "links[0].url")


def test_an_error_names_the_command_line_as_source_by_default():
    with pytest.raises(InputError, match=r"^--connect: 'x'"):
        parse_url("x")
