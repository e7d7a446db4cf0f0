"""The interface of the status page, as its own script in a browser uses it."""

import gzip
import http.client
import json
import ssl
import struct
import urllib.parse


class PageLink:
    """A link of `lumifold page`."""

    def __init__(self, url, ca=None):
        parts = urllib.parse.urlsplit(url)
        self.host, self.port = parts.hostname, parts.port
        self.fragment = dict(urllib.parse.parse_qsl(parts.fragment))
        self.session = self.fragment["session"]
        self.tls = parts.scheme == "https" and ssl.create_default_context(cafile=ca)

    def connect(self, timeout=30):
        if self.tls:
            return http.client.HTTPSConnection(self.host, self.port, context=self.tls, timeout=timeout)
        return http.client.HTTPConnection(self.host, self.port, timeout=timeout)

    def request(self, method, path, body=None, **headers):
        """Status, headers and bytes of an answer. Headers with the value None are left out; `_` in their
        names is a dash."""
        sent = {
            "Authorization": f"Bearer {self.session}",
            **({"Content-Type": "application/json"} if body is not None else {}),
            **{name.replace("_", "-"): value for name, value in headers.items()}
        }
        connection = self.connect()
        try:
            connection.request(method, path, body,
                               {name: value for name, value in sent.items() if value is not None})
            answer = connection.getresponse()
            return answer.status, answer.headers, answer.read()
        finally:
            connection.close()

    def call(self, method, **request):
        """Status and answer of a call of FarmService."""
        status, _, body = self.request("POST", f"/api/call/{method}", json.dumps(request))
        return status, json.loads(body)

    def preview(self, job, frame=0, layer="", newer=0, **more):
        """The description of a preview and its bytes; None if there is nothing newer."""
        query = urllib.parse.urlencode({"job": job, "frame": frame, "layer": layer, "newer": newer, **more})
        status, headers, body = self.request("GET", f"/api/preview?{query}")
        if status == 204:
            return None
        assert status == 200 and headers["Content-Encoding"] == "gzip", (status, body)
        content = gzip.decompress(body)
        length, = struct.unpack("<I", content[:4])
        return json.loads(content[4:4 + length]), content[4 + length:]

    def events(self):
        """Name and value of each event, until the stream ends."""
        connection = self.connect()
        try:
            connection.request("GET", "/api/events", headers={"Authorization": f"Bearer {self.session}"})
            answer = connection.getresponse()
            assert answer.status == 200, answer.status
            name = None
            for line in answer:
                key, _, value = line.decode().rstrip("\n").partition(": ")
                if key == "event":
                    name = value
                elif key == "data":
                    yield name, json.loads(value)
        finally:
            connection.close()
