"""What the pages under docs and the words of the sources must keep: links that exist, short paragraphs,
textbook words."""

import pathlib
import re
import subprocess
import unittest

ROOT = pathlib.Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("tests/**/*.md")])
MOST_WORDS = 180  # of a paragraph
MOST_IMAGE_BYTES = 300_000

SOURCE_FOLDERS = ("client", "filter", "proto", "server", "tests", "worker")
SOURCE_SUFFIXES = (".cc", ".h", ".proto")

# Names and phrases that textbook terms have replaced (docs/architecture.md has the glossary).
RETIRED_IN_SOURCES = (
    r"\buint64_t chance\b",  # random key
    r"\bwithout_size\b",  # is_delta
    r"\b(Departure|Arrival)\b",  # path segment, incident radiance
    r"\bOpenness\b|\bVeils?\b",  # alpha mode, transparent hits
    r"\bsuns_",  # directional lights
    r"\b(Unlikeness|Fewness|HasRival|mended|loud)\b",
    r"\b(MergedUnits?|UnitMerged|FrameMerged)\b",  # committed, assembled
    r"\bMETHODS'",
)
RETIRED_IN_PAGES = (
    r"\bworker/baselines\b",
    r"\btests/charts/sample_methods\b",
    r"ARCHITECTURE lets",
    r"[Tt]he specification asks",
    r"the issue's",
    r"\bMETHODS\b",
)

LINK = re.compile(r"\[(?P<text>[^\]]*)\]\((?P<target>[^)\s]+)\)")
FILE = re.compile(
    r"(?<![\w/.-])(?:client|deploy|docs|filter|proto|server|tests|worker)/[\w./-]*\.(?:h|cc|py|sh|md|proto|cmake)\b"
)
FUNCTION = re.compile(r"`(?P<name>[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*)`")


def prose(page):
    """The page's text with code blocks blanked, line by line."""
    text = re.sub(r"```.*?```",
                  lambda block: "\n" * block.group().count("\n"),
                  page.read_text(),
                  flags=re.DOTALL)
    return ["" if line.startswith("    ") else line for line in text.split("\n")]


def paragraphs(page):
    """Line number and words of each paragraph; an item of a list is one, tables and headings are none."""
    number, words = 0, []
    for i, line in enumerate([*prose(page), ""], start=1):
        line = line.strip()
        begins = re.match(r"([*+-]|\d+\.) ", line)
        ends = not line or line.startswith(("|", "#", "<!--"))
        if (begins or ends) and words:
            yield number, words
            words = []
        if ends:
            continue
        if not words:
            number = i
        words += line.split()


def marked(text, name):
    """The part of a page between <!-- name --> and <!-- /name -->."""
    return text.partition(f"<!-- {name} -->")[2].partition(f"<!-- /{name} -->")[0]


def anchor(heading):
    """The anchor that GitHub gives a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower().replace("`", "")).replace(" ", "-")


def anchors(page):
    return {anchor(line.lstrip("#").strip()) for line in prose(page) if line.startswith("#")}


def is_defined(name, text):
    """Whether the C++ text defines or declares a class or a function of this name, which may have its class
    before it."""
    *scope, last = name.split("::")
    if re.search(rf"^\s*(class|struct|enum class)\s+{last}\b", text, re.MULTILINE):
        return True
    if scope and re.search(rf"^[^\s/].*\b{scope[-1]}::{last}\(|^{scope[-1]}::{last}\(", text, re.MULTILINE):
        return True
    if scope and not re.search(rf"^\s*(class|struct)\s+{scope[-1]}\b", text, re.MULTILINE):
        return False
    # Calls are indented deeper than members, or have something other than a type before the name.
    return bool(re.search(rf"^( {{0,2}})(?!return\b)[A-Za-z_][^=.();/]*[\s*&]{last}\(", text, re.MULTILINE))


class Pages(unittest.TestCase):
    def test_links_exist(self):
        for page in PAGES:
            for number, line in enumerate(prose(page), start=1):
                for link in LINK.finditer(line):
                    target, _, fragment = link["target"].partition("#")
                    if re.match(r"[a-z]+:", target):
                        continue
                    with self.subTest(page=str(page.relative_to(ROOT)), line=number, link=link["target"]):
                        file = (page.parent / target).resolve() if target else page
                        self.assertTrue(file.exists(), f"{target} does not exist")
                        if fragment:
                            self.assertIn(fragment, anchors(file))

    def test_files_named_in_the_text_exist(self):
        for page in PAGES:
            for number, line in enumerate(page.read_text().split("\n"), start=1):
                for file in FILE.findall(line):
                    with self.subTest(page=str(page.relative_to(ROOT)), line=number):
                        self.assertTrue((ROOT / file).exists(), f"{file} does not exist")

    def test_tour_names_functions_that_are_there(self):
        tour = ROOT / "docs/tour.md"
        stops = 0
        for line in prose(tour):
            stops += bool(re.match(r"\*\*\d+\. ", line))
            for link in LINK.finditer(line):
                function = FUNCTION.fullmatch(link["text"])
                if function is None:
                    continue
                with self.subTest(link=link.group()):
                    self.assertTrue(is_defined(function["name"], (tour.parent / link["target"]).read_text()))
        self.assertEqual(stops, 15)

    def test_the_method_lists_the_stages_and_guides_of_the_code(self):
        denoise = ROOT / "filter/denoise"
        stages = {}
        for file in ("layer_stages.cc", "frame_stages.cc"):
            stages |= dict(
                re.findall(r'\.name = "([\w-]+)".*?\.header = "([^"]+)"', (denoise / file).read_text(),
                           re.DOTALL))
        guides = re.findall(r'\{"([\w-]+)",\s*"[^"]*",\s*\[\]\(Settings',
                            (denoise / "denoise.cc").read_text())
        self.assertTrue(stages and guides)
        page = (ROOT / "docs/method.md").read_text()
        row = re.compile(r"^\| `([\w-]+)` \|.*\(\.\./(\S+)\) \|$", re.MULTILINE)
        self.assertEqual(dict(row.findall(marked(page, "stages"))), stages)
        self.assertEqual([name for name, _ in row.findall(marked(page, "guides"))], guides)

    def test_paragraphs_are_short(self):
        for page in PAGES:
            for number, words in paragraphs(page):
                with self.subTest(page=str(page.relative_to(ROOT)), line=number):
                    self.assertLessEqual(len(words), MOST_WORDS)

    def kept_images(self, folder):
        """The PNG files that git keeps; charts write others beside their SVG."""
        listed = subprocess.run(["git", "ls-files", "-z", "--", f"{folder}/*.png"],
                                cwd=ROOT,
                                capture_output=True,
                                text=True)
        if listed.returncode != 0:
            self.skipTest(f"git does not say which files are kept: {listed.stderr.strip()}")
        return [ROOT / name for name in listed.stdout.split("\0") if name and (ROOT / name).exists()]

    def test_results_keep_no_png_and_images_are_small(self):
        self.assertEqual(self.kept_images("docs/results"), [])
        for file in self.kept_images("docs/images"):
            with self.subTest(image=file.name):
                self.assertLessEqual(file.stat().st_size, MOST_IMAGE_BYTES)


class Words(unittest.TestCase):
    def test_retired_words_do_not_come_back(self):
        sources = [file for folder in SOURCE_FOLDERS for file in sorted((ROOT / folder).rglob("*"))
                   if file.suffix in SOURCE_SUFFIXES]
        self.assertGreater(len(sources), 100)
        for files, retired in ((sources, RETIRED_IN_SOURCES), (PAGES, RETIRED_IN_PAGES)):
            pattern = re.compile("|".join(retired))
            for file in files:
                for number, line in enumerate(file.read_text().split("\n"), start=1):
                    found = pattern.search(line)
                    if found is not None:
                        with self.subTest(file=str(file.relative_to(ROOT)), line=number):
                            self.fail(f"retired: {found.group()}")


class Clocks(unittest.TestCase):
    # Wall clock, or a wait of absl, whose deadlines are of the wall clock. proto/rpc/monotonic.h has what to
    # use instead.
    WALL_CLOCK = re.compile(
        r"absl::Now\b(?!\(\) is)|system_clock|gettimeofday|\b(Await|Wait\w*)With(Timeout|Deadline)\b")

    # The one place where the coordinator takes the wall clock, to stamp submissions, outages and events.
    STAMPS = {("server/server.h", "std::function<absl::Time()> wall_now = [] { return absl::Now(); };")}

    def test_time_is_measured_by_the_monotonic_clock(self):
        for folder in ("client", "worker", "server", "proto/rpc"):
            for file in sorted((ROOT / folder).rglob("*")):
                if file.suffix not in SOURCE_SUFFIXES:
                    continue
                name = str(file.relative_to(ROOT))
                for number, line in enumerate(file.read_text().split("\n"), start=1):
                    if (name, line.strip()) in self.STAMPS:
                        continue
                    with self.subTest(file=name, line=number):
                        self.assertNotRegex(line, self.WALL_CLOCK)


if __name__ == "__main__":
    unittest.main()
