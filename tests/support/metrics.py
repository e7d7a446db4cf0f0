"""What our programs show to Prometheus."""

import contextlib
import re
import socket

from farm import wait_until

GET = b"GET /metrics HTTP/1.1\r\nHost: farm\r\nConnection: close\r\n\r\n"


def address_of(process):
    """Where a coordinator or worker shows its metrics, by its log."""
    found = wait_until(lambda: re.search(r"event=metrics address=(\S+):(\d+)", process.log_text()),
                       "the endpoint")
    return found[1], int(found[2])


def ask(address, request, finish=True):
    """Sends bytes, and returns all that comes back until the other end closes."""
    with socket.create_connection(address, timeout=60) as connection:
        connection.sendall(request)
        if finish:
            connection.shutdown(socket.SHUT_WR)
        answer = b""
        with contextlib.suppress(ConnectionError):
            while data := connection.recv(65536):
                answer += data
        return answer


def scrape(address):
    """The text of the metrics."""
    head, _, body = ask(address, GET, finish=False).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 200 OK\r\n"), head
    assert int(re.search(rb"Content-Length: (\d+)", head)[1]) == len(body)
    return body.decode()


def samples(text):
    """Values by name with labels."""
    return {line.rsplit(" ", 1)[0]: float(line.rsplit(" ", 1)[1])
            for line in text.splitlines() if not line.startswith("#")}


def figures_of(address, condition, what):
    """The samples, once they meet the condition; the endpoint may repeat figures of a second ago."""
    return wait_until(lambda: condition(found := samples(scrape(address))) and found, what, seconds=120)
