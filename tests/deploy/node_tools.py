"""Runs the scripts of this folder under Node, with the packages of package-lock.json."""

import fcntl
import hashlib
import json
import os
import pathlib
import shutil
import subprocess

SOURCE = pathlib.Path(__file__).parent
EXAMPLES = pathlib.Path(__file__).parents[2] / "docs/examples"
# In the build folder, beside the programs: packages are installed once.
FOLDER = pathlib.Path(os.environ["LUMIFOLD_BIN"]).parent / "deploy_packages"


def is_available():
    return shutil.which("npm") is not None


def install():
    """Installs the packages where they are not those of the lock file, and copies the scripts beside them."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    with open(FOLDER / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for file in [*SOURCE.glob("*.mjs"), *EXAMPLES.glob("*.mjs"), *SOURCE.glob("package*.json")]:
            # Another test may run the script at this moment: it is replaced whole, never seen half written.
            os.replace(shutil.copy(file, FOLDER / "arriving"), FOLDER / file.name)
        digest = hashlib.sha256((SOURCE / "package-lock.json").read_bytes()).hexdigest()
        stamp = FOLDER / "installed"
        if stamp.exists() and stamp.read_text() == digest:
            return
        subprocess.run(["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund"], cwd=FOLDER, check=True,
                       capture_output=True)
        stamp.write_text(digest)


def run(script, *arguments, stdin=""):
    done = subprocess.run(["node", script, *map(str, arguments)],
                          cwd=FOLDER,
                          input=stdin,
                          text=True,
                          capture_output=True)
    if done.returncode != 0:
        raise ValueError(done.stderr)
    return done.stdout


def render(folder):
    """The manifests of a kustomization."""
    return json.loads(run("render.mjs", pathlib.Path(folder).resolve()))


def schema_faults(manifests):
    """What the schemas of the Kubernetes API and of KEDA object to."""
    return run("check_kubernetes.mjs", stdin=json.dumps(manifests)).splitlines()


def read_compose(text):
    """A Compose file and what its schema objects to."""
    found = json.loads(run("check_compose.mjs", stdin=text))
    return found["compose"], found["faults"]
