"""Checks that includes follow the links between targets.

    include_direction.py SOURCE_FOLDER GRAPH_FILE

GRAPH_FILE is what tests/structure/target_graph.cmake writes. A room is a folder with a CMakeLists.txt; a file
belongs to the nearest room above it. Reported, one line each:
  * a room with C++ sources and without a target, and a target that takes sources from another room;
  * an include of another room's header where the file's target links none of that room's, directly or through
    PUBLIC links;
  * targets that link each other in a circle;
  * an include that RULES forbids.
Ends with 0 where there is nothing to report, else with 1.
"""

import pathlib
import re
import sys
from typing import NamedTuple


class Rule(NamedTuple):
    """Files below `folder` must not include what matches `forbidden`; they may what matches `allowed`."""
    folder: str
    forbidden: str
    reason: str
    allowed: str = r"(?!)"


PROTO = r"lumifold/v1/|proto/|google/protobuf|grpc"
IMPURE = (r"grpc|<(thread|mutex|atomic|condition_variable|future|chrono)>|absl/synchronization/"
          r"|absl/time/clock\.h")
FILES = r"|<(fstream|filesystem)>"
RULES = [
    Rule("filter/", PROTO + r"|embree", "the filter knows neither wire formats nor the ray tracer"),
    Rule("filter/baselines/", r"filter/(denoise|edges)/", "baselines stand on image and layers"),
    Rule("filter/manifold/", r"(filter|worker|server|client|proto|tests)/",
         "the published algorithm stands on kernels and image alone", r"filter/(manifold|kernels|image)/"),
    Rule("filter/opencl/", r"(filter|worker|server|client|proto|tests)/",
         "a device knows the published algorithm alone", r"filter/(opencl|manifold|kernels|image)/"),
    Rule("worker/render/", PROTO, "the renderer knows no wire formats"),
    Rule("worker/plan/", PROTO + r"|embree[34]/|filter/(?!image/)",
         "a plan knows the renderer and its scene alone"),
    Rule("worker/scene/", PROTO, "scenes know no wire formats"),
    Rule("worker/", r"server/", "workers share with the coordinator what makes a frame of its units",
         r"server/(job|film|picture)/"),
    Rule("server/scheduler/", IMPURE, "the scheduler is pure state: no threads, no clock; time is an argument"),
    Rule("client/autoscale/policy/", IMPURE + FILES,
         "the autoscaler's policy is pure: no threads, no clock, no files"),
    Rule("proto/retry/", IMPURE, "pauses are pure: no threads, no clock; the caller waits"),
    Rule("server/job/", IMPURE + FILES, "jobs are pure state: no threads, no clock, no files"),
    Rule("server/services/", r"server/coordinator/", "services see a coordinator as its roles",
         r"server/coordinator/roles\.h"),
    Rule("server/access/", r"server/(?!access/|ledger/)", "access control knows no jobs"),
    Rule("proto/identity/", r"(server|worker|client|tests)/", "identity is below all programs"),
    Rule("", r"tests/", "programs do not depend on their tests"),
]

# Helpers of tests, most of them headers alone: any test may include them, and who does links what they need.
SUPPORT = "tests/support"
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"][^>"]+[>"])', re.M)
CODE = (".h", ".cc")
TOP_FOLDERS = ("filter", "proto", "worker", "server", "client", "tests")


class Target(NamedTuple):
    name: str
    room: str
    sources: list  # relative to the source folder
    links: set  # names of our targets
    interface: set


def read_graph(text):
    """The targets of GRAPH_FILE that have sources, by name."""
    rows = [line.split("\t") for line in text.splitlines() if line]
    names = {row[0] for row in rows}

    def ours(value, with_private):
        found = set()
        for item in value.split(";"):
            private = "LINK_ONLY:" in item
            item = re.sub(r"\$<[A-Z_]+:|>", "", item).replace("::", "_")
            if item in names and (with_private or not private):
                found.add(item)
        return found

    targets = {}
    for name, kind, room, sources, links, interface in rows:
        if kind == "UTILITY":
            continue
        files = []
        for source in filter(None, sources.split(";")):
            path = source if pathlib.PurePath(source).parts[0] in TOP_FOLDERS else f"{room}/{source}"
            files.append(pathlib.PurePosixPath(normal(path)).as_posix())
        targets[name] = Target(name, room, files, ours(links, True), ours(interface, False))
    return targets


def normal(path):
    parts = []
    for part in path.split("/"):
        if part == "..":
            parts.pop()
        elif part not in ("", "."):
            parts.append(part)
    return "/".join(parts)


def reachable(targets, name):
    """What `name` may include: what it links, and what that hands on."""
    found = set()
    todo = list(targets[name].links)
    while todo:
        other = todo.pop()
        if other not in found and other in targets:
            found.add(other)
            todo += targets[other].interface
    return found


def circles(targets):
    """One line for each circle of links."""
    state = {}
    found = []

    def visit(name, path):
        state[name] = "open"
        for other in sorted(targets[name].links & targets.keys()):
            if state.get(other) == "open":
                found.append("targets link each other in a circle: " +
                             " -> ".join(path[path.index(other):] + [other]))
            elif other not in state:
                visit(other, path + [other])
        state[name] = "done"

    for name in sorted(targets):
        if name not in state:
            visit(name, [name])
    return found


def room_of(root, file):
    folder = pathlib.PurePosixPath(file).parent
    while not (root / folder / "CMakeLists.txt").is_file():
        folder = folder.parent
    return folder.as_posix()


def code_files(root):
    for top in TOP_FOLDERS:
        for path in sorted((root / top).rglob("*")):
            if path.suffix in CODE:
                yield path.relative_to(root).as_posix()


def sources_out_of_place(root, targets, files):
    """Rooms without a target, and sources of a target that lie in another room."""
    rooms_with_targets = {target.room for target in targets.values()}
    for room in sorted({room_of(root, file) for file in files if file.endswith(".cc")} - rooms_with_targets):
        if not is_project_of_its_own(root, room):
            yield f"{room}: has sources and no target"
    for target in targets.values():
        for source in sorted(set(target.sources) & set(files)):
            if room_of(root, source) != target.room:
                yield f"{target.name}: takes {source} from another room; link a target of that room"


def is_project_of_its_own(root, room):
    """Rooms this build registers no target of: projects and builds apart (tests/consumer, tests/fuzz)."""
    text = (root / room / "CMakeLists.txt").read_text()
    return "project(" in text or "LUMIFOLD_FUZZ" in text


def provider(root, header):
    """The room, or for generated headers the target, that a quoted or bracketed include names; None for
    others'."""
    if header.startswith("lumifold/v1/"):
        return "lumifold_services" if header.endswith(".grpc.pb.h") else "lumifold_proto"
    if (root / header).is_file() and header.split("/")[0] in TOP_FOLDERS:
        return room_of(root, header)
    return None


def included_by(root, file):
    """What follows each #include of `file`, brackets or quotes off, and whether it was in brackets."""
    for match in INCLUDE.finditer((root / file).read_text(errors="replace")):
        yield match.group(1)[1:-1], match.group(1)[0] == "<"


def forbidden(file, header, in_brackets):
    """The reasons of the rules that `file` breaks with this include."""
    for rule in RULES:
        if rule.folder == "" and file.startswith("tests/"):
            continue
        written = f"<{header}>" if in_brackets and "/" not in header else header
        if file.startswith(rule.folder) and re.match(rule.forbidden,
                                                     written) and not re.match(rule.allowed, header):
            yield rule.reason


def check(root, graph):
    """All that is wrong, one line each."""
    targets = read_graph(graph)
    files = list(code_files(root))
    problems = list(sources_out_of_place(root, targets, files)) + circles(targets)
    owners = {}  # a source's targets; for a room, all its targets: its headers may be anyone's
    for target in targets.values():
        for key in target.sources + [target.room]:
            owners.setdefault(key, []).append(target)
    for file in files:
        room = room_of(root, file)
        if is_project_of_its_own(root, room):
            continue
        allowed = {room, SUPPORT} if file.startswith("tests/") else {room}
        for target in owners.get(file) or owners.get(room, []):
            names = reachable(targets, target.name)
            allowed |= names | {targets[name].room for name in names}
        for header, in_brackets in included_by(root, file):
            problems += [
                f"{file}: includes {header}: {reason}" for reason in forbidden(file, header, in_brackets)
            ]
            other = provider(root, header)
            if other and other not in allowed and room != SUPPORT:
                problems.append(f"{file}: includes {header}, but links no target of {other}")
    return problems


def main():
    root, graph = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
    problems = check(root, graph.read_text())
    for problem in problems:
        print(problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
