"""Runs the program `lumifold`: its command lines, its progress, its errors, and how it is cancelled. Needs no
Blender."""

import dataclasses
import functools
import json
import queue
import re
import signal
import subprocess
import sys
import threading

CANCELLED = 5  # exit code of a cancelled job
POLL_SECONDS = 0.1
CANCEL_SECONDS = 30  # to end after an interrupt, before the process is killed


class ProgramError(Exception):
    """The program failed; the text is its own."""


class Cancelled(Exception):
    """The user, or somebody at the farm, cancelled the job."""


@dataclasses.dataclass
class Quality:
    """How much is rendered, and how it is filtered."""

    until: str = "SAMPLES"  # or "ERROR", "TIME"
    samples: int = 64
    adaptive: bool = False
    target_error: float = 10
    seconds: float = 60
    max_bounces: int = 8
    seed: int = 0
    method: str = "default"

    def options(self):
        options = [
            "--spp", self.samples, "--max-bounces", self.max_bounces, "--seed", self.seed, "--method",
            self.method
        ]
        if self.until == "ERROR":
            options += ["--target-error", format_number(self.target_error)]
        elif self.until == "TIME":
            options += ["--time", f"{max(1, round(self.seconds))}s"]
        elif self.adaptive:
            options += ["--adaptive"]
        return list(map(str, options))


@dataclasses.dataclass
class Place:
    """Where it is rendered."""

    on_farm: bool = False
    server: str = ""
    profile: str = ""
    insecure: bool = False
    priority: int = 0
    threads: int = 0

    def connection(self):
        """Options of every command to a coordinator."""
        options = ["--server", self.server] if self.server else []
        options += ["--profile", self.profile] if self.profile else []
        return options + (["--insecure"] if self.insecure else [])


@dataclasses.dataclass
class Picture:
    """What is rendered: the options that go with an exported scene."""

    scene: str
    size: tuple
    frame: int = 0
    environment: str = ""
    f_stop: float = 0
    focus_metres: float = 0
    region: tuple = ()  # X0, Y0, X1, Y1 from the top left; all pixels without one
    transparent: bool = False  # without the environment behind the scene; shadow catchers show shadows
    folders: tuple = ()  # outside the scene's own, whose files the scene names

    def options(self):
        options = ["--size", "{}x{}".format(*self.size), "--frame", self.frame]
        options += ["--env", self.environment] if self.environment else []
        if self.f_stop:
            options += ["--f-stop", format_number(self.f_stop), "--focus", format_number(self.focus_metres)]
        options += ["--background", "transparent"] if self.transparent else []
        if self.region:
            options += ["--region", ",".join(map(str, self.region))]
        for folder in self.folders:
            options += ["--allow-dir", folder]
        return list(map(str, options))


def format_number(value):
    return f"{value:.9g}"


def render_command(program, place, picture, quality, output, preview):
    command = [program, "render", picture.scene, "-o", output, *picture.options(), *quality.options()]
    command += ["--threads", str(place.threads)] if place.threads else []
    return command + (["--preview", preview] if preview else [])


def submit_command(program, place, picture, quality):
    command = [
        program, "submit", picture.scene, "--json", *picture.options(), *quality.options(),
        *place.connection()
    ]
    return command + (["--priority", str(place.priority)] if place.priority else [])


def watch_command(program, place, job, frame, preview):
    return [program, "watch", job, "--json", "--preview", preview, "--frame", str(frame), *place.connection()]


def download_command(program, place, job, frame, output):
    return [program, "download", job, "-o", output, "--frame", str(frame), *place.connection()]


@functools.cache
def has_option(program, option):
    """Whether `lumifold render` has this option; older programs lack some."""
    done = subprocess.run([program, "render", "--help"],
                          capture_output=True,
                          text=True,
                          stdin=subprocess.DEVNULL)
    return option in done.stdout


def all_layers(program):
    """Options for an .exr with all layers that Blender's passes are made of."""
    return ["--exr", "full"] if has_option(program, "--exr") else []


@dataclasses.dataclass
class Progress:
    """What a line of the program says: a stage, and the share that is done if it is known."""

    stage: str
    share: float = None
    job: str = ""


def progress_of_text(line):
    """Progress of a line such as 'running 40% (2 workers)'; None if it is none."""
    found = re.match(r"(?:lumifold[^:]*: )?([a-z ]+?)(?: +(\d+)%.*)?$", line.strip())
    return Progress(found[1], int(found[2]) / 100 if found[2] else None) if found else None


def progress_of_job(job):
    """Progress of a job of one frame as `watch --json` prints it."""
    if job["state"] == "filtering":
        return Progress("filtering", job.get("frames_filtered"), job.get("job_id", ""))
    total = job.get("samples_total", 0)
    workers = job.get("workers", 0)
    text = job["state"] + (f", {workers} worker{'s' * (workers != 1)}" if job["state"] == "running" else "")
    return Progress(text, job.get("samples_done", 0) / total if total else None, job.get("job_id", ""))


def error_text(lines, code):
    """The program's error: its last line that is one, without the line that names the help."""
    named = [
        line for line in lines if line.startswith("lumifold") and "wrote" not in line and "--help" not in line
    ]
    return (named or lines or [f"lumifold ended with exit code {code}"])[-1]


def run(command,
        is_cancelled=lambda: False,
        on_output=lambda line: None,
        on_message=lambda line: None,
        on_wait=lambda: None):
    """Runs a command to its end. Lines of standard output and standard error go to `on_output` and
    `on_message`, `on_wait` is called between them, all in this thread. Raises Cancelled or ProgramError."""
    try:
        process = subprocess.Popen(
            list(map(str, command)), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, encoding="utf-8", errors="replace", bufsize=1,
        )
    except OSError as error:
        raise ProgramError(f"{command[0]}: {error.strerror}") from error
    lines = queue.Queue()
    readers = [
        threading.Thread(target=read_lines, args=(process, name, lines), daemon=True)
        for name in ("stdout", "stderr")
    ]
    for reader in readers:
        reader.start()
    messages = []
    try:
        follow(process, readers, lines, is_cancelled, {"stdout": on_output, "stderr": on_message}, messages,
               on_wait)
    finally:
        stop(process)
        for reader in readers:
            reader.join()
        process.stdout.close()
        process.stderr.close()
    if process.returncode == CANCELLED:
        raise Cancelled
    if process.returncode != 0:
        raise ProgramError(error_text(messages, process.returncode))
    return messages


def read_lines(process, name, lines):
    for line in getattr(process, name):
        lines.put((name, line.rstrip("\n")))


def follow(process, readers, lines, is_cancelled, handlers, messages, on_wait):
    while process.poll() is None or not lines.empty() or any(reader.is_alive() for reader in readers):
        if is_cancelled():
            raise Cancelled
        try:
            name, line = lines.get(timeout=POLL_SECONDS)
        except queue.Empty:
            on_wait()
            continue
        if name == "stderr":
            messages.append(line)
        handlers[name](line)


def stop(process):
    """Interrupts the process if it runs, as Ctrl-C does, and waits for its end."""
    if process.poll() is not None:
        return
    if sys.platform == "win32":
        process.terminate()  # a signal would also end Blender, which shares the console
    else:
        process.send_signal(signal.SIGINT)
    try:
        process.wait(CANCEL_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def render_here(program, place, picture, quality, output, preview, is_cancelled, on_progress, on_wait):
    """Renders with this machine's processors into the file `output`."""

    def on_message(line):
        progress = progress_of_text(line)
        if progress:
            on_progress(progress)

    command = render_command(program, place, picture, quality, output,
                             preview if has_option(program, "--preview") else "")
    command += all_layers(program)
    return warnings_of(run(command, is_cancelled, on_message=on_message, on_wait=on_wait))


def render_on_farm(program, place, picture, quality, output, preview, is_cancelled, on_progress, on_wait):
    """Submits a job, follows it, and downloads its result into the file `output`. Cancels the job if the
    render is cancelled."""
    submitted = []
    on_progress(Progress("uploading"))
    run(submit_command(program, place, picture, quality), is_cancelled, on_output=submitted.append)
    job = json.loads(submitted[-1])["job_id"]
    warnings = []

    def on_status(line):
        status = json.loads(line)
        warnings[:] = status.get("warnings", [])
        on_progress(progress_of_job(status))

    try:
        watch = watch_command(program, place, job, picture.frame, preview)
        run(watch, is_cancelled, on_output=on_status, on_wait=on_wait)
        on_progress(Progress("downloading", 1, job))
        download = download_command(program, place, job, picture.frame, output)
        run(download + all_layers(program), is_cancelled)
    except Cancelled:
        subprocess.run([program, "cancel", job, *place.connection()],
                       capture_output=True,
                       stdin=subprocess.DEVNULL)
        raise
    return warnings


def warnings_of(messages):
    """The warnings among the messages of `lumifold render`."""
    return [line.split("warning: ", 1)[1] for line in messages if "warning: " in line]
