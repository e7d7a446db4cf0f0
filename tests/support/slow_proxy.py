"""A TCP proxy that forwards at a limited rate, for tests of slow networks and slow readers."""

import socket
import threading
import time


class SlowProxy:
    """Forwards connections to a server and counts the bytes. A rate of None is not limited."""

    TURN_BYTES = 64 << 10
    TURN_SECONDS = 0.2  # at most, at a low rate
    SMALLEST_BUFFER = 4096  # the kernel rounds it up

    def __init__(self, server_address, upload_bytes_per_second=None, download_bytes_per_second=None):
        host, port = server_address.rsplit(":", 1)
        self.server = (host, int(port))
        self.upload_rate = upload_bytes_per_second
        self.download_rate = download_bytes_per_second
        self.sent_bytes = 0  # to the server
        self.received_bytes = 0  # from the server
        self.connections = []
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.listener.getsockname()[1]}"
        threading.Thread(target=self.accept, daemon=True).start()

    def connect(self):
        server = socket.socket()
        if self.download_rate:
            # Otherwise the kernel reads megabytes ahead of us.
            server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, self.SMALLEST_BUFFER)
        server.connect(self.server)
        return server

    def accept(self):
        while True:
            try:
                client, _ = self.listener.accept()
            except OSError:  # closed
                return
            try:
                server = self.connect()
            except OSError:  # no coordinator
                client.close()
                continue
            self.connections += [client, server]
            threading.Thread(target=self.forward, args=(client, server, True), daemon=True).start()
            threading.Thread(target=self.forward, args=(server, client, False), daemon=True).start()

    def forward(self, source, target, is_upload):
        rate = self.upload_rate if is_upload else self.download_rate
        turn = self.TURN_BYTES if rate is None else max(1, min(self.TURN_BYTES, int(rate *
                                                                                    self.TURN_SECONDS)))
        try:
            while data := source.recv(turn):
                target.sendall(data)
                if is_upload:
                    self.sent_bytes += len(data)
                else:
                    self.received_bytes += len(data)
                if rate:
                    time.sleep(len(data) / rate)
        except OSError:
            pass
        for end in (source, target):
            try:
                end.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass

    def close(self):
        for end in [self.listener, *self.connections]:
            end.close()
