"""Datagrams from the network: a socket for an address, one of this host or of a multicast group."""

from __future__ import annotations

import ipaddress
import socket
from collections.abc import Iterator
from urllib.parse import urlsplit

from gda_tracker.errors import UserError

PREFIX = "udp://"
# A radar sends its sector of plots at once: room for some seconds, as far as the system allows.
RECEIVE_BUFFER_BYTES = 4 << 20
LONGEST_DATAGRAM = 65_535
# Datagrams of one look, so that a flood does not keep a node from its other work.
MOST_AT_ONCE = 2000


def is_udp(name: str) -> bool:
    """Whether an input is an address and not a topic or file."""
    return name.startswith(PREFIX)


def parse_udp(url: str) -> tuple[str, int, str]:
    """Return host, port and interface of ``udp://HOST:PORT`` or ``udp://GROUP:PORT?interface=IP``.

    Raises
    ------
    UserError
        If it is something else.
    """
    parts = urlsplit(url)
    try:
        host, port = parts.hostname, parts.port
        key, sign, interface = parts.query.partition("=")
        if parts.query and (key != "interface" or not sign):
            raise ValueError
        ipaddress.IPv4Address(host or "")
        ipaddress.IPv4Address(interface or "0.0.0.0")
    except ValueError:
        host = port = None
    if not is_udp(url) or parts.path or host is None or not port:
        raise UserError(
            f"{url}: allowed is udp://HOST:PORT with an IPv4 address, 0.0.0.0 for all of this "
            "host; for a multicast group also udp://GROUP:PORT?interface=ADDRESS"
        )
    return host, port, interface or "0.0.0.0"


class UdpSocket:
    """Listens to an address; a multicast group is joined.

    Several sockets may listen to one group; to an address of this host only one.

    Raises
    ------
    UserError
        If the address is not allowed, is none of this host, or is taken.
    """

    def __init__(self, url: str) -> None:
        host, port, interface = parse_udp(url)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            if ipaddress.IPv4Address(host).is_multicast:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                self._socket.bind((host, port))
                membership = socket.inet_aton(host) + socket.inet_aton(interface)
                self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
            else:
                self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise UserError(f"{url}: {error.strerror}") from error

    def waiting(self) -> Iterator[bytes]:
        """Yield the datagrams that have come, at most so many that others get their turn."""
        for _ in range(MOST_AT_ONCE):
            try:
                yield self._socket.recv(LONGEST_DATAGRAM)
            except BlockingIOError:
                return

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()
