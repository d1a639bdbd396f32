"""The addresses of a server: the sockets that it listens on, and how others reach it."""

import ipaddress
import socket

from calib.errors import InputError, brief


def open_sockets(host: str, port: int, option: str = "--port") -> list[socket.socket]:
    """Open a listening socket for every address that a name stands for; InputError if an address
    cannot be used.

    Args:
        option: the option for another port, as the message names it.
    """
    sockets: list[socket.socket] = []
    try:
        for family, kind, protocol, _, address in socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        ):
            sockets.append(socket.socket(family, kind, protocol))
            sockets[-1].setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                sockets[-1].setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            sockets[-1].bind(address)
            sockets[-1].listen()
    except (OSError, UnicodeError, OverflowError) as error:
        for opened in sockets:
            opened.close()
        why = error.strerror if isinstance(error, OSError) else "not an address"
        raise InputError(
            f"{brief(host)}:{port} cannot be served on ({why}): choose another --host or {option}."
        ) from error
    return sockets


def reachable_address(host: str) -> str:
    """Return the address by which others reach this machine if it serves on all its addresses; its
    name if it is in no network.

    Nothing is sent: a connected datagram socket knows from which of its addresses it would send.
    192.0.2.1 and 2001:db8::1 belong to nobody (RFC 5737, RFC 3849).
    """
    try:
        if not ipaddress.ip_address(host).is_unspecified:
            return host
        is_ipv4 = ":" not in host
        with socket.socket(
            socket.AF_INET if is_ipv4 else socket.AF_INET6, socket.SOCK_DGRAM
        ) as probe:
            probe.connect(("192.0.2.1" if is_ipv4 else "2001:db8::1", 9))
            return str(probe.getsockname()[0])
    except ValueError:  # the host is a name
        return host
    except OSError:
        return socket.gethostname()


def is_loopback(host: str) -> bool:
    """Return True if only this machine reaches the address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
