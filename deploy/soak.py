#!/usr/bin/env python3
"""Keeps one worker busy with mixed load and watches what the process holds.

soak.py [--binary target/release/slipdrive] [--load target/release/examples/mixed_load] [--seconds 900] [--callers 6]

Fails when an answer was unexpected, when the solver panicked, when the server did not end in order, or when the resident
memory of the last quarter (mean) is above that of the second by more than 5 % and more than 8 MB.
"""
import argparse, subprocess, sys, time, urllib.request

ap = argparse.ArgumentParser()
ap.add_argument("--binary", default="target/release/slipdrive")
ap.add_argument("--load", default="target/release/examples/mixed_load")
ap.add_argument("--seconds", type=float, default=900)
ap.add_argument("--callers", type=int, default=6)
args = ap.parse_args()

HTTP, GRPC, ADMIN = "127.0.0.1:28280", "127.0.0.1:28251", "127.0.0.1:28290"


def metrics():
    with urllib.request.urlopen(f"http://{ADMIN}/metrics", timeout=30) as answer:
        lines = answer.read().decode().splitlines()
    return {name: float(value) for name, value in (line.rsplit(" ", 1) for line in lines if not line.startswith("#"))}


def total(sample, family):
    return sum(value for name, value in sample.items() if name.split("{")[0] == family)


flags = ["--http", HTTP, "--grpc", GRPC, "--admin", ADMIN, "--workers", "1", "--queue-length", "16", "--log", "warn"]
server = subprocess.Popen([args.binary, "serve", *flags])
try:
    for _ in range(300):
        try:
            first = metrics()
            break
        except OSError:
            time.sleep(0.1)
    begin = time.time()
    load = subprocess.Popen(
        [args.load, "--http", HTTP, "--grpc", GRPC, "--seconds", str(args.seconds), "--callers", str(args.callers)],
        stdout=subprocess.PIPE, text=True)
    series = []
    while load.poll() is None:
        sample = metrics()
        series.append((time.time() - begin, sample))
        time.sleep(1)
    summary = load.stdout.read().strip().splitlines()
    last = metrics()
finally:
    server.terminate()
    exit_code = server.wait(60)

print("\n".join(summary))
elapsed = series[-1][0]
quarters = [[s for t, s in series if q * elapsed / 4 <= t < (q + 1) * elapsed / 4] for q in range(4)]
mean = lambda quarter, name: sum(s[name] for s in quarter) / len(quarter)
memory = [mean(q, "process_resident_memory_bytes") / 1e6 for q in quarters]
files = [max(s["process_open_fds"] for s in q) for q in quarters]
busy = sum(s['slipdrive_workers{state="busy"}'] for _, s in series) / len(series)
solves = total(last, "slipdrive_solves_total")
work = total(last, "slipdrive_solve_duration_seconds_sum")
cpu = last["process_cpu_seconds_total"] - first["process_cpu_seconds_total"]
print(f"{elapsed:.0f} s, {solves:.0f} solves, {work:.0f} s of them on the worker, {cpu:.0f} s of CPU, busy {busy:.0%} of the samples")
print(f"resident memory by quarter, MB: {', '.join(f'{value:.1f}' for value in memory)}")
print(f"most open files by quarter: {', '.join(f'{value:.0f}' for value in files)}")
print(f"threads: {last['process_threads']:.0f}, panics: {last['slipdrive_solver_panics_total']:.0f}, exit code {exit_code}")
faults = []
if memory[3] > max(memory[1] * 1.05, memory[1] + 8):
    faults.append("memory grew")
if load.returncode != 0:
    faults.append("an answer was unexpected")
if last["slipdrive_solver_panics_total"] or exit_code != 0:
    faults.append("the server failed")
print("\n".join(f"FAIL  {fault}" for fault in faults) or "ok")
sys.exit(1 if faults else 0)
