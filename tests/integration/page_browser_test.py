"""The status page in a real browser, with a real coordinator and workers behind it."""

import hashlib
import os
import pathlib
import secrets
import sys
import tempfile
import unittest

import browser
from farm import Farm, make_scene, wait_until
from page_link import PageLink
from page_test import HOSTILE, LONG

sys.path.append(str(pathlib.Path(__file__).parents[1] / "deploy"))
import node_tools  # noqa: E402

SCREENSHOTS = os.environ.get("LUMIFOLD_SCREENSHOTS")

# Mean of the pixels that the canvas shows, of 255.
BRIGHTNESS = """(() => {
  const canvas = document.getElementById("canvas");
  if (!canvas.width) return 0;
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let sum = 0;
  for (let i = 0; i < pixels.length; i += 4) sum += pixels[i] + pixels[i + 1] + pixels[i + 2];
  return sum / (pixels.length / 4) / 3;
})()"""

# Of a pixel of the part that is shown at full resolution.
COLOUR = "return [...document.querySelector('#pieces canvas').getContext('2d').getImageData(arguments[0], arguments[1], 1, 1).data].slice(0, 3)"

# A of a canvas: in its corner, and in its middle.
ALPHAS = """
  const canvas = document.querySelector(arguments[0]);
  const alphaAt = (x, y) => canvas.getContext("2d").getImageData(x, y, 1, 1).data[3];
  return [alphaAt(0, 0), alphaAt(canvas.width >> 1, canvas.height >> 1)];
"""

# What is fetched as a file: its type, size and first bytes. The browser of the tests saves none.
SAVED = """
window.saved = null;
URL.createObjectURL = (blob) => {
  window.blob = blob; // the page's policy lets no script fetch its URL
  return "blob:of-the-test";
};
HTMLAnchorElement.prototype.click = async function () {
  const answer = this.href.startsWith("blob:") ? new Response(window.blob) : await fetch(this.href);
  const bytes = new Uint8Array(await answer.arrayBuffer());
  window.saved = [answer.status, answer.headers.get("Content-Type"), bytes.length, [...bytes.slice(0, 8)], this.download
    || answer.headers.get("Content-Disposition")];
};
[...document.querySelectorAll("#save button")].find((each) => each.innerText === arguments[0]).click();
return true;
"""


@unittest.skipIf(why := browser.missing(), why)
class PageBrowserTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = pathlib.Path(cls.enterClassContext(tempfile.TemporaryDirectory()))
        cls.scene = make_scene("cornell-box", cls.root)
        cls.browser = cls.enterClassContext(browser.Browser())

    def setUp(self):
        self.farm = self.enterContext(
            Farm(self.enterContext(tempfile.TemporaryDirectory()), "--page-address", "127.0.0.1:0"))
        self.browser.go(
            "about:blank")  # a page of the test before would go on asking for a server that is gone
        self.browser.log()

    def submit(self, *settings):
        return self.farm.client("submit", self.scene, *settings).stdout.strip()

    def submit_broken(self, user="anonymous"):
        """A job that fails: over HTTP, since the client would see what is wrong. The farm has the scene."""
        content = self.scene.read_bytes()
        spec = {"scene": {"file": {"sha256": hashlib.sha256(content).hexdigest(), "size": len(content)}},
                "camera": "no such camera", "width": 64, "height": 64, "frame_count": 1, "samples_per_pixel": 1}
        link = PageLink(self.farm.client("page").stdout.strip())
        status, answer = link.call("SubmitJob", spec=spec, request_id=secrets.token_hex(16), scheduling={"user": user})
        self.assertEqual(status, 200, answer)
        return answer["job_id"]

    def open(self, *arguments):
        self.browser.go(self.farm.client("page", *arguments).stdout.strip())

    def shoot(self, name):
        if SCREENSHOTS:
            self.browser.screenshot(pathlib.Path(SCREENSHOTS) / f"{name}.png")

    def expect_no_errors(self):
        self.assertEqual(self.browser.log(), [])

    def test_a_picture_grows_and_is_finished(self):
        self.open()
        self.browser.wait_text("#connection", "connected")
        self.assertNotIn("session", self.browser.run("return location.href"),
                         "the secret leaves the address bar")
        job = self.submit("--size", "640x480", "--spp", 64)
        self.browser.wait_text("#job-state", "submitted")  # the newest opens by itself
        self.assertIn(job, self.browser.run("return location.hash"))
        self.browser.wait_text("#notice", "none of the 0 connected workers")
        self.assertIn("lumifold-worker", self.browser.text("#notice"), "what to do")
        self.shoot("waits")
        for _ in range(2):
            self.farm.start_worker()
        self.browser.wait(f"return {BRIGHTNESS} > 0", "the first tiles", seconds=300)
        self.shoot("grows")
        first = self.browser.run(f"return {BRIGHTNESS}")
        self.browser.wait_text("#job-state", "done", seconds=300)
        wait_until(lambda: self.browser.run(f"return {BRIGHTNESS}") != first,
                   "another picture: no tile has the colours of those around any more",
                   seconds=60)
        self.browser.wait("return document.querySelector('#pieces canvas')?.width === 640", "all pixels", seconds=300)
        red, green, blue = wait_until(lambda: any(colour := self.browser.run(COLOUR, 120, 240)) and colour,
                                      "its colours",
                                      seconds=60)
        self.assertGreater(red, 2 * max(green, blue), "the wall on the left is red")
        self.shoot("done")
        self.browser.type("body", "+++")
        self.browser.wait("return document.querySelector('#pieces canvas.pixels') !== null", "its pixels")
        self.shoot("close")
        self.browser.type("body", "0")
        self.browser.click("#theme")
        self.browser.type("body", "c")
        self.shoot("compare")
        for layer in ("albedo", "N", "Z", "id", "noisy"):
            self.browser.run(
                "const s = document.getElementById('layer-a'); s.value = arguments[0]; s.dispatchEvent(new Event('change'));",
                layer)
            self.browser.wait(
                "return [...document.querySelectorAll('#layer-a option')].length > 8 && document.getElementById('layer-a').value"
                " === arguments[0] && document.getElementById('notice').hidden", layer, layer)
        self.expect_no_errors()

    def test_behind_a_transparent_picture_is_a_checkerboard(self):
        self.farm.start_worker()
        self.submit("--size", "640x160", "--spp", 4, "--ground", "shadow")
        self.open()
        self.browser.wait_text("#job-state", "done", seconds=300)
        self.browser.wait("return document.querySelector('#pieces canvas')?.width === 640", "all pixels", seconds=300)
        for canvas in ("#canvas", "#pieces canvas"):
            corner, middle = wait_until(lambda: (alphas := self.browser.run(ALPHAS, canvas))[1] and alphas, canvas)
            self.assertEqual((corner, middle), (0, 255), canvas)
            self.assertIn("conic-gradient", self.browser.run(
                "return getComputedStyle(document.querySelector(arguments[0])).backgroundImage", canvas))
        self.shoot("transparent")
        self.expect_no_errors()

    def test_files_and_links_leave_the_page(self):
        self.farm.start_worker()
        self.submit("--size", "800x96", "--spp", 2, "--frames", "1-2", "--name", "a chair/2.glb")
        self.open()
        self.browser.wait_text("#save", "PNG", seconds=300)
        for button, kind, start, name in (
            ("EXR", "image/x-exr", [0x76, 0x2f, 0x31, 0x01], 'attachment; filename="a_chair_2.0001.exr"'),
            ("All frames", "application/zip", list(b"PK\3\4"), 'attachment; filename="a_chair_2.zip"'),
            ("PNG", "image/png", list(b"\x89PNG"), "a chair/2.0001.png")):
            self.browser.wait_text("#save", button)
            self.browser.run(SAVED, button)
            status, saved_kind, size, first, saved_name = self.browser.wait("return window.saved", button)
            self.assertEqual((status, saved_kind, first[:len(start)], saved_name), (200, kind, start, name))
            self.assertGreater(size, 2000)
        self.browser.run("""
          Object.defineProperty(navigator, "clipboard", {value: {writeText: async (text) => (window.copied = text)}});
          [...document.querySelectorAll("#save button")].at(-1).click();""")
        link = self.browser.wait("return window.copied", "the link")
        self.browser.go(link)
        self.browser.wait_text("#user", "read only")
        self.browser.wait_text("#job-state", "done")
        self.assertEqual(self.browser.text("#job-actions"), "")
        self.expect_no_errors()

    def test_a_failure_says_what_to_do_and_a_job_is_deleted(self):
        self.farm.start_worker()
        self.farm.client("wait", self.submit("--size", "64x64", "--spp", 1))  # one that has delivered nothing is not believed
        job = self.submit_broken()
        self.open()
        self.browser.wait_text("#job-state", "failed", seconds=180)  # a lone worker is believed after a minute
        self.browser.wait_text("#notice", "no such camera")
        self.assertIn("submit it again", self.browser.text("#notice"))
        self.assertNotIn("Retry", self.browser.text("#job"), "it could not help")
        self.assertIn("no such camera", self.browser.text("#wrong"))
        self.browser.run(
            "[...document.querySelectorAll('#job-actions button')].find((each) => each.innerText === 'Delete').click()")
        self.browser.click("#ask-yes")
        self.browser.wait("return document.querySelectorAll('#jobs li').length === 1", "the other one")
        self.browser.wait_text("#job-state", "done")
        self.assertNotIn(job, self.farm.client("list").stdout)

    def test_many_jobs_are_searched_and_grouped(self):
        for i in range(3):
            self.submit("--size", "64x64", "--spp", 1, "--user", f"user-{i}", "--name", f"chair {i}")
        self.farm.client("cancel", self.submit("--size", "64x64", "--spp", 1, "--user", "user-0", "--name", "lamp"))
        self.open()
        self.browser.wait_text("#job-count", "4")
        self.browser.wait("return document.querySelectorAll('#jobs .group').length === 2", "active ones and today's")
        rows = "return [...document.querySelectorAll('#jobs li .texts .row .name')].map((each) => each.textContent)"
        self.assertEqual(self.browser.run(rows), ["chair 2", "chair 1", "chair 0", "lamp"])
        choose = "const s = document.querySelector(arguments[0]); s.value = arguments[1]; s.dispatchEvent(new Event('input'))"
        for element, value, expected in (("#of-user", "user-0", ["chair 0", "lamp"]), ("#of-state", "cancelled", ["lamp"]),
                                         ("#search", "chair", [])):
            self.browser.run(choose, element, value)
            self.assertEqual(self.browser.run(rows), expected, value)
        self.assertIn("No job is like that", self.browser.text("#jobs"))
        self.assertIn("0 of 4", self.browser.text("#job-count"))
        self.expect_no_errors()

    def test_frames_are_a_strip_that_plays(self):
        self.farm.start_worker()
        job = self.submit("--size", "64x48", "--spp", 4, "--frames", "1-3", "--fps", 24)
        self.open(job)
        self.browser.wait_text("#job-state", "done", seconds=120)
        self.browser.wait("return document.querySelectorAll('#strip canvas').length === 3", "three frames")
        self.browser.wait(
            "return [...document.querySelectorAll('#strip canvas')].every((each) => each.width === 64)",
            "their pictures, of their shape")
        for frame in (2, 3):
            self.browser.type("body", ".")
            self.browser.wait("return location.hash.endsWith(`frame=${arguments[0]}`)", f"frame {frame}",
                              frame)
        self.browser.click("#play")
        self.browser.wait("return !location.hash.endsWith('frame=3')", "another frame")
        self.browser.click("#play")
        self.expect_no_errors()

    def test_a_job_is_cancelled_with_a_question(self):
        self.farm.start_worker()
        job = self.submit(*LONG)
        self.open(job)
        self.browser.wait_text("#job-actions", "Cancel")
        cancel = "return [...document.querySelectorAll('#job-actions button')].find((each) => each.innerText === 'Cancel')?.click() ?? true"
        self.browser.run(cancel)
        self.browser.wait("return document.getElementById('ask').open", "the question")
        self.browser.click("#ask button[value='']")
        self.assertNotEqual(self.farm.status(job)["state"], "cancelled")
        self.browser.run(cancel)
        self.browser.click("#ask-yes")
        self.browser.wait_text("#job-state", "cancelled")
        self.assertEqual(self.farm.status(job)["state"], "cancelled")

    def test_a_lost_coordinator_comes_back(self):
        # A new one has a new secret without access control, so that the page says how to go on.
        job = self.submit("--size", "64x64", "--spp", 1)
        self.open(job)
        self.browser.wait_text("#connection", "connected")
        address = self.browser.run("return location.host")
        self.farm.server.stop()
        self.browser.wait_text("#connection", "connection lost")
        self.farm.start_server("--page-address", address, listen=self.farm.address)
        self.browser.wait_text("#problem", "lumifold page", seconds=120)
        self.open(job)
        self.browser.wait_text("#connection", "connected")
        self.browser.wait_text("#job-state", "submitted")

    def test_hostile_names_are_texts(self):
        self.farm.start_worker("--name", HOSTILE)
        job = self.submit(*LONG, "--user", HOSTILE)
        self.open(job)
        self.browser.wait_text("#jobs", HOSTILE[:20])
        self.browser.click("#farm-more summary")
        self.browser.wait_text("#workers", "script")
        self.assertEqual(self.browser.run("return document.querySelectorAll('script').length"), 1)
        self.browser.run(
            "document.body.insertAdjacentHTML('beforeend', '<img src=x onerror=\"window.bad = 1\">');")
        self.browser.wait("return !window.bad", "no script of others runs")
        self.assertTrue(any("Content Security Policy" in line for line in self.browser.log()))
        self.farm.client("cancel", job)

    def test_a_shared_link_has_no_buttons(self):
        job, other = self.submit("--size", "64x64", "--spp", 1), self.submit("--size", "64x64", "--spp", 1)
        self.open(job, "--share")
        self.browser.wait_text("#user", "read only")
        self.browser.wait_text("#job-state", "submitted")
        self.assertEqual(self.browser.text("#job-actions"), "")
        self.assertNotIn(other, self.browser.text("#jobs"))

    def expect_accessible(self, what):
        """axe-core finds nothing, on a desktop and on a phone, dark and light."""
        source = (node_tools.FOLDER / "node_modules/axe-core/axe.min.js").read_text()
        for width, height in ((1280, 800), (500, 844)):
            self.browser.resize(width, height)
            for theme in ("Light", "Dark"):
                self.browser.click("#theme")
                self.browser.wait_text("#theme", theme)
                self.browser.run(source + """; window.found = null;
                  axe.run(document).then((result) => (window.found = {violations: result.violations.map((one) =>
                    [one.id, one.nodes.map((node) => node.html)])}));""")
                found = self.browser.wait("return window.found", "axe-core", seconds=300)
                self.assertEqual(found["violations"], [], (what, width, theme))
        self.browser.resize(1280, 800)

    @unittest.skipUnless(node_tools.is_available(), "npm is not installed (deploy/setup.sh --tests)")
    def test_axe_core_finds_nothing(self):
        node_tools.install()
        self.open()
        self.browser.wait_text("#no-job", "No jobs yet")
        if self.browser.text("#theme") == "Light":  # what the button does; each look begins in the light
            self.browser.click("#theme")
        self.expect_accessible("no job")
        self.submit("--size", "64x48", "--spp", 2, "--frames", "1-2", "--fps", 24, "--user", "ann")
        self.browser.wait_text("#notice", "none of the 0 connected workers")
        self.expect_accessible("a job that waits")
        self.farm.start_worker()
        self.browser.wait_text("#save", "PNG", seconds=300)
        for details in ("#settings", "#explain", "#log", "#farm-more"):
            self.browser.run("document.querySelector(arguments[0]).open = true", details)
        self.browser.wait_text("#spec", "default")
        self.expect_accessible("an animation, and all that can be opened")
        job = self.submit_broken("ben")
        self.open(job)
        self.browser.wait_text("#notice", "no such camera", seconds=120)
        self.expect_accessible("a failure")

    def test_keys_and_small_screens(self):
        for i in range(2):
            self.submit("--size", "64x64", "--spp", 1, "--user", f"user-{i}")
        self.open()
        self.browser.wait_text("#job-count", "2")
        self.browser.wait_text("#job-state", "submitted")
        first = self.browser.run("return location.hash")
        self.browser.type("body", "j")
        self.browser.wait("return location.hash !== arguments[0]", "the next job", first)
        self.browser.type("body", "?")
        self.browser.wait("return document.getElementById('help').open", "the keys")
        self.browser.type("#help", "escape")
        self.browser.wait("return !document.getElementById('help').open", "closed")
        self.browser.resize(500, 844)
        self.browser.wait(
            "return document.documentElement.scrollWidth <= document.documentElement.clientWidth",
            "nothing is wider than the screen")
        self.shoot("phone")
        self.browser.resize(1280, 800)
        names = self.browser.run("""
          return [...document.querySelectorAll("button, input, select")].filter((each) => each.offsetParent &&
            !(each.innerText || each.getAttribute("aria-label") || each.labels?.length)).map((each) => each.outerHTML)"""
                                )
        self.assertEqual(names, [], "without a name for screen readers")
        self.expect_no_errors()


if __name__ == "__main__":
    unittest.main()
