"""Fakes of squeue, sbatch and scancel, in front of all others on PATH. They keep a queue in a file, with a
line for each job as squeue prints it, and run no job. tests/support/slurm.py starts a real Slurm."""

import fcntl
import os

FARM_NAME = "test"
# A line of the queue is "%A|%T|%S|%e|%C|%r|%j" of squeue. Two programs may call at the same time: hence
# flock.
COMMANDS = {
    "squeue": 'flock -s "$folder/lock" cat "$folder/queue"',
    "sbatch": """
for word; do case $word in --job-name=*) name=${word#*=};; esac; done
exec 9>>"$folder/lock"
flock 9
job=$(($(cat "$folder/last") + 1))
echo $job | tee "$folder/last"
echo "$job|PENDING|N/A|N/A|1|Priority|$name" >>"$folder/queue"
""",
    "scancel": """
exec 9>>"$folder/lock"
flock 9
for word; do case $word in [0-9]*) sed -i "/^$word|/d" "$folder/queue";; esac; done
""",
}


class FakeSlurm:
    def __init__(self, folder):
        self.folder = folder / "slurm"
        self.bin = self.folder / "bin"
        self.bin.mkdir(parents=True)
        self.script = self.folder / "worker.sbatch"
        for name, text in (("queue", ""), ("last", "100"), ("calls", ""), ("lock", ""), ("worker.sbatch", "")):
            (self.folder / name).write_text(text)
        for command in COMMANDS:
            self.install(command)
        self.path = os.environ["PATH"]
        os.environ["PATH"] = f"{self.bin}:{self.path}"

    def close(self):
        os.environ["PATH"] = self.path

    def engine_arguments(self):
        return ["--farm", FARM_NAME, "--script", self.script]

    def answer(self, command, script):
        """From now on the command runs this shell script."""
        file = self.bin / f"{command}.new"
        file.write_text(
            f"#!/bin/sh\nfolder={self.folder}\necho \"{command} $*\" >>\"$folder/calls\"\n{script}\n")
        file.chmod(0o755)
        file.replace(self.bin / command)  # for those who are calling it

    def install(self, command):
        self.answer(command, COMMANDS[command])

    def remove(self, command):
        (self.bin / command).unlink()

    def add_running(self, job, slot):
        with open(self.folder / "queue", "a") as queue:
            queue.write(f"{job}|RUNNING|2024-01-01T00:00:00|N/A|1|None|lumifold-{FARM_NAME}-{slot}\n")

    def jobs(self):
        """Names of the jobs that have not ended, in order."""
        with open(self.folder / "lock") as lock:
            fcntl.flock(lock, fcntl.LOCK_SH)
            return sorted(line.split("|")[-1] for line in (self.folder / "queue").read_text().splitlines())

    def calls(self, command=""):
        """The command lines so far."""
        return [line for line in (self.folder / "calls").read_text().splitlines() if line.startswith(command)]
