"""Addresses to listen to."""

import socket

import pytest

from gda_tracker.errors import UserError
from gda_tracker.io.asterix.udp import UdpSocket, is_udp, parse_udp


def test_addresses():
    assert parse_udp("udp://127.0.0.1:8600") == ("127.0.0.1", 8600, "0.0.0.0")
    assert parse_udp("udp://0.0.0.0:1") == ("0.0.0.0", 1, "0.0.0.0")
    group = "udp://239.1.2.3:8600?interface=10.0.0.7"
    assert parse_udp(group) == ("239.1.2.3", 8600, "10.0.0.7")
    assert is_udp(group)
    assert not is_udp("/radar/points")


@pytest.mark.parametrize(
    "url",
    [
        "udp://127.0.0.1",
        "udp://127.0.0.1:0",
        "udp://127.0.0.1:70000",
        "udp://127.0.0.1:x",
        "udp://radar:8600",
        "udp://:8600",
        "udp://127.0.0.1:8600/x",
        "udp://239.1.2.3:8600?interface",
        "udp://239.1.2.3:8600?interface=eth0",
        "udp://239.1.2.3:8600?ttl=1",
        "udp://[::1]:8600",
        "tcp://127.0.0.1:8600",
    ],
)
def test_what_is_no_address(url):
    with pytest.raises(UserError, match="allowed is udp://HOST:PORT"):
        parse_udp(url)


def test_datagrams_come_in_order_and_an_address_is_taken_once():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
        with pytest.raises(UserError, match="Address already in use"):
            UdpSocket(f"udp://127.0.0.1:{port}")
    listening = UdpSocket(f"udp://127.0.0.1:{port}")
    assert list(listening.waiting()) == []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        for number in range(50):
            one.sendto(bytes([number]) * 1400, ("127.0.0.1", port))
    found = list(listening.waiting())
    assert [payload[0] for payload in found] == list(range(50))
    listening.close()


def test_an_address_of_another_host():
    with pytest.raises(UserError, match=r"udp://192\.0\.2\.1:8600: Cannot assign"):
        UdpSocket("udp://192.0.2.1:8600")
