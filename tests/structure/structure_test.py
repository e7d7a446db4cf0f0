"""The structure checks find what is planted in a tree of three rooms, and nothing in that tree as it is."""

import os
import pathlib
import re
import shutil
import tempfile
import textwrap
import unittest

import clang_checks
import include_direction

CLEAN = {
    "client/autoscale/policy/CMakeLists.txt": "",
    "filter/image/CMakeLists.txt": "",
    "filter/image/plane.h": "",
    "filter/image/plane.cc": '#include "filter/image/plane.h"\n',
    "filter/manifold/CMakeLists.txt": "",
    "filter/manifold/tree.h": '#include "filter/image/plane.h"\n',
    "filter/manifold/tree.cc": '#include "filter/manifold/tree.h"\n',
    "proto/identity/CMakeLists.txt": "",
    "server/access/CMakeLists.txt": "",
    "server/job/CMakeLists.txt": "",
    "server/job/reopen_plan.cc": "",
    "server/services/CMakeLists.txt": "",
    "server/scheduler/CMakeLists.txt": "",
    "server/scheduler/scheduler.cc": '#include <map>\n#include "filter/image/plane.h"\n#include "filter/manifold/tree.h"\n',
}
GRAPH = """\
lumifold_image\tSTATIC_LIBRARY\tfilter/image\tplane.cc\tabsl::status\tabsl::status
lumifold_manifold\tSTATIC_LIBRARY\tfilter/manifold\ttree.cc\tlumifold::image\tlumifold::image
lumifold_job\tSTATIC_LIBRARY\tserver/job\treopen_plan.cc\tabsl::status\tabsl::status
lumifold_scheduler\tSTATIC_LIBRARY\tserver/scheduler\tscheduler.cc\tlumifold::manifold\t$<LINK_ONLY:lumifold::manifold>
"""


def write_tree(root, files):
    for name, text in files.items():
        path = pathlib.Path(root, name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


class IncludeDirectionTest(unittest.TestCase):
    def problems(self, files, graph=GRAPH):
        with tempfile.TemporaryDirectory() as root:
            write_tree(root, CLEAN | files)
            return "\n".join(include_direction.check(pathlib.Path(root), graph))

    def test_a_clean_tree_has_no_problem(self):
        self.assertEqual(self.problems({}), "")

    def test_an_include_against_the_links(self):
        self.assertIn(
            "filter/image/plane.cc: includes filter/manifold/tree.h, but links no target of filter/manifold",
            self.problems({"filter/image/plane.cc": '#include "filter/manifold/tree.h"\n'}))

    def test_private_links_are_not_handed_on(self):
        graph = GRAPH.replace("lumifold::image\tlumifold::image",
                              "lumifold::image\t$<LINK_ONLY:lumifold::image>")
        self.assertIn("server/scheduler/scheduler.cc: includes filter/image/plane.h, but links no target",
                      self.problems({}, graph))

    def test_a_circle(self):
        graph = GRAPH.replace("plane.cc\tabsl::status", "plane.cc\tlumifold::manifold")
        self.assertIn("circle: lumifold_image -> lumifold_manifold -> lumifold_image", self.problems({},
                                                                                                     graph))

    def test_a_room_without_a_target(self):
        self.assertIn("filter/edges: has sources and no target",
                      self.problems({"filter/edges/CMakeLists.txt": "", "filter/edges/trust.cc": ""}))

    def test_a_source_of_another_room(self):
        graph = GRAPH.replace("\ttree.cc\t", "\ttree.cc;../image/plane.cc\t")
        self.assertIn("lumifold_manifold: takes filter/image/plane.cc", self.problems({}, graph))

    def test_rules(self):
        for file, include, reason in (
                ("filter/image/plane.h", "<lumifold/v1/job.pb.h>", "wire formats"),
                ("filter/image/plane.h", "<embree3/rtcore.h>", "ray tracer"),
                ("filter/manifold/tree.cc", '"filter/layers/halves.h"', "stands on kernels and image alone"),
                ("filter/image/plane.cc", '"tests/support/temp_folder.h"', "depend on their tests"),
                ("server/job/reopen_plan.cc", "<filesystem>", "no files"),
                ("client/autoscale/policy/policy.cc", '"absl/time/clock.h"', "no clock"),
                ("server/services/call.cc", '"server/coordinator/farm.h"', "as its roles"),
                ("server/access/identity.h", '"server/job/ids.h"', "knows no jobs"),
                ("proto/identity/profile.h", '"server/access/identity.h"', "below all programs"),
                ("server/scheduler/scheduler.cc", "<thread>", "no threads"),
                ("server/scheduler/scheduler.cc", '"absl/time/clock.h"', "no clock")):
            self.assertIn(reason, self.problems({file: f"#include {include}\n"}), include)


@unittest.skipUnless(shutil.which("clang++"), "no clang++")
class ClangChecksTest(unittest.TestCase):
    def test_a_header_that_leans_on_its_includer(self):
        with tempfile.TemporaryDirectory() as root:
            write_tree(root,
                       {"alone.h": "#include <string>\nstd::string f();\n", "leans.h": "std::string f();\n"})
            jobs = [(name, ["-fsyntax-only", "-x", "c++", str(pathlib.Path(root, name))])
                    for name in ("alone.h", "leans.h")]
            self.assertEqual(clang_checks.compile_all(jobs, root), 1)

    def test_a_member_read_without_its_mutex(self):
        source = textwrap.dedent("""\
            class __attribute__((capability("mutex"))) Mutex {};
            struct Counter {
              Mutex mutex;
              int count __attribute__((guarded_by(mutex))) = 0;
              int Read() { return count; }
            };
            """)
        with tempfile.TemporaryDirectory() as root:
            write_tree(root, {"counter.cc": source})
            arguments = ["-fsyntax-only", *clang_checks.THREAD_SAFETY, str(pathlib.Path(root, "counter.cc"))]
            self.assertEqual(clang_checks.compile_all([("counter.cc", arguments)], root), 1)

    def test_precompiled_headers_are_left_out_of_commands(self):
        command = "/usr/bin/c++ -I/x -O2 -Winvalid-pch -include /b/cmake_pch.hxx -fpch-preprocess -o a.o -c /x/a.cc"
        self.assertEqual(clang_checks.clang_arguments(command), ["-I/x", "-O2"])

    def test_a_change_reaches_what_includes_it(self):
        texts = {"a.h": "", "b.h": '#include "a.h"\n', "b.cc": '#include "b.h"\n', "c.cc": "#include <a.h>\n"}
        self.assertEqual(clang_checks.reached(texts, ["a.h", "gone.h"]), {"a.h", "b.h", "b.cc"})
        self.assertEqual(clang_checks.reached(texts, []), set())


class ProjectTest(unittest.TestCase):
    def test_includes_of_this_project_follow_its_links(self):
        root = pathlib.Path(__file__).resolve().parents[2]
        graph = pathlib.Path(os.environ["LUMIFOLD_TARGET_GRAPH"]).read_text()
        self.assertEqual(include_direction.check(root, graph), [])

    def test_texts_in_lines_of_the_log_are_escaped(self):
        """A value that the format puts in quotes could end them, and add fields: logging::Quoted escapes
        it."""
        root = pathlib.Path(__file__).resolve().parents[2]
        unsafe = re.compile(r'"event=[^\n]*=\\"\{')
        self.assertTrue(unsafe.search(r'log->warn("event=failed error=\"{}\"", text);'))
        sources = [
            path for folder in ("proto", "server", "worker", "client")
            for path in (root / folder).rglob("*.cc")
        ]
        self.assertGreater(len(sources), 100)
        self.assertEqual([str(path) for path in sources if unsafe.search(path.read_text())], [])


if __name__ == "__main__":
    unittest.main()
