"""The lists of methods in docs/ against the records that the programs print."""

import json
import pathlib
import re
import subprocess
import unittest

import harness

DOCS = pathlib.Path(__file__).parents[2] / "docs"


def cells(line):
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def tables_of_methods():
    """The tables of docs/*.md with a column "name" and a column "parameters ...", as lists of rows of
    cells."""
    for page in sorted(DOCS.glob("*.md")):
        lines = page.read_text().splitlines()
        for number, line in enumerate(lines):
            head = cells(line) if line.startswith("|") else []
            if not head or head[0] != "name" or not any(name.startswith("parameters") for name in head):
                continue
            column = next(i for i, name in enumerate(head) if name.startswith("parameters"))
            for row in lines[number + 2 :]:
                if not row.startswith("|"):
                    break
                yield page.name, cells(row)[0].strip("`"), cells(row)[column]


def documented_defaults():
    """Page and defaults by parameter of each method in a table; parameters are written as `name`
    (default)."""
    return {
        name: (page, {key: float(value) for key, value in re.findall(r"`(\w+)` \(([-+.e\d]+)", parameters)})
        for page, name, parameters in tables_of_methods()
    }


def defaults_of(method):
    return {parameter["name"]: parameter["default"] for parameter in method["parameters"]}


class Methods(harness.CliTest):
    def listed(self, *command):
        """The methods that a program lists as JSON, one object a line."""
        done = subprocess.run(
            [harness.BIN_DIR / command[0], *command[1:], "--list-methods", "--json"],
            check=True, capture_output=True, text=True, timeout=harness.TIMEOUT_SECONDS,
        )
        return [json.loads(line) for line in done.stdout.splitlines()]

    def test_the_charts_have_all_that_the_filter_has(self):
        filters = self.listed("lumifold", "filter")
        self.assertEqual([method["name"] for method in filters[:3]], ["default", "none", "paper"])
        self.assertEqual(self.listed("lumifold-chart")[: len(filters)], filters)

    def test_each_method_is_documented_with_its_defaults(self):
        documented = documented_defaults()
        for method in self.listed("lumifold-chart"):
            with self.subTest(method=method["name"]):
                self.assertTrue(method["summary"] and method["source"])
                for parameter in method["parameters"]:
                    self.assertLessEqual(parameter["least"], parameter["default"])
                    self.assertLessEqual(parameter["default"], parameter["most"])
                if not method["parameters"]:
                    continue
                self.assertIn(method["name"], documented, "in no table of docs/*.md")
                page, defaults = documented[method["name"]]
                self.assertEqual(defaults, defaults_of(method), page)

    def test_no_other_method_is_documented(self):
        known = {method["name"] for method in self.listed("lumifold-chart")}
        self.assertLessEqual(set(documented_defaults()), known)

    def test_the_list_for_people_and_help_name_every_method(self):
        table = self.succeed("filter", "--list-methods")
        help_text = self.succeed("filter", "--help")
        for method in self.listed("lumifold", "filter"):
            self.assertRegex(table, rf"(?m)^{re.escape(method['name'])} +{re.escape(method['summary'])}$")
            self.assertIn(method["source"], table)
            self.assertRegex(help_text, rf"[ ,]{re.escape(method['name'])}[ ,.]")
            for parameter in method["parameters"]:
                self.assertRegex(
                    table,
                    rf"(?m)^ +{parameter['name']}=\S+ \(\S+ to \S+\): {re.escape(parameter['summary'])}$")


if __name__ == "__main__":
    unittest.main()
