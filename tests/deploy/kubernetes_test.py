"""The manifests of deploy/kubernetes pass the schemas of the Kubernetes API and fit the programs; broken ones
do not."""

import copy
import json
import re
import shutil
import subprocess
import unittest

import kubernetes_rules as rules
import node_tools
import programs

FOLDER = programs.ROOT / "deploy/kubernetes"
OVERLAYS = ("small", "production", "keda")


def find(manifests, kind, name="lumifold"):
    return next(m for m in manifests if m["kind"] == kind and m["metadata"]["name"] == name)


def main_container(manifests, kind, name="lumifold"):
    return rules.pod_of(find(manifests, kind, name))["containers"][0]


def replace_argument(container, before, after):
    assert before in container["args"], container["args"]
    container["args"] = [
        after if word == before else word for word in container["args"] if word != before or after
    ]


def coordinator(change):
    return lambda manifests, adapter: change(main_container(manifests, "StatefulSet"))


def worker(change):
    return lambda manifests, adapter: change(main_container(manifests, "Deployment", "lumifold-worker"))


def pod(change):
    return lambda manifests, adapter: change(rules.pod_of(find(manifests, "StatefulSet")))


def manifest(kind, name, change):
    return lambda manifests, adapter: change(find(manifests, kind, name)["spec"])


def scaler_metric(number, change):
    return lambda manifests, adapter: change(
        find(manifests, "HorizontalPodAutoscaler", "lumifold-worker")["spec"]["metrics"][number]["external"])


def scaled_object(change):
    return manifest("ScaledObject", "lumifold-worker", change)


def trigger(number, **values):
    return scaled_object(lambda spec: spec["triggers"][number]["metadata"].update(values))


# What is broken, and what must be said about it.
BROKEN = [
    ("an unknown option", coordinator(lambda c: c["args"].append("--no-such=1")), "has no --no-such"),
    ("an option without its value", worker(lambda c: replace_argument(c, "--threads=4", "--threads")),
     "needs a value"),
    ("a value that the program refuses",
     worker(lambda c: replace_argument(c, "--drain-seconds=120", "--drain-seconds=-1")),
     "lumifold-worker: lumifold-worker: --drain-seconds"),
    ("another port to listen on",
     coordinator(lambda c: replace_argument(c, "--listen=0.0.0.0:7700", "--listen=0.0.0.0:7701")),
     "is not the port grpc 7700"),
    ("listening on loopback",
     coordinator(lambda c: replace_argument(c, "--listen=0.0.0.0:7700", "--listen=127.0.0.1:7700")),
     "is not the port grpc 7700"),
    ("no metrics", coordinator(lambda c: replace_argument(c, "--metrics-address=0.0.0.0:9464", "")),
     "is not the port metrics 9464"),
    ("no metrics of workers", worker(lambda c: replace_argument(c, "--metrics-address=0.0.0.0:9465", "")),
     "is not the port metrics 9465"),
    ("a probe of another port",
     coordinator(lambda c: c["livenessProbe"]["exec"]["command"].__setitem__(3, "--server=localhost:1")),
     "livenessProbe asks localhost:1"),
    ("a native probe", coordinator(lambda c: c.update(readinessProbe={"grpc": {"port": 7700}})),
     "readinessProbe does not ask the health service"),
    ("a liveness probe that a full disk fails",
     coordinator(lambda c: c["livenessProbe"]["exec"]["command"].pop()), "livenessProbe: --answers"),
    ("a service on another port", manifest("Service", "lumifold", lambda s: s["ports"][0].update(port=7701)),
     "port 7701 is not the pods' grpc"),
    ("a service of nothing", manifest("Service", "lumifold",
                                      lambda s: s.update(selector={"a": "b"})), "selects no pods"),
    ("workers for another service",
     lambda manifests, adapter: rules.pod_of(find(manifests, "Deployment", "lumifold-worker"))[
         "initContainers"][0]["env"][1].update(value="farm:7700"), "no service farm:7700"),
    ("workers that do not know all coordinators",
     lambda manifests, adapter: find(manifests, "StatefulSet", "lumifold")["spec"].update(replicas=4),
     "the coordinators are"),
    ("several coordinators with SQLite", coordinator(lambda c: c["env"].pop()), "have no PostgreSQL"),
    ("coordinators that the others do not find",
     coordinator(lambda c: replace_argument(c, "--advertise=$(POD).lumifold-coordinators:7700",
                                            "--advertise=lumifold:7700")), "others do not reach"),
    ("another image", worker(lambda c: c.update(image="registry.example.org/lumifold-wrker:0.1.0")),
     "none of the Dockerfile's"),
    ("another version", worker(lambda c: c.update(image=c["image"].replace(":0.1.0", ":0.0.9"))),
     "none of the Dockerfile's"),
    ("no limit of memory", worker(lambda c: c["resources"]["limits"].pop("memory")), "no limits of memory"),
    ("no request of a processor", coordinator(lambda c: c["resources"]["requests"].pop("cpu")),
     "no requests of cpu"),
    ("more threads than processors", worker(lambda c: replace_argument(c, "--threads=4", "--threads=5")),
     "5 threads are not within"),
    ("a filter that may take all memory",
     coordinator(lambda c: replace_argument(c, "--filter-memory-mb=5120", "--filter-memory-mb=8192")),
     "over the limit of memory"),
    ("a writable root", worker(lambda c: c["securityContext"].pop("readOnlyRootFilesystem")),
     "writable root"),
    ("capabilities", worker(lambda c: c["securityContext"]["capabilities"].update(add=["SYS_ADMIN"])),
     "has capabilities"),
    ("privileges", worker(lambda c: c["securityContext"].update(privileged=True)), "beyond the three"),
    ("root", pod(lambda p: p["securityContext"].update(runAsUser=0)), "user is not that of the images"),
    ("no seccomp", pod(lambda p: p["securityContext"].pop("seccompProfile")), "no seccomp profile"),
    ("a token", pod(lambda p: p.pop("automountServiceAccountToken")), "token of its service account"),
    ("a folder of the node", pod(lambda p: p["volumes"].append({"name": "x", "hostPath": {"path": "/"}})),
     "volume x is"),
    ("a claim that is missing", pod(lambda p: p["volumes"][1]["persistentVolumeClaim"].update(claimName="x")),
     "no claim x"),
    ("a mount without volume", worker(lambda c: c["volumeMounts"][0].update(name="x")), "mounts x"),
    ("too short a time to drain", lambda manifests, adapter: rules.pod_of(
        find(manifests, "Deployment", "lumifold-worker")).update(terminationGracePeriodSeconds=60),
     "is killed before"),
    ("an open network",
     lambda manifests, adapter: manifests.remove(find(manifests, "NetworkPolicy", "lumifold-nothing")),
     "no NetworkPolicy refuses"),
    ("a policy for an unknown port",
     manifest("NetworkPolicy", "lumifold-worker",
              lambda s: s["egress"][0]["ports"][0].update(port="gprc")), "no container has a port gprc"),
    ("a metric that there is not", scaler_metric(0, lambda m: m["metric"].update(name="lumifold_queue")),
     "no rule and metric lumifold_queue"),
    ("a rule for a metric that there is not",
     lambda manifests, adapter: adapter["externalRules"][0].update(seriesQuery="lumifold_queue"),
     "has no metric lumifold_queue"),
    ("half the units of a worker", scaler_metric(1, lambda m: m["target"].update(averageValue="4")),
     "has 8 units, not 4"),
    ("a number of workers of its own",
     lambda manifests, adapter: find(manifests, "Deployment", "lumifold-worker")["spec"].update(replicas=3),
     "has a number of its own"),
    ("a budget for nothing",
     manifest("PodDisruptionBudget", "lumifold-worker",
              lambda s: s["selector"]["matchLabels"].update(a="b")), "selects no pods"),
]
BROKEN_KEDA = [
    ("a trigger on a metric that there is not", trigger(0, query="sum(lumifold_queue)"),
     "no rule and metric lumifold_queue"),
    ("a trigger on one coordinator", trigger(0, query="lumifold_units_queued"), "is no sum of a metric"),
    ("a trigger with half the units of a worker", trigger(1, threshold="4"), "has 8 units, not 4"),
    ("a trigger that few units do not activate", trigger(0, activationThreshold="64"),
     "starts no worker up to 64"),
    ("a trigger that takes silence for no work", trigger(1, ignoreNullValues="true"),
     "missing figures count as zero"),
    ("another kind of trigger", scaled_object(lambda s: s["triggers"][0].update(type="cpu")),
     "a trigger is cpu"),
    ("a scaled object of nothing", scaled_object(lambda s: s["scaleTargetRef"].update(name="x")),
     "its target is missing"),
    ("two autoscalers", lambda manifests, adapter: manifests.append({
        "kind": "HorizontalPodAutoscaler", "metadata": {"name": "x"},
        "spec": {**find(manifests, "ScaledObject", "lumifold-worker")["spec"], "metrics": []}
    }), "has another autoscaler"),
]
BROKEN_SCHEMA = [
    ("a field with a typing error", manifest("Deployment", "lumifold-worker",
                                             lambda s: s.update(replicaz=3)), "replicaz"),
    ("such a field far inside", worker(lambda c: c["securityContext"].update(readOnlyRootFileSystem=True)),
     "readOnlyRootFileSystem"),
    ("text for a number",
     manifest("HorizontalPodAutoscaler", "lumifold-worker",
              lambda s: s.update(maxReplicas="50")), "must be integer"),
    ("a kind that there is not",
     lambda manifests, adapter: find(manifests, "Deployment", "lumifold-worker").update(kind="Deploy"),
     "no such kind"),
]
BROKEN_KEDA_SCHEMA = [
    ("a field of KEDA with a typing error", scaled_object(lambda s: s.update(minReplicas=0)), "minReplicas"),
    ("a number for text", trigger(0, threshold=64), "must be string"),
]
# What is broken of which overlay.
ALL_BROKEN = [("production", *case) for case in BROKEN] + [("keda", *case) for case in BROKEN_KEDA]
ALL_BROKEN_SCHEMA = [("production", *case) for case in BROKEN_SCHEMA
                    ] + [("keda", *case) for case in BROKEN_KEDA_SCHEMA]


@unittest.skipUnless(node_tools.is_available(), "npm is not installed (deploy/setup.sh --tests)")
class KubernetesTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        node_tools.install()
        cls.overlays = {name: node_tools.render(FOLDER / "overlays" / name) for name in OVERLAYS}
        cls.adapter = json.loads(
            node_tools.run("read_yaml.mjs", stdin=(FOLDER / "prometheus-adapter.yaml").read_text()))[0]

    def broken(self, overlay, change):
        manifests, adapter = copy.deepcopy((self.overlays[overlay], self.adapter))
        change(manifests, adapter)
        return manifests, adapter

    def test_each_overlay_fits_the_schemas_and_the_programs(self):
        self.assertEqual(node_tools.schema_faults(sum(self.overlays.values(), [])), [])
        for name, manifests in self.overlays.items():
            self.assertEqual(rules.faults(manifests, self.adapter), [], name)

    def test_what_is_broken_is_found(self):
        for overlay, what, change, fault in ALL_BROKEN:
            with self.subTest(what):
                self.assertIn(fault, "\n".join(rules.faults(*self.broken(overlay, change))))

    def test_what_the_schemas_refuse_is_found(self):
        changed = [next(m for m in self.broken(overlay, change)[0] if m not in self.overlays[overlay])
                   for overlay, _, change, _ in ALL_BROKEN_SCHEMA]
        found = node_tools.schema_faults(changed)  # all at once: TypeScript takes seconds to start
        for _, what, _, fault in ALL_BROKEN_SCHEMA:
            self.assertEqual(sum(fault in line for line in found), 1, f"{what}: {found}")

    def test_kustomize_renders_the_same(self):
        """The tests' own rendering is of a part of the language; kubectl, where there is one of today, knows
        all."""
        kubectl = shutil.which("kubectl")
        version = kubectl and subprocess.run([kubectl, "version", "--client"], capture_output=True,
                                             text=True).stdout
        if not re.search(r"Kustomize Version: v5", version or ""):
            self.skipTest("there is no kubectl with kustomize 5")
        for name, manifests in self.overlays.items():
            rendered = subprocess.run([kubectl, "kustomize", FOLDER / "overlays" / name],
                                      capture_output=True,
                                      text=True,
                                      check=True)
            theirs = json.loads(node_tools.run("read_yaml.mjs", stdin=rendered.stdout))
            self.assertEqual(sorted(theirs, key=rules.name_of), sorted(manifests, key=rules.name_of))

    def test_images_are_those_of_this_version(self):
        for name, image in programs.images().items():
            self.assertEqual(image["tag"], programs.version(), name)

    def test_overlays_scale_from_one_coordinator_to_several(self):
        """Several coordinators share their data folder, over one PostgreSQL."""
        for name, manifests in self.overlays.items():
            modes = find(manifests, "PersistentVolumeClaim", "lumifold-data")["spec"]["accessModes"]
            stores = [
                v["name"]
                for v in main_container(manifests, "StatefulSet").get("env", [])
                if v["name"] == "LUMIFOLD_STORE"
            ]
            one, several = (["ReadWriteOnce"], []), (["ReadWriteMany"], ["LUMIFOLD_STORE"])
            self.assertEqual((modes, stores), {"small": one, "production": several, "keda": several}[name])

    def test_keda_replaces_the_autoscaler_and_nothing_else(self):
        production, keda = (
            {rules.name_of(m): m for m in self.overlays[name]} for name in ("production", "keda"))
        self.assertEqual(production.keys() - keda.keys(), {"HorizontalPodAutoscaler lumifold-worker"})
        self.assertEqual(keda.keys() - production.keys(), {"ScaledObject lumifold-worker"})
        scaled = keda["ScaledObject lumifold-worker"]["spec"]
        self.assertEqual(scaled["minReplicaCount"], 0)
        scaler = production["HorizontalPodAutoscaler lumifold-worker"]["spec"]
        self.assertEqual(scaled["maxReplicaCount"], scaler["maxReplicas"])
        self.assertEqual(scaled["advanced"]["horizontalPodAutoscalerConfig"]["behavior"], scaler["behavior"])


if __name__ == "__main__":
    unittest.main()
