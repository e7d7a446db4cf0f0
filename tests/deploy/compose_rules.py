"""What deploy/compose.yaml must have that no schema says. `faults(compose)` returns what is wrong, a line for
each fault."""

import re

import programs

REQUIRED = {"read_only": True, "cap_drop": ["ALL"], "security_opt": ["no-new-privileges:true"]}
BOUNDS = ("mem_limit", "cpus", "stop_grace_period", "restart")


def image_faults(service):
    name, _, tag = service["image"].partition(":")
    image = programs.images()[name]
    target = service.get("build", {}).get("target")
    stage = programs.stages().get(target)
    if tag != image["tag"] or stage is None or image["program"] not in stage.of("ENTRYPOINT")[0]:
        yield f"image {service['image']} is not what the target {target} builds"
    if (service["build"]["context"], service["build"]["dockerfile"]) != ("..", "deploy/container/Dockerfile"):
        yield "is built from another Dockerfile"
    if service.get("user") != image["user"]:
        yield f"runs as {service.get('user')}, not as {image['user']}"
    yield from programs.flag_faults(image["program"], service.get("command", []))


def coordinator_faults(service):
    listen = programs.value_of(service["command"], "--listen") or ""
    port = listen.rpartition(":")[2]
    if not any(published.endswith(f":{port}") for published in service.get("ports", [])):
        yield f"the port of --listen={listen} is not published"
    data = programs.value_of(service["command"], "--data")
    if not any(volume.endswith(f":{data}") for volume in service["volumes"]):
        yield f"--data={data} is on no volume"
    check = service.get("healthcheck", {}).get("test", [])
    if check[:3] != ["CMD", "lumifold-server", "health"]:
        yield "its health check does not ask the health service"
        return
    yield from programs.flag_faults("lumifold-server", check[2:])
    if programs.value_of(check, "--server") != f"localhost:{port}" or programs.value_of(check,
                                                                                        "--data") != data:
        yield "its health check asks another coordinator"


def service_faults(name, service):
    if service["image"].split(":")[0] in programs.images():
        yield from image_faults(service)
        for key, value in REQUIRED.items():
            if service.get(key) != value:
                yield f"{key} is {service.get(key)}"
    for key in BOUNDS:
        if key not in service:
            yield f"has no {key}"
    if name == "coordinator":
        yield from coordinator_faults(service)
    drain = programs.value_of(service.get("command", []), "--drain-seconds")
    if drain and int(re.match(r"\d+", service["stop_grace_period"])[0]) < int(drain) + 10:
        yield f"is killed before --drain-seconds={drain} are over"


def faults(compose):
    found = [
        f"{name}: {fault}" for name, service in compose["services"].items()
        for fault in service_faults(name, service)
    ]
    for name, service in compose["services"].items():
        for volume in service.get("volumes", []):
            if volume.split(":")[0] not in compose["volumes"]:
                found.append(f"{name}: there is no volume {volume}")
    return found
