"""A Slurm cluster of one node on this machine for one test: munged, slurmctld and slurmd, and where asked
slurmdbd over MariaDB. All of it on free ports and in a folder of its own. Needs root and the packages of
`deploy/setup.sh --tests`."""

import contextlib
import os
import pathlib
import secrets
import shutil
import signal
import socket
import subprocess

from farm import wait_until

# A slow machine with other work takes a few of them.
START_SECONDS = 120
DAEMONS = ("munged", "slurmctld", "slurmd")
ACCOUNTING_DAEMONS = ("slurmdbd", "mariadbd", "mariadb-install-db")

SLURM_CONF = """
ClusterName=farmtest
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ctld_port}
SlurmdPort={d_port}
AuthType=auth/munge
CredType=cred/munge
# How long a requeued job waits before it may start again: its old credentials must have expired (default:
# 120).
AuthInfo=socket={folder}/munge/socket,cred_expire={cred_expire}
SlurmUser=root
SlurmdUser=root
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
MailProg=/bin/true
JobAcctGatherType=jobacct_gather/linux
JobAcctGatherFrequency=task=5
SchedulerType=sched/backfill
SchedulerParameters=batch_sched_delay=1,sched_interval=1,bf_interval=1
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
# The node has as many processors as it says, not as many as this machine has.
SlurmdParameters=config_overrides
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
KillWait={kill_wait}
MinJobAge=3600
ReturnToService=2
JobRequeue=1
RequeueExit={requeue_exit}
{accounting}
NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 CPUs={cpus} RealMemory=2000 State=UNKNOWN
PartitionName=farm Nodes={node} Default=YES MaxTime=INFINITE State=UP PriorityTier=1
PartitionName=urgent Nodes={node} MaxTime=INFINITE State=UP PriorityTier=2 PreemptMode=OFF
"""
ACCOUNTING = """
AccountingStorageType=accounting_storage/slurmdbd
AccountingStorageHost=127.0.0.1
AccountingStoragePort={port}
# The socket of munge; the one of AuthInfo is not used here.
AccountingStoragePass={folder}/munge/socket
JobCompType=jobcomp/none
"""
SLURMDBD_CONF = """
DbdHost={host}
DbdAddr=127.0.0.1
DbdPort={port}
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
SlurmUser=root
PidFile={folder}/slurmdbd.pid
StorageType=accounting_storage/mysql
StorageHost=127.0.0.1
StoragePort={database_port}
StorageUser=slurm
StoragePass={password}
StorageLoc=slurm_acct
"""


def missing(accounting=False):
    """Why there can be no Slurm here; empty if there can."""
    if os.geteuid() != 0:
        return "not root"
    programs = DAEMONS + (ACCOUNTING_DAEMONS if accounting else ())
    absent = [program for program in programs if shutil.which(program) is None]
    return f"no {' and no '.join(absent)} (deploy/setup.sh --tests)" if absent else ""


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Slurm(contextlib.AbstractContextManager):
    """A cluster that runs jobs from the end of its constructor to the end of the `with`. `folder` exists, and
    is readable by all users. Partitions: `farm` (the default), and `urgent`, which preempts jobs of `farm` by
    requeueing them.

    cpus          of the node, which may be more than those of this machine
    accounting    with slurmdbd and MariaDB, so that sacct knows every job
    kill_wait     seconds from SIGTERM to SIGKILL where a job is cancelled, requeued, preempted or over its
                  time limit
    requeue_exit  exit codes with which a job is requeued"""

    def __init__(self, folder, cpus=8, accounting=False, kill_wait=20, requeue_exit=(4,), cred_expire=5):
        self.folder = pathlib.Path(folder)
        self.environment = {**os.environ, "SLURM_CONF": str(self.folder / "slurm.conf"),
                            "LUMIFOLD_ASSET_CACHE": ""}  # no files that outlive the test
        self.daemons = []
        for name in ("munge", "state", "spool", "log"):
            (self.folder / name).mkdir(mode=0o755, parents=True)
        self.host = socket.gethostname().split(".")[0]
        try:
            self.start_munge()
            database = self.start_accounting(
            ) if accounting else "AccountingStorageType=accounting_storage/none"
            (self.folder / "slurm.conf").write_text(
                SLURM_CONF.format(host=self.host,
                                  node=self.host,
                                  folder=self.folder,
                                  cpus=cpus,
                                  ctld_port=free_port(),
                                  d_port=free_port(),
                                  kill_wait=kill_wait,
                                  cred_expire=cred_expire,
                                  accounting=database,
                                  requeue_exit=",".join(map(str, requeue_exit))))
            self.start("slurmctld", "-D")
            self.start("slurmd", "-D")
            self.wait_for(lambda: "idle" in self.run("sinfo", "-h", "-o", "%T", check=False).stdout,
                          "an idle node")
        except BaseException:
            self.__exit__()
            raise

    # Daemons.

    def start(self, program, *arguments, **options):
        """Starts a daemon in the foreground, with its output in a log of its own."""
        with open(self.folder / "log" / f"{program}.log", "a") as log:
            self.daemons.append(
                subprocess.Popen([shutil.which(program), *map(str, arguments)],
                                 stdin=subprocess.DEVNULL,
                                 stdout=log,
                                 stderr=log,
                                 env=self.environment,
                                 **options))

    def wait_for(self, condition, what):
        """Waits until the condition holds, and fails at once if a daemon has ended."""
        def holds():
            for daemon in self.daemons:
                if daemon.poll() is not None:
                    raise AssertionError(f"{daemon.args[0]} ended with {daemon.returncode}")
            return condition()
        try:
            return wait_until(holds, what, START_SECONDS)
        except AssertionError as error:
            raise AssertionError(f"{error}\n{self.logs()}") from None

    def logs(self):
        return "".join(f"== {path.name}\n{path.read_text(errors='replace')[-5000:]}"
                       for path in sorted((self.folder / "log").iterdir()))

    def start_munge(self):
        folder = self.folder / "munge"
        key = folder / "key"
        key.touch(mode=0o600)
        key.write_bytes(secrets.token_bytes(1024))
        self.start("munged", "--foreground", f"--key-file={key}", f"--socket={folder}/socket",
                   f"--pid-file={folder}/pid", f"--log-file={folder}/log", f"--seed-file={folder}/seed")
        self.wait_for((folder / "socket").exists, "munged")

    def start_accounting(self):
        """MariaDB and slurmdbd; returns the lines of slurm.conf that use them."""
        data = self.folder / "database"
        user = "mysql"
        subprocess.run([
            "mariadb-install-db", "--no-defaults", f"--datadir={data}", f"--user={user}", "--skip-test-db",
            "--auth-root-authentication-method=socket"
        ],
                       check=True,
                       capture_output=True)
        password, port, database_port = secrets.token_hex(16), free_port(), free_port()
        (self.folder / "database.sql").write_text(
            "CREATE DATABASE slurm_acct;\n"
            f"CREATE USER slurm@'127.0.0.1' IDENTIFIED BY '{password}';\n"
            "GRANT ALL ON slurm_acct.* TO slurm@'127.0.0.1';\n")
        # Nothing here survives the test, so nothing is synced.
        self.start("mariadbd", "--no-defaults", f"--datadir={data}", f"--user={user}",
                   f"--socket={data}/socket", "--bind-address=127.0.0.1", f"--port={database_port}",
                   f"--init-file={self.folder}/database.sql", "--innodb-flush-log-at-trx-commit=0",
                   "--innodb-buffer-pool-size=128M", "--innodb-lock-wait-timeout=900", "--skip-name-resolve")
        self.wait_for(lambda: self.answers(database_port), "MariaDB")
        conf = self.folder / "slurmdbd.conf"
        conf.touch(mode=0o600)
        conf.write_text(
            SLURMDBD_CONF.format(host=self.host,
                                 port=port,
                                 folder=self.folder,
                                 database_port=database_port,
                                 password=password))
        self.start("slurmdbd", "-D")
        self.wait_for(lambda: self.answers(port), "slurmdbd")
        return ACCOUNTING.format(port=port, folder=self.folder)

    @staticmethod
    def answers(port):
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
            return True
        return False

    # Jobs.

    def run(self, command, *arguments, check=True, environment=None):
        """Runs one of Slurm's commands to its end; returns the finished process with text output."""
        done = subprocess.run([command, *map(str, arguments)],
                              capture_output=True,
                              text=True,
                              check=False,
                              timeout=START_SECONDS,
                              env={**self.environment, **(environment or {})})
        if check and done.returncode != 0:
            raise AssertionError(
                f"{command} {arguments}: exit {done.returncode}\n{done.stdout}{done.stderr}\n{self.logs()}")
        return done

    def submit(self, *arguments, environment=None):
        """sbatch with these arguments; returns the job's id. Jobs see `environment` and little else."""
        return self.run("sbatch", "--parsable", *arguments,
                        environment=environment).stdout.strip().split(";")[0]

    def jobs(self, *arguments):
        """Id and state of each job, ended ones included; an array counts as one job for each element that has
        started."""
        lines = self.run("squeue", "--noheader", "--states=all", "--format=%i %T",
                         *arguments).stdout.split("\n")
        return dict(line.split() for line in lines if line)

    def field(self, job, name):
        """A field of `scontrol show job`, such as ExitCode."""
        words = self.run("scontrol", "show", "--oneliner", "job", job).stdout.split()
        return next(word.partition("=")[2] for word in words if word.startswith(f"{name}="))

    def state(self, job):
        return self.field(job, "JobState")

    def wait_for_state(self, job, *states):
        self.wait_for(lambda: self.state(job) in states, f"job {job} is {' or '.join(states)}")

    def cancel_all(self):
        """Ends all jobs at once, and waits until nothing of them is left."""
        self.run("scancel", "--quiet", "--user=root", "--signal=KILL", "--full", check=False)
        self.run("scancel", "--quiet", "--user=root", check=False)
        wait_until(lambda: not self.run("squeue", "--noheader", check=False).stdout, "no job runs",
                   START_SECONDS)

    def __exit__(self, *_):
        if self.daemons and self.daemons[-1].args[0].endswith("slurmd"):
            with contextlib.suppress(subprocess.TimeoutExpired, AssertionError):
                self.cancel_all()
        for daemon in reversed(self.daemons):
            daemon.send_signal(signal.SIGTERM)
            try:
                daemon.wait(timeout=20)
            except subprocess.TimeoutExpired:
                daemon.kill()
                daemon.wait()
        return False
