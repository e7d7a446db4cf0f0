"""The commands of docs/clusters.md and docs/operations.md are those that the programs, manifests and images
know."""

import re
import shlex
import unittest

import kubernetes_rules as rules
import node_tools
import programs

PAGE = programs.ROOT / "docs/clusters.md"
OPERATIONS = programs.ROOT / "docs/operations.md"


def commands(section):
    """The commands of a section's block, as words."""
    block = re.search(rf"<!-- {section}: begin -->\n```sh\n(.*?)```\n<!-- {section}: end -->",
                      PAGE.read_text(), re.S)[1]
    return [
        part.split()
        for line in block.splitlines()
        for part in shlex.join(shlex.split(line, comments=True)).split(" '&' ")
    ]


def program_faults(words):
    """What is wrong with a command line of one of our programs; positional arguments are not looked at."""
    program, rest = words[0], words[1:]
    subcommand = rest[:1] if rest and not rest[0].startswith("-") else []
    flags = programs.flags_of(program, *subcommand)
    return [
        f"{program} {subcommand} has no {word}" for word in rest
        if word.startswith("--") and word not in flags
    ]


class ManualTest(unittest.TestCase):
    def test_commands_of_our_programs(self):
        ours = [words for words in commands("kubernetes") if words[0].startswith("lumifold")]
        ours += [words[words.index("--") + 1:] for words in commands("kubernetes") if "--" in words]
        ours += [words for words in commands("several") if words[0].startswith("lumifold")]
        for words in commands("compose"):
            for service, program in (("coordinator", "lumifold-server"), ("worker", "lumifold-worker")):
                if "run" in words and service in words:
                    ours.append([program, *words[words.index(service) + 1:]])
        self.assertGreaterEqual(len(ours), 13)
        self.assertEqual([fault for words in ours for fault in program_faults(words)], [])
        self.assertEqual(len(program_faults(["lumifold-server", "init", "--nmae", "x"])), 1)

    def test_the_runbook_names_what_there_is(self):
        text = OPERATIONS.read_text()
        code = re.findall(r"`(lumifold[^`]*)`", text)
        used = {
            tuple(words[:2])
            for words in map(str.split, code)
            if words[1:] and re.fullmatch("[a-z][a-z-]+", words[1])
        }
        self.assertGreaterEqual(len(used), 20)
        for program, subcommand in sorted(used):
            programs.flags_of(program, subcommand)  # fails where there is none
        known = {
            flag for program, *subcommand in [
                *used, ("lumifold",
                        "submit"), ("lumifold-server",), ("lumifold-worker",), ("lumifold-autoscale",)
            ] for flag in programs.flags_of(program, *subcommand)
        }
        runbook = text[text.index("## Runbook"):text.index("## Limits")]
        flags = set(re.findall(r"`[^`]*?(--[a-z-]+)[^`]*`", runbook))
        self.assertGreaterEqual(len(flags), 5)
        self.assertEqual(flags - known, set())
        events = set(re.findall(r"`([a-z]+_[a-z_]+)`", runbook))
        self.assertEqual(
            [event for event in events if f"| `{event}`" not in text and f"`{event}`," not in text], [])

    def test_images_are_built_as_the_dockerfile_says(self):
        text = programs.DOCKERFILE.read_text()
        for words in commands("kubernetes"):
            if words[0] == "docker":
                self.assertIn("#   " + " ".join(words), text)

    @unittest.skipUnless(node_tools.is_available(), "npm is not installed (deploy/setup.sh --tests)")
    def test_secrets_are_those_that_pods_mount(self):
        node_tools.install()
        manifests = node_tools.render(programs.ROOT / "deploy/kubernetes/overlays/production")
        mounted = {volume["secret"]["secretName"] for workload in rules.workloads(manifests)
                   for volume in rules.pod_of(workload)["volumes"] if "secret" in volume}
        used = {variable["valueFrom"]["secretKeyRef"]["name"] for workload in rules.workloads(manifests)
                for container in rules.containers_of(workload) for variable in container.get("env", [])
                if "secretKeyRef" in variable.get("valueFrom", {})}
        made = set(re.findall(r"create secret generic (\S+)", PAGE.read_text()))
        self.assertEqual(made, mounted | used)

    def test_compose_commands_name_its_services(self):
        services = set(re.findall(r"^  (\w+):$", (programs.ROOT / "deploy/compose.yaml").read_text(), re.M))
        for words in commands("compose"):
            for service in {"coordinator", "worker"} & set(words):
                self.assertIn(service, services)


if __name__ == "__main__":
    unittest.main()
