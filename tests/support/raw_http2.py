"""Just enough of HTTP/2 to break its rules: a client that opens streams and ignores what the server
allows."""

import socket
import struct

PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, RST_STREAM, SETTINGS, PING, GOAWAY = 0, 1, 3, 4, 6, 7
ACK, END_STREAM, END_HEADERS = 1, 1, 4


def frame(kind, flags, stream, payload=b""):
    return struct.pack(">I", len(payload))[1:] + struct.pack(">BBI", kind, flags, stream) + payload


def literal(name, value):
    """A header that needs no table; names and values are shorter than 127 bytes."""
    return b"\x10" + bytes([len(name)]) + name.encode() + bytes([len(value)]) + value.encode()


def headers_of(path, *more):
    fields = ((":method", "POST"), (":scheme", "http"), (":path", path), (":authority", "farm"),
              ("content-type", "application/grpc"), ("te", "trailers"), *more)
    return b"".join(literal(name, value) for name, value in fields)


def message(payload):
    """A message of gRPC."""
    return b"\0" + struct.pack(">I", len(payload)) + payload


class RawConnection:
    """One connection, from the address `source`. It keeps to no limit of streams; without `polite` it does
    not even say that it has seen the server's settings."""

    def __init__(self, address, source="", timeout=10, polite=True):
        host, port = address.rsplit(":", 1)
        self.polite = polite
        self.socket = socket.create_connection((host, int(port)), timeout, source_address=(source, 0))
        self.socket.sendall(PREFACE + frame(SETTINGS, 0, 0))
        self.buffer = b""
        self.next_stream = 1

    def open_stream(self, path, payload=b"", end=True):
        """Begins a call; returns its number."""
        stream, self.next_stream = self.next_stream, self.next_stream + 2
        data = message(payload)
        self.socket.sendall(frame(HEADERS, END_HEADERS, stream, headers_of(path)) +
                            frame(DATA, END_STREAM if end else 0, stream, data))
        return stream

    def frames(self):
        """(kind, flags, stream, payload) of all frames until the server closes the connection or says nothing
        for long."""
        while True:
            try:
                more = self.socket.recv(1 << 16)
            except (TimeoutError, OSError):
                return
            if not more:
                return
            self.buffer += more
            while len(self.buffer) >= 9:
                size = int.from_bytes(self.buffer[:3], "big")
                if len(self.buffer) < 9 + size:
                    break
                kind, flags, stream = self.buffer[3], self.buffer[4], int.from_bytes(self.buffer[5:9],
                                                                                     "big") & 0x7FFFFFFF
                payload, self.buffer = self.buffer[9:9 + size], self.buffer[9 + size:]
                if kind == SETTINGS and not flags & ACK and self.polite:
                    self.send(frame(SETTINGS, ACK, 0))
                if kind == PING and not flags & ACK:
                    self.send(frame(PING, ACK, 0, payload))
                yield kind, flags, stream, payload

    def send(self, data):
        try:
            self.socket.sendall(data)
        except OSError:
            pass  # it is closed, as the reader will see

    def close(self):
        self.socket.close()
