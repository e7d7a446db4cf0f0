"""Alert rules, dashboard and example of a configuration in deploy/monitoring: checked by Prometheus' own
tool, and each expression compared with what a real coordinator and a real worker show."""

import json
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

import programs

FOLDER = programs.ROOT / "deploy/monitoring"
# What is left of an expression without its metrics, labels, numbers and texts.
LANGUAGE = {"and", "by", "histogram_quantile", "increase", "min", "rate", "sum"}
OF_PROMETHEUS = {"up": {"job", "instance"}}  # a metric that it makes for each target
OF_TARGETS = {"instance", "job"}


def alerts():
    """Name and expression of each alert."""
    text = (FOLDER / "alerts.yml").read_text()
    found = re.findall(r"^ +- alert: (\w+)\n +expr: (.+)$", text, re.M)
    assert len(found) == text.count("alert:") == text.count("expr:")
    return dict(found)


def panels(kind):
    return [
        panel for panel in json.loads((FOLDER / "dashboard.json").read_text())["panels"]
        if panel["type"] == kind
    ]


def dashboard_expressions():
    return [target["expr"] for panel in panels("timeseries") for target in panel["targets"]]


def exported(text):
    """Values of each label by the name of the sample that has it."""
    found = {}
    for name, labels in re.findall(r"^(\w+)(?:{(.*)})? ", text, re.M):
        of_name = found.setdefault(name, {})
        for label, value in re.findall(r'(\w+)="([^"]*)"', labels):
            of_name.setdefault(label, set()).add(value)
    return found


def faults(expression, shown):
    """What an expression asks for and no program shows. `shown`: see exported()."""
    rest = expression
    names = set()
    for name, matchers in re.findall(r"(\w+){(.*?)}", expression):
        names.add(name)
        for label, value in re.findall(r'(\w+)="([^"]*)"', matchers):
            if name in OF_PROMETHEUS:
                if label not in OF_PROMETHEUS[name]:
                    yield f"{name} has no label {label}"
            elif value not in shown.get(name, {}).get(label, set()) and label not in OF_TARGETS:
                yield f"{name} is never shown with {label}={value}"
    rest = re.sub(r"{.*?}", "", rest)
    groups = re.findall(r"\bby \((.*?)\)", rest)
    rest = re.sub(r"\bby \(.*?\)|\[\w+\]|\b\d[\w.]*", " ", rest)
    names |= set(re.findall(r"[A-Za-z_]\w*", rest)) - LANGUAGE
    yield from (f"no program shows {name}" for name in sorted(names - set(shown) - set(OF_PROMETHEUS)))
    labels = {label for name in names for label in shown.get(name, {})} | OF_TARGETS
    for group in groups:
        yield from (f"{expression}: nothing has the label {label}"
                    for label in group.split(", ") if label not in labels)


def promtool(*arguments):
    return subprocess.run(["promtool", *map(str, arguments)], capture_output=True, text=True)


class ExpressionsTest(unittest.TestCase):
    """Against a coordinator and a worker that run."""

    @classmethod
    def setUpClass(cls):
        cls.shown = exported("".join(programs.metrics_texts()))

    def test_of_the_alerts(self):
        for name, expression in alerts().items():
            self.assertEqual(list(faults(expression, self.shown)), [], name)

    def test_of_the_dashboard(self):
        expressions = dashboard_expressions()
        self.assertGreater(len(expressions), 15)
        for expression in expressions:
            self.assertEqual(list(faults(expression, self.shown)), [], expression)

    def test_the_dashboard_shows_every_metric(self):
        asked = " ".join(dashboard_expressions())
        bases = {re.sub(r"_(bucket|sum|count)$", "", name) for name in self.shown}
        self.assertEqual(
            [name for name in sorted(bases) if not re.search(rf"\b{name}(_bucket|_sum|_count)?\b", asked)],
            [])
        self.assertEqual([row["title"] for row in panels("row")],
                         ["Queue", "Workers", "Throughput", "Storage", "Filter", "Each worker", "Processes"])

    def test_what_is_wrong_is_found(self):
        for wrong in ("lumifold_unit_queued > 0", "rate(lumifold_lease_expiry_total[5m])",
                      'up{colour="red"} == 0', 'lumifold_workers{state="asleep"} > 0',
                      'lumifold_workers{mood="idle"} > 0', "sum by (colour) (lumifold_workers)",
                      "lumifold_ledger_commit_seconds > 1", "maximum(lumifold_jobs)"):
            self.assertNotEqual(list(faults(wrong, self.shown)), [], wrong)


@unittest.skipUnless(shutil.which("promtool"), "promtool is not installed (deploy/setup.sh --tests)")
class PromtoolTest(unittest.TestCase):
    def test_the_configuration(self):
        checked = promtool("check", "config", FOLDER / "prometheus.yml")
        self.assertEqual(checked.returncode, 0, checked.stderr)
        jobs = set(re.findall(r"job_name: (\S+)", (FOLDER / "prometheus.yml").read_text()))
        asked = {job for expression in alerts().values() for job in re.findall(r'job="(.*?)"', expression)}
        self.assertEqual(asked - jobs, set())

    def test_the_rules(self):
        checked = promtool("test", "rules", FOLDER / "alerts_test.yml")
        self.assertEqual(checked.returncode, 0, checked.stdout + checked.stderr)

    def test_each_rule_is_tested_where_it_fires_and_where_not(self):
        rules = (FOLDER / "alerts.yml").read_text()
        with tempfile.TemporaryDirectory() as folder:
            shutil.copy(FOLDER / "alerts_test.yml", folder)
            # Never, and always: then where a test expects no alert.
            for wrong, found in (("vector(1) > 2", r"alertname: (\w+)"),
                                 ("vector(1)", r"alertname: (\w+), time: \w+, \n +exp:\[\]")):
                pathlib.Path(folder, "alerts.yml").write_text(re.sub(r"expr: .+", f"expr: {wrong}", rules))
                done = promtool("test", "rules", pathlib.Path(folder, "alerts_test.yml"))
                self.assertEqual(set(re.findall(found, done.stdout + done.stderr)), set(alerts()), wrong)

    def test_the_dashboard_has_valid_expressions(self):
        def check(expressions):
            with tempfile.TemporaryDirectory() as folder:
                rules = [{"record": f"panel:{number}", "expr": expression}
                         for number, expression in enumerate(expressions)]
                path = pathlib.Path(folder, "rules.yml")
                path.write_text(json.dumps({"groups": [{"name": "dashboard", "rules": rules}]}))
                return promtool("check", "rules", path).returncode

        self.assertEqual(check(dashboard_expressions()), 0)
        self.assertNotEqual(check([*dashboard_expressions(), "sum(("]), 0)


class ManualTest(unittest.TestCase):
    def test_it_names_each_alert(self):
        page = (programs.ROOT / "docs/operations.md").read_text()
        table = page.split("<!-- alerts: begin -->")[1].split("<!-- alerts: end -->")[0]
        self.assertEqual(re.findall(r"^\| `(\w+)` \|", table, re.M), list(alerts()))


if __name__ == "__main__":
    unittest.main()
