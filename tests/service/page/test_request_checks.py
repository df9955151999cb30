"""Requests that are answered, and those of other sites and hosts that are not."""

from __future__ import annotations

import pytest

from moar_companion.service.page.request_checks import has_token, host_refusal, origin_refusal

OWN = "127.0.0.1:8195"


@pytest.mark.parametrize(
    "host",
    [OWN, "localhost", "localhost:1", "LOCALHOST.:9", "10.0.0.2", "[::1]:8195", "drone-1:8195"],
)
def test_addresses_localhost_and_named_hosts_are_answered(host):
    assert host_refusal(host, {"drone-1"}) is None


@pytest.mark.parametrize(
    "host",
    [
        *("evil.example", "evil.example:8195", "drone-1.evil.example", "localhost.evil.example"),
        *("127.0.0.1.evil.example", "127.1", "2130706433", "a@127.0.0.1", "[::1", "1:2:3:4"),
        *("", None),
    ],
)
def test_a_name_that_only_leads_to_this_computer_is_refused(host):
    """DNS rebinding: the name is another site's, the address ours."""
    assert host_refusal(host, {"drone-1"}) is not None


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"origin": f"http://{OWN}"},
        {"origin": f"https://{OWN}"},  # behind a proxy with TLS
        {"sec-fetch-site": "same-origin", "origin": f"http://{OWN}"},
        {"sec-fetch-site": "none", "sec-fetch-mode": "navigate"},
    ],
)
def test_requests_of_the_page_itself_are_answered(headers):
    assert origin_refusal({"host": OWN, **headers}, navigates=False) is None


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:8080"},  # another program of this computer
        {"origin": f"http://{OWN}.evil.example"},
        {"origin": ""},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"},
    ],
)
def test_requests_of_other_sites_are_refused(headers):
    assert origin_refusal({"host": OWN, **headers}, navigates=False) is not None


def test_a_link_elsewhere_may_open_the_page_but_nothing_may_load_it():
    link = {"host": OWN, "sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate"}
    assert origin_refusal(link, navigates=True) is None
    assert origin_refusal(link | {"sec-fetch-mode": "no-cors"}, navigates=True) is not None


@pytest.mark.parametrize(
    ("authorization", "right"),
    [
        ("Bearer a-token-of-the-page", True),
        ("Bearer a-token-of-the-pag", False),
        ("Bearer a-token-of-the-page ", False),
        ("bearer a-token-of-the-page", False),
        ("a-token-of-the-page", False),
        ("Bearer ä", False),
        ("", False),
        (None, False),
    ],
)
def test_the_token_is_taken_as_it_is_and_nothing_like_it(authorization, right):
    assert has_token(authorization, "a-token-of-the-page") == right
