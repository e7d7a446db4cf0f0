"""A real browser for tests: Debian's Chromium, driven by the W3C WebDriver protocol."""

import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
import urllib.error
import urllib.request

ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # of the protocol
PATIENCE_SECONDS = 300
KEYS = {"escape": "\ue00c", "enter": "\ue007", "tab": "\ue004"}


def missing():
    """Why there is no browser here; empty if there is one."""
    return "" if shutil.which("chromedriver") and shutil.which(
        "chromium") else "chromium and chromium-driver are not installed"


class Browser(contextlib.AbstractContextManager):
    """A headless browser with one window, and a profile that goes with it."""

    def __init__(self, width=1280, height=800, *arguments):
        self.profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self.driver = subprocess.Popen(["chromedriver", "--port=0"],
                                       stdout=subprocess.PIPE,
                                       stderr=subprocess.DEVNULL,
                                       text=True)
        port = next(
            line.split(" on port ")[1].strip().rstrip(".")
            for line in self.driver.stdout
            if "started successfully on port" in line)
        self.url = f"http://127.0.0.1:{port}/session"
        options = {
            "binary": shutil.which("chromium"), "args": [
                "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                f"--user-data-dir={self.profile.name}", f"--window-size={width},{height}", *arguments
            ]
        }
        answer = self.send(
            "POST", "", {
                "capabilities": {
                    "alwaysMatch": {
                        "goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"},
                        "acceptInsecureCerts": True
                    }
                }
            })
        self.url += "/" + answer["sessionId"]

    def send(self, method, path, body=None):
        request = urllib.request.Request(self.url + path,
                                         method=method,
                                         data=None if body is None else json.dumps(body).encode(),
                                         headers={"Content-Type": "application/json"})
        try:
            with urllib.request.urlopen(request, timeout=PATIENCE_SECONDS) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as error:
            raise AssertionError(json.load(error)["value"]["message"]) from error

    def go(self, url):
        self.send("POST", "/url",
                  {"url": "about:blank"})  # another fragment alone would not load the page again
        self.send("POST", "/url", {"url": url})

    def reload(self):
        self.send("POST", "/refresh", {})

    def run(self, script, *arguments):
        """The value of a script, which ends with `return`."""
        return self.send("POST", "/execute/sync", {"script": script, "args": list(arguments)})

    def find(self, css):
        return self.send("POST", "/element", {"using": "css selector", "value": css})[ELEMENT]

    def click(self, css):
        self.send("POST", f"/element/{self.find(css)}/click", {})

    def type(self, css, text):
        self.send("POST", f"/element/{self.find(css)}/value", {"text": KEYS.get(text, text)})

    def text(self, css):
        """What is seen of the first element; empty without one."""
        return self.run("return document.querySelector(arguments[0])?.innerText ?? ''", css)

    def wait(self, script, what, *arguments, seconds=PATIENCE_SECONDS):
        """Waits until a script's value is true, and returns it."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            if value := self.run(script, *arguments):
                return value
            time.sleep(0.05)
        raise AssertionError(
            f"{what}: not within {seconds} s; the page says:\n{self.text('body')[:2000]}\n{self.log()}")

    def wait_text(self, css, text, **options):
        self.wait("return (document.querySelector(arguments[0])?.innerText ?? '').includes(arguments[1])",
                  f"{text!r} in {css}", css, text, **options)

    def log(self):
        """The errors on the console since the last call."""
        return [
            entry["message"]
            for entry in self.send("POST", "/se/log", {"type": "browser"})
            if entry["level"] == "SEVERE"
        ]

    def resize(self, width, height):
        self.send("POST", "/window/rect", {"width": width, "height": height})

    def screenshot(self, path):
        with open(path, "wb") as file:
            file.write(base64.b64decode(self.send("GET", "/screenshot")))

    def __exit__(self, *_):
        with contextlib.suppress(Exception):
            self.send("DELETE", "")
        self.driver.terminate()
        self.driver.wait()
        self.profile.cleanup()
