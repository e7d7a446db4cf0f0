"""Runs pods as their manifests say, in real containers (crun): image from the Dockerfile's packages and
commands, user, read-only root, no capabilities, seccomp, volumes with the rights that Kubernetes gives them.
What is missing: limits of resources, since the tests cannot rely on a control group of their own, and
kubelet."""

import copy
import json
import os
import pathlib
import shutil
import subprocess

import programs

SECCOMP = pathlib.Path("/usr/share/containers/seccomp.json")
TOOLS = ("crun", "mmdebstrap", "ip", "unshare")
# crun does not take the mixed hierarchy of control groups that some machines have; it needs none for what is
# tested.
CRUN = [
    "unshare", "--mount", "sh", "-euc",
    "umount -R /sys/fs/cgroup; mount -t cgroup2 none /sys/fs/cgroup; exec \"$@\"", "sh", "crun",
    "--cgroup-manager=disabled"
]
MOUNTS = [
    {"destination": "/proc", "type": "proc", "source": "proc"},
    {
        "destination": "/dev", "type": "tmpfs", "source": "tmpfs",
        "options": ["nosuid", "mode=755", "size=65536k"]
    },
    {
        "destination": "/dev/pts", "type": "devpts", "source": "devpts",
        "options": ["nosuid", "noexec", "newinstance"]
    },
    {
        "destination": "/dev/shm", "type": "tmpfs", "source": "shm",
        "options": ["nosuid", "noexec", "nodev", "size=65536k"]
    },
]
MASKED = ["/proc/acpi", "/proc/kcore", "/proc/keys", "/proc/timer_list", "/proc/sched_debug", "/proc/scsi"]
READ_ONLY = ["/proc/bus", "/proc/fs", "/proc/irq", "/proc/sys", "/proc/sysrq-trigger"]


def are_available():
    return os.geteuid() == 0 and SECCOMP.exists() and all(map(shutil.which, TOOLS))


def runtime_default(refused=()):
    """The seccomp profile that container engines use by default, for a container without capabilities. The
    system calls `refused` fail with EPERM, as in older profiles."""
    profile = json.loads(SECCOMP.read_text())
    rules = []
    for rule in profile["syscalls"]:
        includes, excludes = rule.get("includes") or {}, rule.get("excludes") or {}
        if includes.get("caps") or "amd64" not in includes.get(
                "arches", ["amd64"]) or "amd64" in excludes.get("arches", []):
            continue
        kept = {key: rule[key] for key in ("action", "args", "errnoRet") if rule.get(key) is not None}
        if names := [name for name in rule["names"] if name not in refused]:
            rules.append({"names": names, **kept})
    return {
        "defaultAction": profile["defaultAction"],
        "defaultErrnoRet": 1 if refused else profile.get("defaultErrnoRet", 1),
        "architectures": ["SCMP_ARCH_X86_64"], "syscalls": rules
    }


def make_image(name, folder):
    """The root file system of an image: what its stages of the Dockerfile install and run, and the
    program."""
    image, stages = programs.images()[name], programs.stages()
    stage = next(s for s in stages.values() if s.of("ENTRYPOINT") == [f'["{image["program"]}"]'])
    root = pathlib.Path(folder) / name
    packages = ",".join(programs.runtime_packages(image["program"]))
    subprocess.run(
        ["mmdebstrap", "--quiet", "--variant=minbase", f"--include={packages}",
         programs.suite(), root],
        check=True)
    for command in [*stages[stage.base].of("RUN"), *stage.of("RUN")]:
        if "apt-get" not in command:
            subprocess.run(["chroot", root, "/bin/sh", "-euc", command], check=True)
    for words in map(str.split, stage.of("COPY")):
        if words[1].endswith(".packages"):
            continue
        shutil.copy(programs.BIN / pathlib.Path(words[1]).name, root / words[2].lstrip("/"))
    return root


class Pod:
    """A pod of a workload. `volumes` are folders by the volumes' names; its network is the namespace
    `network`."""

    def __init__(self, workload, name, *, images, folder, volumes, network, seccomp=None):
        self.spec, self.name, self.images = copy.deepcopy(workload["spec"]["template"]["spec"]), name, images
        self.folder, self.volumes, self.network = pathlib.Path(folder) / name, volumes, network
        self.namespace, self.seccomp = workload["metadata"]["namespace"], seccomp or runtime_default()
        self.folder.mkdir()
        self.log = self.folder / "log"
        group = self.spec["securityContext"]["fsGroup"]
        for volume in self.spec["volumes"]:
            if "emptyDir" in volume:
                path = self.volumes[volume["name"]] = self.folder / volume["name"]
                path.mkdir()
                give(path, group, 0o2777)
        self.process = None

    def start(self):
        for container in self.spec.get("initContainers", []):
            self.run(container, f"{self.name}-{container['name']}")
        bundle = self.bundle(self.spec["containers"][0], self.name)
        with open(self.log, "a") as log:
            self.process = subprocess.Popen([*self.crun(), "run", "--bundle", bundle, self.name],
                                            stdout=log,
                                            stderr=log)

    def run(self, container, name):
        done = subprocess.run([*self.crun(), "run", "--bundle",
                               self.bundle(container, name), name],
                              capture_output=True,
                              text=True)
        if done.returncode != 0:
            raise AssertionError(f"{name}: exit {done.returncode}\n{done.stdout}{done.stderr}")

    def execute(self, *command):
        """Runs a command in the container, as a probe does."""
        user = "{runAsUser}:{runAsGroup}".format(**self.spec["securityContext"])  # crun's own default is root
        return subprocess.run([*self.crun(), "exec", "--user", user, self.name, *command],
                              capture_output=True,
                              text=True)

    def probe(self, kind):
        return self.execute(*self.spec["containers"][0][kind]["exec"]["command"])

    def stop(self):
        """Sends SIGTERM and returns the exit code; SIGKILL after the pod's grace period."""
        subprocess.run([*self.crun(), "kill", self.name, "TERM"], check=True)
        try:
            return self.process.wait(timeout=self.spec["terminationGracePeriodSeconds"])
        except subprocess.TimeoutExpired:
            return self.kill()

    def kill(self):
        subprocess.run([*self.crun(), "kill", self.name, "KILL"], check=False, capture_output=True)
        return self.process.wait()

    def crun(self):
        return [*CRUN, f"--root={self.folder.parent}/crun"]

    def environment(self, container):
        fields = {"metadata.name": self.name, "metadata.namespace": self.namespace}
        found = {"PATH": "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"}
        for variable in container.get("env", []):
            found[variable["name"]] = variable.get("value") or fields[variable["valueFrom"]["fieldRef"]
                                                                      ["fieldPath"]]
        return found

    def bundle(self, container, name):
        """A folder with the container's config.json."""
        image = container["image"].split("/")[-1].split(":")[0]
        environment, security = self.environment(container), self.spec["securityContext"]
        words = [
            *(container.get("command") or [programs.images()[image]["program"]]), *container.get("args", [])
        ]
        for key, value in environment.items():
            words = [word.replace(f"$({key})", value) for word in words]
        hosts = self.folder / "hosts"
        hosts.write_text("127.0.0.1 localhost lumifold\n::1 localhost\n")
        binds = [(self.volumes[m["name"]], m["mountPath"], m.get("readOnly", False))
                 for m in container["volumeMounts"]]
        config = {
            "ociVersion": "1.0.0", "hostname": self.name, "root": {
                "path": str(self.images[image]), "readonly": container["securityContext"]
                                                             ["readOnlyRootFilesystem"]
            }, "process": {
                "user": {
                    "uid": security["runAsUser"], "gid": security["runAsGroup"],
                    "additionalGids": [security["fsGroup"]]
                }, "args": words, "env": [f"{key}={value}" for key, value in environment.items()], "cwd": "/",
                "noNewPrivileges": not container["securityContext"]["allowPrivilegeEscalation"],
                "capabilities": {}
            }, "mounts": [
                *MOUNTS, *({
                    "destination": to, "type": "bind", "source": str(source),
                    "options": ["rbind", "ro" if is_read_only else "rw", "nosuid", "nodev"]
                } for source, to, is_read_only in [*binds, (hosts, "/etc/hosts", True)])
            ], "linux": {
                "namespaces": [{"type": "pid"}, {"type": "mount"}, {"type": "ipc"}, {"type": "uts"},
                               {"type": "network", "path": f"/run/netns/{self.network}"}],
                "maskedPaths": MASKED, "readonlyPaths": READ_ONLY, "seccomp": self.seccomp
            }
        }
        bundle = self.folder / f"bundle-{name}"
        bundle.mkdir(exist_ok=True)
        (bundle / "config.json").write_text(json.dumps(config))
        return bundle


def give(path, group, mode):
    """The owner and rights that Kubernetes gives a volume: root's, and the pod's group."""
    os.chown(path, 0, group)
    path.chmod(mode)


def make_secret(folder, name, files, group):
    """A secret with these files, as a volume of `defaultMode: 0440`."""
    secret = pathlib.Path(folder) / name
    secret.mkdir()
    for file in files:
        shutil.copy(file, secret)
        give(secret / file.name, group, 0o440)
    return secret
