"""What manifests must have that no schema says: that they fit the programs and each other, and that pods have
no right that they do not need. `faults(manifests, adapter)` returns what is wrong, a line for each fault."""

import re

import programs

RESTRICTED_VOLUMES = {"secret", "emptyDir", "persistentVolumeClaim", "configMap", "projected"}
RESOURCES = ("cpu", "memory", "ephemeral-storage")
# The server itself beside its filter process.
SERVER_MIB = 2048


def name_of(manifest):
    return f"{manifest['kind']} {manifest['metadata']['name']}"


def of_kind(manifests, *kinds):
    return [m for m in manifests if m["kind"] in kinds]


def workloads(manifests):
    return of_kind(manifests, "StatefulSet", "Deployment")


def pod_of(workload):
    return workload["spec"]["template"]["spec"]


def containers_of(workload):
    return [*pod_of(workload).get("initContainers", []), *pod_of(workload)["containers"]]


def labels_of(workload):
    return workload["spec"]["template"]["metadata"]["labels"]


def selected(manifests, labels):
    """The workloads whose pods have these labels."""
    return [w for w in workloads(manifests) if labels.items() <= labels_of(w).items()]


def mebibytes(quantity):
    number, unit = re.fullmatch(r"(\d+)(Mi|Gi|Ti)", quantity).groups()
    return int(number) * {"Mi": 1, "Gi": 1024, "Ti": 1024 ** 2}[unit]


def processors(quantity):
    return float(quantity.removesuffix("m")) / (1000 if quantity.endswith("m") else 1)


def image_of(container):
    """The Dockerfile's image that a container uses; None where it has none."""
    return programs.images().get(container["image"].split("/")[-1].split(":")[0])


def ports_of(container):
    return {port["name"]: port["containerPort"] for port in container.get("ports", [])}


def container_faults(pod, container):
    image = image_of(container)
    if image is None or container["image"].rsplit(":", 1)[-1] != image["tag"]:
        yield f"image {container['image']} is none of the Dockerfile's"
        return
    if "command" not in container:
        yield from programs.flag_faults(image["program"], container.get("args", []))
    security = container.get("securityContext", {})
    if security.get("allowPrivilegeEscalation") is not False:
        yield "may gain privileges"
    if not security.get("readOnlyRootFilesystem"):
        yield "has a writable root file system"
    if security.get("capabilities") != {"drop": ["ALL"]}:
        yield "has capabilities"
    if security.keys() - {"allowPrivilegeEscalation", "readOnlyRootFilesystem", "capabilities"}:
        yield "has a securityContext beyond the three"
    for bound in ("requests", "limits"):
        for resource in RESOURCES:
            if resource not in container.get("resources", {}).get(bound, {}):
                yield f"has no {bound} of {resource}"
    for mount in container.get("volumeMounts", []):
        if mount["name"] not in pod:
            yield f"mounts {mount['name']}, which is no volume"


def program_faults(container):
    """That the options fit the ports, the limits and the probes."""
    args, ports, limits = container.get("args", []), ports_of(container), container.get("resources",
                                                                                        {}).get("limits", {})
    for option, port in (("--listen", "grpc"), ("--metrics-address", "metrics")):
        address = programs.value_of(args, option)
        if address is None and port not in ports:
            continue
        if address is None or not address.startswith("0.0.0.0:") or int(
                address.split(":")[1]) != ports.get(port):
            yield f"{option} {address} is not the port {port} {ports.get(port)}"
    threads = programs.value_of(args, "--threads") or programs.value_of(args, "--filter-threads")
    if threads is None or int(threads) > processors(limits.get("cpu", "0")):
        yield f"{threads} threads are not within the limit of processors"
    filter_mib = programs.value_of(args, "--filter-memory-mb")
    if "--listen" in " ".join(args) and int(filter_mib or 0) + SERVER_MIB > mebibytes(
            limits.get("memory", "0Mi")):
        yield f"the filter's {filter_mib} MiB and the server's {SERVER_MIB} are over the limit of memory"
    if "--listen" in " ".join(args):
        for probe in ("startupProbe", "livenessProbe", "readinessProbe"):
            yield from probe_faults(probe, container.get(probe, {}), args, ports)


def probe_faults(name, probe, args, ports):
    command = probe.get("exec", {}).get("command", [])
    if command[:2] != ["lumifold-server", "health"]:
        yield f"{name} does not ask the health service"
        return
    yield from programs.flag_faults("lumifold-server", command[1:])
    if programs.value_of(command, "--server") != f"localhost:{ports.get('grpc')}":
        yield f"{name} asks {programs.value_of(command, '--server')}"
    if programs.value_of(command, "--data") != programs.value_of(args, "--data"):
        yield f"{name} looks for the authority in {programs.value_of(command, '--data')}"
    if ("--answers" in command) != (name != "readinessProbe"):
        yield f"{name}: --answers is for all but readiness"


def workload_faults(manifests, workload):
    spec, pod = workload["spec"], pod_of(workload)
    claims = {c["metadata"]["name"] for c in spec.get("volumeClaimTemplates", [])}
    volumes = {volume["name"]: volume for volume in pod.get("volumes", [])}
    for container in containers_of(workload):
        for fault in container_faults(claims | volumes.keys(), container):
            yield f"{container['name']}: {fault}"
    for container in pod["containers"]:
        for fault in program_faults(container):
            yield f"{container['name']}: {fault}"
        drain = programs.value_of(container.get("args", []), "--drain-seconds")
        if drain is not None and pod.get("terminationGracePeriodSeconds", 30) < int(drain) + 10:
            yield f"{container['name']}: is killed before --drain-seconds={drain} are over"
        annotations = spec["template"]["metadata"].get("annotations", {})
        if "metrics" in ports_of(container) and annotations != {
                "prometheus.io/scrape": "true", "prometheus.io/path": "/metrics",
                "prometheus.io/port": str(ports_of(container)["metrics"])}:
            yield f"{container['name']}: the annotations for Prometheus are {annotations}"
    for volume in volumes.values():
        if not volume.keys() - {"name"} <= RESTRICTED_VOLUMES:
            yield f"volume {volume['name']} is {[*volume]}"
        claim = volume.get("persistentVolumeClaim", {}).get("claimName")
        if claim and claim not in {
                c["metadata"]["name"] for c in of_kind(manifests, "PersistentVolumeClaim")
        }:
            yield f"there is no claim {claim}"
    if not spec["selector"]["matchLabels"].items() <= labels_of(workload).items():
        yield "does not select its own pods"
    yield from pod_faults(manifests, workload)


def pod_faults(manifests, workload):
    pod = pod_of(workload)
    security = pod.get("securityContext", {})
    users = {image["user"] for image in map(image_of, containers_of(workload)) if image}
    if not security.get("runAsNonRoot") or users != {
            f"{security.get('runAsUser')}:{security.get('runAsGroup')}"
    }:
        yield f"the user is not that of the images, {users}"
    if security.get("seccompProfile") != {"type": "RuntimeDefault"}:
        yield "has no seccomp profile"
    if pod.get("automountServiceAccountToken") is not False:
        yield "has a token of its service account"
    accounts = {m["metadata"]["name"]: m for m in of_kind(manifests, "ServiceAccount")}
    if accounts.get(pod.get("serviceAccountName"), {}).get("automountServiceAccountToken") is not False:
        yield "its service account is missing or has a token"
    for name in ("hostNetwork", "hostPID", "hostIPC"):
        if pod.get(name):
            yield f"has {name}"
    priority = pod.get("priorityClassName")
    if priority and priority not in {m["metadata"]["name"] for m in of_kind(manifests, "PriorityClass")}:
        yield f"there is no priority class {priority}"


def service_faults(manifests, service):
    pods = selected(manifests, service["spec"]["selector"])
    ports = [ports_of(container) for workload in pods for container in pod_of(workload)["containers"]]
    if not pods:
        yield "selects no pods"
    for port in service["spec"]["ports"]:
        if not all(
                port["targetPort"] in named and named[port["targetPort"]] == port["port"] for named in ports):
            yield f"port {port['port']} is not the pods' {port['targetPort']}"


def hosts_of(manifests):
    """The ports of each service, by its name, and of each pod of a StatefulSet, by its name within its
    service."""
    hosts = {
        s["metadata"]["name"]: [p["port"] for p in s["spec"]["ports"]] for s in of_kind(manifests, "Service")
    }
    for workload in of_kind(manifests, "StatefulSet"):
        service = workload["spec"].get("serviceName")
        for i in range(workload["spec"]["replicas"]):
            hosts[f"{workload['metadata']['name']}-{i}.{service}"] = hosts.get(service, [])
    return hosts


def member_faults(manifests, workload):
    """That several coordinators can share their jobs, and find each other."""
    replicas = workload["spec"].get("replicas", 1)
    if workload["kind"] != "StatefulSet" or replicas == 1:
        return
    for container in pod_of(workload)["containers"]:
        if "LUMIFOLD_STORE" not in [variable["name"] for variable in container.get("env", [])]:
            yield f"{name_of(workload)}: {replicas} coordinators have no PostgreSQL"
        ports = set(ports_of(container).values())
        addresses = [
            a.removeprefix("--advertise=") for a in container["args"] if a.startswith("--advertise=")
        ]
        if addresses not in [[f"$(POD).{workload['spec'].get('serviceName')}:{port}"] for port in ports]:
            yield f"{name_of(workload)}: others do not reach each of {replicas} coordinators at {addresses}"


def address_faults(manifests):
    """That workers get addresses of the services or of all coordinators, and certificates their names."""
    services = {s["metadata"]["name"]: s for s in of_kind(manifests, "Service")}
    hosts = hosts_of(manifests)
    for workload in workloads(manifests):
        yield from member_faults(manifests, workload)
        for container in containers_of(workload):
            for variable in container.get("env", []):
                if variable["name"] != "COORDINATOR":
                    continue
                addresses = variable["value"].split(",")
                for address in addresses:
                    host, port = address.split(":")
                    if int(port) not in hosts.get(host, []):
                        yield f"{name_of(workload)}: there is no service {address}"
                pods = {host for host in hosts if "." in host}
                if len(addresses) > 1 and {address.split(":")[0] for address in addresses} != pods:
                    yield f"{name_of(workload)}: the coordinators are {sorted(pods)}"
        service = workload["spec"].get("serviceName")
        if workload["kind"] == "StatefulSet" and services.get(
                service, {"spec": {}})["spec"].get("clusterIP") != "None":
            yield f"{name_of(workload)}: there is no headless service {service}"


def policy_faults(manifests):
    policies = [m["spec"] for m in of_kind(manifests, "NetworkPolicy")]
    if {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]} not in policies:
        yield "no NetworkPolicy refuses what no other allows"
    names = {name for w in workloads(manifests) for c in pod_of(w)["containers"] for name in ports_of(c)}
    for manifest in of_kind(manifests, "NetworkPolicy"):
        spec = manifest["spec"]
        labels = spec["podSelector"].get("matchLabels", {})
        if labels and not selected(manifests, labels):
            yield f"{name_of(manifest)}: selects no pods"
        for rule in [*spec.get("ingress", []), *spec.get("egress", [])]:
            if not rule.get("ports"):
                yield f"{name_of(manifest)}: a rule allows all ports"
            for port in rule.get("ports", []):
                if isinstance(port["port"], str) and port["port"] not in names:
                    yield f"{name_of(manifest)}: no container has a port {port['port']}"


def figures_of(scaler):
    """The metrics that an autoscaler looks at, each with its value for one worker."""
    if scaler["kind"] == "HorizontalPodAutoscaler":
        return [(metric["external"]["metric"]["name"], metric["external"]["target"]["averageValue"])
                for metric in scaler["spec"]["metrics"]]
    triggers = [trigger["metadata"] for trigger in scaler["spec"]["triggers"]]
    return [(trigger["query"].removeprefix("sum(").removesuffix(")"), trigger["threshold"])
            for trigger in triggers]


def trigger_faults(trigger):
    """That a trigger of KEDA asks for a sum over all coordinators, and takes missing figures for no queue of
    zero."""
    if trigger["type"] != "prometheus":
        yield f"a trigger is {trigger['type']}"
    if not re.fullmatch(r"sum\(\w+\)", trigger["metadata"]["query"]):
        yield f"{trigger['metadata']['query']} is no sum of a metric"
    if trigger["metadata"].get("activationThreshold", "0") != "0":
        yield f"{trigger['metadata']['query']} starts no worker up to {trigger['metadata']['activationThreshold']}"
    if trigger["metadata"].get("ignoreNullValues") != "false":
        yield f"{trigger['metadata']['query']}: missing figures count as zero"


def scaling_faults(manifests, adapter):
    metrics, slots_per_thread = programs.metrics()
    rules = {rule["seriesQuery"] for rule in adapter["externalRules"]}
    for name in sorted(rules - metrics):
        yield f"prometheus-adapter: the coordinator has no metric {name}"
    scalers = of_kind(manifests, "HorizontalPodAutoscaler", "ScaledObject")
    targets = [scaler["spec"]["scaleTargetRef"] for scaler in scalers]
    for scaler, target in zip(scalers, targets):
        if targets.count(target) > 1:
            yield f"{name_of(scaler)}: its target has another autoscaler"
        workload = next((w for w in workloads(manifests)
                         if (w["kind"], w["metadata"]["name"]) == (target["kind"], target["name"])), None)
        if workload is None or "replicas" in workload["spec"]:
            yield f"{name_of(scaler)}: its target is missing, or has a number of its own"
            continue
        known = metrics & rules if scaler["kind"] == "HorizontalPodAutoscaler" else metrics
        for name, average in figures_of(scaler):
            if name not in known:
                yield f"{name_of(scaler)}: no rule and metric {name}"
            threads = int(programs.value_of(pod_of(workload)["containers"][0]["args"], "--threads") or 0)
            if name == "lumifold_units_leased" and int(average) != slots_per_thread * threads:
                yield f"{name_of(scaler)}: a worker of {threads} threads has {slots_per_thread * threads} units, not {average}"
    for scaler in of_kind(manifests, "ScaledObject"):
        for trigger in scaler["spec"]["triggers"]:
            yield from (f"{name_of(scaler)}: {fault}" for fault in trigger_faults(trigger))
    for budget in of_kind(manifests, "PodDisruptionBudget"):
        if not selected(manifests, budget["spec"]["selector"]["matchLabels"]):
            yield f"{name_of(budget)}: selects no pods"


def faults(manifests, adapter):
    """All that is wrong with the manifests of an overlay, and with the rules of prometheus-adapter."""
    found = []
    for workload in workloads(manifests):
        found += [f"{name_of(workload)}: {fault}" for fault in workload_faults(manifests, workload)]
    for service in of_kind(manifests, "Service"):
        found += [f"{name_of(service)}: {fault}" for fault in service_faults(manifests, service)]
    return [
        *found, *address_faults(manifests), *policy_faults(manifests), *scaling_faults(manifests, adapter)
    ]
