#!/usr/bin/env python3
"""Receives the webhooks of a farm: checks each call's signature, and prints a line for each job that has
ended.

    webhook_receiver.py SECRET_FILE [PORT]

SECRET_FILE is webhook.secret of the coordinator's data folder, or what --webhook-secret names. It listens on
this machine only; a web server with TLS stands before it.
"""

import hashlib
import hmac
import http.server
import json
import pathlib
import sys
import time

MAX_AGE_SECONDS = 300
MAX_BYTES = 65536


def is_genuine(secret, headers, body, now):
    """Whether the farm has sent this, and not long ago."""
    timestamp = headers.get("X-Lumifold-Timestamp", "")
    signed = f"{timestamp}.".encode() + body
    signature = "sha256=" + hmac.new(secret, signed, hashlib.sha256).hexdigest()
    if not hmac.compare_digest(signature, headers.get("X-Lumifold-Signature", "")):
        return False
    return abs(now - int(timestamp)) <= MAX_AGE_SECONDS


class Receiver(http.server.BaseHTTPRequestHandler):
    secret = b""
    seen = set()  # deliveries; a message may come again

    def do_POST(self):
        body = self.rfile.read(min(int(self.headers.get("Content-Length", 0)), MAX_BYTES))
        self.send_response(self.take(body))
        self.end_headers()

    def take(self, body):
        """The status that answers a call: with 2xx the farm does not call again."""
        if not is_genuine(self.secret, self.headers, body, time.time()):
            return 403
        message = json.loads(body)
        if message["delivery_id"] not in self.seen:
            self.seen.add(message["delivery_id"])
            self.ended(message)
        return 204

    def ended(self, message):
        print(message["job_id"], message["state"], message["name"], message["error"], flush=True)

    def log_message(self, *_):
        pass


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    Receiver.secret = pathlib.Path(sys.argv[1]).read_bytes().split(b"\n")[0].strip()
    port = int(sys.argv[2]) if len(sys.argv) > 2 else 8080
    server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Receiver)
    print(f"listening on {server.server_port}", flush=True)
    server.serve_forever()
