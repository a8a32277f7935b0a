#!/usr/bin/env python3
"""Kills a sweep of real maneuvers again and again, and holds what comes out against an undisturbed run.

    cargo build --release && python3 benches/sweep/kill.py [--program target/release/slipdrive] [--rows 2000] [--full /path]

- An undisturbed run of 2,000 maneuvers on all cores.
- The same, killed (SIGKILL) at five random moments and gone on with each time, a torn line appended after the first two kills: every row
  must be there once, equal but for `solve_time_s`. The seed of the moments is printed.
- Two shards, one after the other, together equal to the undisturbed run.
- The same with one thread.
- A disk that becomes full: a limit of the size of files (RLIMIT_FSIZE) and, where `--full` names a folder on a small file system, that:
  exit code 75, no torn line kept, and the run goes on once there is room.
"""

import argparse
import glob
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time

TO_BE_CONTINUED = 75


def sweep_file(rows):
    """Straight and curved drives from one start each, over friction, distance and offset."""
    frictions, offsets = 10, 4
    return {
        "job": "solve",
        "request": {"grid": {"steps": 60, "control_intervals": 12}, "solver": {"starts": 1}, "view": "plan"},
        "axes": [
            {"field": "robot.wheel_friction_coefficient", "from": 0.2, "to": 0.65, "count": frictions},
            {"field": "maneuver.goal.x_m", "from": 0, "to": 0.6, "count": offsets},
            {"field": "maneuver.goal.y_m", "from": 1, "to": 6, "count": rows // (frictions * offsets)},
        ],
        "chunk_rows": 16,
        "columns": ["status", "final_time_s"],
    }


def rows_of(*folders):
    """All rows by key, each once, without what clocks say."""
    rows = {}
    for part in sorted(part for folder in folders for part in glob.glob(f"{folder}/rows-*.jsonl")):
        with open(part) as lines:
            for line in lines:
                row = json.loads(line)
                assert row["key"] not in rows, f"{row['key']} is there twice"
                row["answer"]["report"].pop("solve_time_s")
                rows[row["key"]] = row
    return rows


class Runs:
    def __init__(self, program, file):
        self.program, self.file = program, file

    def command(self, folder, *flags):
        return [self.program, "sweep", self.file, "--out", folder, *flags]

    def done(self, folder, *flags):
        began, before = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(self.command(folder, *flags), check=True, stderr=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return time.monotonic() - began, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def killed(self, folder, seconds):
        child = subprocess.Popen(self.command(folder), stderr=subprocess.DEVNULL)
        try:
            child.wait(timeout=seconds)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGKILL)
            child.wait()


def count_lines(folder):
    return sum(open(part, "rb").read().count(b"\n") for part in glob.glob(f"{folder}/rows-*.jsonl"))


def tear(folder):
    with open(sorted(glob.glob(f"{folder}/rows-*.jsonl"))[-1], "a") as part:
        part.write('{"key":"0123456789abcdef-12","row":12,"axes":{"maneuver.goal.y_m":1.5},"answer":{"status":"conv')


def full_by_limit(runs, folder, bytes_allowed):
    """A run that may write files of so many bytes."""

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (bytes_allowed, bytes_allowed))

    run = subprocess.run(
        runs.command(folder), preexec_fn=limited, restore_signals=False, stderr=subprocess.PIPE, text=True
    )
    return run


def checked_full(name, run, folder):
    kept = count_lines(folder)
    said = run.stderr.strip().splitlines()[-1]
    assert run.returncode == TO_BE_CONTINUED, (run.returncode, run.stderr)
    parts = [open(part, "rb").read() for part in glob.glob(f"{folder}/rows-*.jsonl")]
    assert all(part.endswith(b"\n") or not part for part in parts), "a torn line is kept"
    print(f"{name}: exit code {run.returncode}, {kept} rows kept; {said}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="target/release/slipdrive")
    parser.add_argument("--rows", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--full", help="a folder on a file system that is too small for all rows")
    arguments = parser.parse_args()
    moments = random.Random(arguments.seed)
    work = tempfile.mkdtemp(prefix="slipdrive-sweep-")
    print(f"seed {arguments.seed}, {os.cpu_count()} cores")
    file = f"{work}/sweep.json"
    with open(file, "w") as output:
        json.dump(sweep_file(arguments.rows), output)
    runs = Runs(arguments.program, file)

    whole = f"{work}/whole"
    wall, cpu = runs.done(whole)
    expected = rows_of(whole)
    assert len(expected) == arguments.rows, len(expected)
    statuses = {}
    for row in expected.values():
        statuses[row["answer"]["status"]] = statuses.get(row["answer"]["status"], 0) + 1
    size = sum(os.path.getsize(part) for part in glob.glob(f"{whole}/rows-*.jsonl"))
    print(f"undisturbed: {len(expected)} rows in {wall:.1f} s, {cpu:.1f} CPU s, {size / len(expected):.0f} bytes a row; {statuses}")

    killed, counts = f"{work}/killed", []
    for kill in range(5):
        runs.killed(killed, moments.uniform(0.05, 0.25) * wall)
        counts.append(count_lines(killed))
        if kill < 2:
            tear(killed)
    assert counts[-1] < arguments.rows, "the kills came too late"
    runs.done(killed)
    assert rows_of(killed) == expected
    print(f"killed five times with {counts} rows, then gone on with: equal")

    shards = [f"{work}/shard-{index}" for index in range(2)]
    for index, shard in enumerate(shards):
        runs.done(shard, "--shard", f"{index}/2")
    assert rows_of(*shards) == expected
    print(f"two shards of {[len(rows_of(shard)) for shard in shards]} rows: together equal")

    single = f"{work}/single"
    wall_of_one, cpu_of_one = runs.done(single, "--threads", "1")
    assert rows_of(single) == expected
    print(f"one thread: equal, {wall_of_one:.1f} s, {cpu_of_one:.1f} CPU s")

    limited = f"{work}/limited"
    checked_full("file size limit", full_by_limit(runs, limited, size // 3), limited)
    runs.done(limited)
    assert rows_of(limited) == expected
    print("gone on with room: equal")

    if arguments.full:
        crowded = f"{arguments.full}/sweep"
        run = subprocess.run(runs.command(crowded), stderr=subprocess.PIPE, text=True)
        checked_full("full file system", run, crowded)
        shutil.copytree(crowded, f"{work}/moved")
        runs.done(f"{work}/moved")
        assert rows_of(f"{work}/moved") == expected
        print("moved to where there is room, and gone on with: equal")
    shutil.rmtree(work)
    return 0


if __name__ == "__main__":
    sys.exit(main())
