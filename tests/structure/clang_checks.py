"""Checks with clang what gcc, which builds the project, cannot tell.

    clang_checks.py commands BUILD_FOLDER            writes BUILD_FOLDER/clang/compile_commands.json for
                                                     clang's tools: the build's, less what only gcc reads
                                                     (precompiled headers)
    clang_checks.py headers BUILD_FOLDER [--all]     each header compiles by itself; without --all only those
                                                     changed since LUMIFOLD_TIDY_BASE (default: the last
                                                     commit)
    clang_checks.py threads BUILD_FOLDER [--all]     -Wthread-safety finds nothing in files that hold a mutex;
                                                     without --all, and where Git says what
                                                     changed, only in those that the changes reach
    clang_checks.py warnings BUILD_FOLDER            everything compiles without warnings of clang

Compiles on all cores. Ends with 0 where all is well, 1 where not, 77 where there is no clang++, or
no Git that says what changed.
"""

import concurrent.futures
import json
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys

MUTEX = re.compile(r"absl/synchronization/mutex\.h|ABSL_GUARDED_BY|std::mutex|std::shared_mutex")

INCLUDE = re.compile(r'^#include "(.*)"$', re.MULTILINE)
INCLUDED = re.compile(r'^#include "(.*\.cc)"$', re.MULTILINE)

THREAD_SAFETY = ["-Wno-error", "-Wthread-safety", "-Werror=thread-safety"]


def clang_arguments(command):
    """The arguments of a compile command that clang reads, without compiler, input and output."""
    arguments = shlex.split(command)[1:]
    kept = []
    skip = False
    for i, argument in enumerate(arguments):
        if skip:
            skip = False
        elif argument == "-o" or (argument == "-include" and "cmake_pch" in arguments[i + 1]):
            skip = True
        elif argument.endswith(".cc"):  # the input
            pass
        elif argument.startswith(("-mmemset-strategy=", "-mmemcpy-strategy=", "-munroll-only-small-loops")):  # flags of gcc alone
            pass
        elif argument not in ("-c", "-Winvalid-pch", "-fpch-preprocess"):
            kept.append(argument)
    return kept


def read_commands(build):
    """The compile commands of sources that are files of the project's own kind: no precompiled headers. Where
    the build compiles several sources at a time, each has its command, and "merged" names the file that
    includes them."""
    commands = []
    for entry in json.loads((build / "compile_commands.json").read_text()):
        path = pathlib.Path(entry["file"])
        if path.parent.name == "Unity":
            commands += [{**entry, "file": source, "command": entry["command"].replace(entry["file"], source),
                          "merged": entry["file"]}
                         for source in INCLUDED.findall(path.read_text())]
        elif path.suffix == ".cc" and "precompiled" not in entry["file"]:
            commands.append(entry)
    return commands


def write_commands(build):
    entries = [{"directory": entry["directory"], "file": entry["file"],
                "arguments": ["clang++", *clang_arguments(entry["command"]), "-c", entry["file"]]}
               for entry in read_commands(build)]
    (build / "clang").mkdir(exist_ok=True)
    (build / "clang" / "compile_commands.json").write_text(json.dumps(entries, indent=1))


def git(root, *arguments):
    result = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=False)
    return result.stdout.split() if result.returncode == 0 else None


def changed(root, *patterns):
    """The files that are not as they were in LUMIFOLD_TIDY_BASE; None without a Git that says so."""
    base = os.environ.get("LUMIFOLD_TIDY_BASE", "HEAD~1")
    return git(root, "diff", "--name-only", "--diff-filter=d", base, "--", *patterns)


def reached(texts, start):
    """The files of `texts` that are in `start` or include one that is, directly or not."""
    included = {name: set(INCLUDE.findall(text)) for name, text in texts.items()}
    found, grown = set(), {*start} & texts.keys()
    while grown:
        found |= grown
        grown = {name for name, those in included.items() if those & grown} - found
    return found


def headers(root, everything):
    if not everything:
        return changed(root, "*.h")
    return git(root, "ls-files", "*.h") or [path.relative_to(root).as_posix()
                                            for path in sorted(root.glob("[!b]*/**/*.h"))]


def header_jobs(root, build, everything):
    """One compilation a header, with the flags of all targets together: which target may include what is
    checked by include_direction.py."""
    flags = []
    for entry in read_commands(build):
        arguments = clang_arguments(entry["command"])
        pairs = [arguments[i:i + 2] for i, argument in enumerate(arguments) if argument == "-isystem"]
        singles = [[argument] for argument in arguments if re.match(r"-[ID]", argument)]
        flags += [pair for pair in pairs + singles if pair not in flags]
    common = [
        "-std=c++20", "-Wall", "-Wextra", "-Werror", "-Wno-pragma-once-outside-header",
        "-Wno-unused-function", "-Wno-unused-const-variable"
    ]
    for header in headers(root, everything):
        yield header, ["-fsyntax-only", "-x", "c++", *common, *sum(flags, []), str(root / header)]


def thread_jobs(root, build, everything):
    """The compilations of sources that hold a mutex or include a header that does: several at a time where
    the build does so, because nearly all of the time goes into the headers of gRPC."""
    texts = {
        path.relative_to(root).as_posix(): path.read_text()
        for top in ("filter", "proto/rpc", "worker", "server", "client")
        for path in sorted((root / top).rglob("*.*"))
        if path.suffix in (".h", ".cc")
    }
    with_mutex = {name for name, text in texts.items() if MUTEX.search(text)}
    changes = None if everything else changed(root, "*.h", "*.cc")
    wanted = texts.keys() if changes is None else reached(texts, changes)
    jobs = {}
    for entry in read_commands(build):
        name = os.path.relpath(entry["file"], root)
        if name not in wanted:
            continue
        own_header = name[:-len(".cc")] + ".h"
        if name in with_mutex or any(
                f'"{header}"' in texts[name] for header in with_mutex) or own_header in with_mutex:
            compiled = entry.get("merged", entry["file"])
            jobs[os.path.relpath(compiled, root)] = [
                "-fsyntax-only", *clang_arguments(entry["command"]), *THREAD_SAFETY, compiled]
    return jobs.items()


def warning_jobs(root, build):
    """One compilation for each that the build has, with its warnings."""
    jobs = {}
    for entry in read_commands(build):
        compiled = entry.get("merged", entry["file"])
        jobs[os.path.relpath(
            compiled, root)] = ["-fsyntax-only", *clang_arguments(entry["command"]), "-Werror", compiled]
    return jobs.items()


def compile_all(jobs, directory):
    """Compiles each job, prints what fails, and gives the number of failures."""
    def compile_one(job):
        result = subprocess.run(["clang++", *job[1]],
                                cwd=directory,
                                capture_output=True,
                                text=True,
                                check=False)
        return job[0], result.returncode, result.stderr
    failed = 0
    count = 0
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for name, code, errors in pool.map(compile_one, jobs):
            count += 1
            if code != 0:
                failed += 1
                print(f"{name}:\n{errors}", flush=True)
    print(f"{count} files compiled, {failed} with errors")
    return failed


def main():
    mode, build = sys.argv[1], pathlib.Path(sys.argv[2]).resolve()
    root = pathlib.Path(__file__).resolve().parents[2]
    if mode == "commands":
        write_commands(build)
        return 0
    if not shutil.which("clang++"):
        print("skipped: no clang++")
        return 77
    everything = "--all" in sys.argv[3:]
    if mode == "headers" and headers(root, everything) is None:
        print("skipped: Git does not say which headers changed")
        return 77
    jobs = {"threads": lambda: thread_jobs(root, build, everything), "warnings": lambda: warning_jobs(root, build),
            "headers": lambda: header_jobs(root, build, everything)}[mode]()
    return 1 if compile_all(jobs, build) else 0


if __name__ == "__main__":
    sys.exit(main())
