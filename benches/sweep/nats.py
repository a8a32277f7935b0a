#!/usr/bin/env python3
"""Sweeps over NATS while all that can fail does: each row must have exactly one result in the end.

    cargo build --release --features nats
    python3 benches/sweep/nats.py --server /usr/sbin/nats-server [--program target/release/slipdrive] [--noops 10000] [--solves 500] ...

Each scenario has a server of its own on loopback, and ends with the same check: `sweep --out` ends by itself, its folder has every row
once, and the answers equal those of a sweep without a broker but for `solve_time_s`.

- `noops`, `solves`: four workers; workers and the broker are killed (SIGKILL) at random and started again, a worker is stopped (SIGSTOP)
  for longer than its lease, chunks are sent again past the server's own check, and the queue is too small for all chunks.
- `full`: the stream of results becomes full; the workers wait until it is larger.
- `poison`: the worker is killed each time it begins a certain row. The row must be named, the rest of its chunk answered.
- `cancel`: a sweep is cancelled while it runs, then published again.
- `cluster`: three servers; one is killed and stays away.
- `cost`: rows per CPU second of two workers against two threads without a broker, in turn; CPU time of the server beside.
"""

import argparse
import collections
import glob
import json
import os
import random
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time

LEASE_S = 2


class Nats:
    """The few words of the protocol that are needed here; what is subscribed to goes to `hear(subject, payload)`."""

    def __init__(self, port, hear=lambda subject, payload: None):
        self.port, self.hear, self.subjects, self.socket = port, hear, [], None
        self.lock, self.answers, self.ended = threading.Lock(), collections.deque(), False
        self.thread = threading.Thread(target=self.read, daemon=True)
        self.thread.start()

    def connect(self):
        self.socket = socket.create_connection(("127.0.0.1", self.port), timeout=60)
        file = self.socket.makefile("rb")
        file.readline()
        self.send(b'CONNECT {"verbose":false,"pedantic":false,"headers":true}\r\n')
        for number, subject in enumerate(["script.answer", *self.subjects]):
            self.send(b"SUB %s %d\r\n" % (subject.encode(), number))
        return file

    def read(self):
        while not self.ended:
            try:
                file = self.connect()
                while line := file.readline():
                    words = line.split()
                    if words and words[0] in (b"MSG", b"HMSG"):
                        content = file.read(int(words[-1]))
                        file.read(2)
                        head = int(words[-2]) if words[0] == b"HMSG" else 0
                        subject, payload = words[1].decode(), content[head:]
                        self.answers.append(payload) if subject == "script.answer" else self.hear(subject, payload)
                    elif words and words[0] == b"PING":
                        self.send(b"PONG\r\n")
            except OSError:
                pass
            time.sleep(0.1)

    def send(self, text):
        with self.lock:
            self.socket.sendall(text)

    def subscribe(self, subject):
        self.subjects.append(subject)
        self.send(b"SUB %s %d\r\n" % (subject.encode(), len(self.subjects)))

    def publish(self, subject, payload, reply=""):
        self.send(b"PUB %s %s %d\r\n%s\r\n" % (subject.encode(), reply.encode(), len(payload), payload))

    def ask(self, subject, value=None):
        self.answers.clear()
        self.publish(subject, json.dumps(value).encode() if value is not None else b"", "script.answer")
        ends = time.monotonic() + 10
        while not self.answers:
            assert time.monotonic() < ends, f"{subject} is not answered"
            time.sleep(0.01)
        return json.loads(self.answers.popleft())

    def close(self):
        self.ended = True
        self.socket.close()


class Server:
    """A server that can be killed and started again on the same store."""

    def __init__(self, program, folder, port, more=()):
        self.command = [program, "-a", "127.0.0.1", "-p", str(port), "-js", "-sd", f"{folder}/store-{port}", *more]
        self.port, self.log = port, open(f"{folder}/server-{port}.log", "ab")
        self.start()

    def start(self):
        self.process = subprocess.Popen(self.command, stdout=self.log, stderr=self.log)
        ends = time.monotonic() + 20
        while time.monotonic() < ends:
            try:
                return socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
            except OSError:
                time.sleep(0.05)
        raise AssertionError("the server does not start")

    def kill(self):
        self.process.kill()
        self.process.wait()

    def cpu_s(self):
        fields = open(f"/proc/{self.process.pid}/stat").read().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Runs:
    def __init__(self, arguments, folder):
        self.program, self.folder, self.arguments = os.path.abspath(arguments.program), folder, arguments
        self.workers, self.events, self.logs = {}, [], 0

    def sweep(self, *words, check=True):
        done = subprocess.run([self.program, "sweep", *map(str, words)], capture_output=True, text=True)
        assert not check or done.returncode == 0, f"{words}: {done.returncode}: {done.stderr[-2000:]}"
        return done

    def started(self, *words):
        self.logs += 1
        log = open(f"{self.folder}/log-{self.logs}-{words[0]}", "wb")
        return subprocess.Popen([self.program, *map(str, words)], stdout=log, stderr=log)

    def worker(self, name, url, *more):
        self.workers[name] = self.started("worker", "--nats", url, "--threads", 1, "--lease-s", LEASE_S, *more)

    def kill_worker(self, name):
        self.workers[name].kill()
        self.workers[name].wait()

    def end_workers(self):
        for worker in self.workers.values():
            worker.send_signal(signal.SIGCONT)
            worker.terminate()
        codes = [worker.wait(timeout=60) for worker in self.workers.values()]
        assert codes == [0] * len(codes), f"workers ended with {codes}"
        self.workers.clear()

    def file(self, name, sweep):
        path = f"{self.folder}/{name}.json"
        with open(path, "w") as file:
            json.dump(sweep, file)
        return path


def noops(count):
    request = {"view": "plan", "grid": {"steps": 40, "control_intervals": 8}, "solver": {"starts": 1}, "maneuver": {"goal": {"x_m": 0, "y_m": 0}}}
    axes = [{"field": "solver.seed", "from": 0, "to": count - 1, "count": count}]
    return {"job": "solve", "request": request, "axes": axes, "chunk_rows": 1}


def solves(chunks, chunk_rows=4):
    request = {"view": "plan", "grid": {"steps": 60, "control_intervals": 12}, "solver": {"starts": 1}}
    axes = [{"field": "maneuver.goal.y_m", "from": 1, "to": 6, "count": chunks * chunk_rows}]
    return {"job": "solve", "request": request, "axes": axes, "chunk_rows": chunk_rows}


def rows_of(folder):
    """All rows by number, each once, without what clocks say."""
    rows = {}
    for part in sorted(glob.glob(f"{folder}/rows-*.jsonl")):
        with open(part) as lines:
            for line in lines:
                row = json.loads(line)
                assert row["row"] not in rows, f"row {row['row']} is there twice"
                if "answer" in row:
                    row["answer"]["report"].pop("solve_time_s")
                rows[row["row"]] = row
    return rows


def count_in_stream(nats, stream):
    return nats.ask(f"$JS.API.STREAM.INFO.{stream}")["state"]["messages"]


def chaos(runs, server, name, sweep):
    """Everything at once, until the sweep is complete."""
    draw, url = random.Random(runs.arguments.seed), f"nats://127.0.0.1:{server.port}"
    file, out, local = runs.file(name, sweep), f"{runs.folder}/{name}", f"{runs.folder}/{name}-local"
    runs.sweep(file, "--out", local)
    again = collections.deque(maxlen=2000)
    nats = Nats(server.port, lambda subject, payload: again.append((subject, payload)))
    time.sleep(0.3)
    nats.subscribe("slipdrive.chunk.>")
    for index in range(4):
        runs.worker(index, url, "--nats-chunks-mib", 1)
    begun = time.monotonic()
    collecting = runs.started("sweep", file, "--nats", url, "--nats-chunks-mib", 1, "--out", out)
    done = collections.Counter()
    # A server that is away when the first chunk is to be published ends the command, as it should.
    while not again and collecting.poll() is None:
        time.sleep(0.01)
    while collecting.poll() is None:
        time.sleep(draw.uniform(0.3, 1.5))
        if time.monotonic() - begun > runs.arguments.chaos_s:
            # What a server has forgotten is found by workers that live for half a minute without a chunk.
            continue
        what = draw.choices(["worker", "broker", "slow", "duplicates"], [4, 1, 1, 4])[0]
        index = draw.randrange(4)
        done[what] += 1
        if what == "worker":
            runs.kill_worker(index)
            runs.worker(index, url)
        elif what == "broker":
            server.kill()
            time.sleep(draw.uniform(0, 2))
            server.start()
        elif what == "slow":
            runs.workers[index].send_signal(signal.SIGSTOP)
            threading.Timer(LEASE_S * 2, runs.workers[index].send_signal, [signal.SIGCONT]).start()
        else:
            try:
                for subject, payload in draw.sample(list(again), min(len(again), 20)):
                    nats.publish(subject, payload)
            except OSError:
                pass
    assert collecting.returncode == 0, f"the sweep ended with {collecting.returncode}"
    took = time.monotonic() - begun
    rows, expected = rows_of(out), rows_of(local)
    differ = [row for row in expected if rows.get(row) != expected[row]]
    assert not differ and len(rows) == len(expected), f"{len(differ)} of {len(expected)} rows differ, such as {differ[:3]}"
    time.sleep(1)
    in_stream = count_in_stream(nats, "slipdrive-results")
    assert in_stream == len(expected), f"{in_stream} results in the stream"
    # What was sent last may be redelivered still: rows that have results cost a look.
    ends = time.monotonic() + 100
    while (left := count_in_stream(nats, "slipdrive-chunks")) > 0 and time.monotonic() < ends:
        time.sleep(1)
    assert left == 0, f"{left} chunks stay in the queue: {nats.ask('$JS.API.CONSUMER.LIST.slipdrive-chunks')}"
    nats.close()
    runs.end_workers()
    print(f"{name}: {len(rows)} rows, each once and as without a broker, in {took:.0f} s; {dict(done)}", flush=True)


def full(runs, server):
    url, count = f"nats://127.0.0.1:{server.port}", 1500
    file, out = runs.file("full", noops(count)), f"{runs.folder}/full"
    nats = Nats(server.port)
    time.sleep(0.3)
    for index in range(2):
        runs.worker(index, url, "--nats-results-mib", 1)
    time.sleep(1)
    collecting = runs.started("sweep", file, "--nats", url, "--out", out)
    before = -1
    while (kept := count_in_stream(nats, "slipdrive-results")) != before or kept == 0:
        before = kept
        time.sleep(3)
    assert kept < count and collecting.poll() is None, f"{kept} results fit"
    config = nats.ask("$JS.API.STREAM.INFO.slipdrive-results")["config"]
    answer = nats.ask("$JS.API.STREAM.UPDATE.slipdrive-results", {**config, "max_bytes": 64 << 20})
    assert "error" not in answer, answer
    assert collecting.wait(timeout=120) == 0
    assert len(rows_of(out)) == count
    nats.close()
    runs.end_workers()
    print(f"full: stood at {kept} of {count} rows, complete once the stream was larger", flush=True)


def poison(runs, server):
    url = f"nats://127.0.0.1:{server.port}"
    sweep = solves(1)
    # The third row takes long enough to be killed in it.
    sweep["axes"] = [{"paired": [
        {"field": "maneuver.goal.y_m", "values": [1, 1.5, 5, 2]},
        {"field": "grid.steps", "values": [60, 60, 1000, 60]},
        {"field": "grid.control_intervals", "values": [12, 12, 100, 12]},
        {"field": "solver.starts", "values": [1, 1, 24, 1]},
    ]}]
    file, out, killed = runs.file("poison", sweep), f"{runs.folder}/poison", []

    def hear(subject, payload):
        # Signs of life name the delivery; marks come from the third on.
        words = subject.split(".")
        is_sign = words[0] == "$JS" and payload == b"+WPI"
        delivery = int(words[4]) if is_sign and len(words) == 9 else int(words[6]) if is_sign else 0
        if (is_sign and delivery <= 2) or (words[1] == "mark" and words[-1] == "2"):
            name = f"delivery {delivery}" if is_sign else f"mark {payload.decode()}"
            if name not in killed:
                killed.append(name)
                runs.workers["only"].kill()

    nats = Nats(server.port, hear)
    time.sleep(0.3)
    nats.subscribe("$JS.ACK.slipdrive-chunks.>")
    nats.subscribe("$JS.ACK.*.*.slipdrive-chunks.>")
    nats.subscribe("slipdrive.mark.>")
    runs.worker("only", url)
    collecting = runs.started("sweep", file, "--nats", url, "--out", out)
    ends = time.monotonic() + 120
    while collecting.poll() is None:
        assert time.monotonic() < ends, f"it hangs after {killed}"
        if runs.workers["only"].poll() is not None:
            runs.worker("only", url)
        time.sleep(0.05)
    rows = rows_of(out)
    assert collecting.returncode == 1 and rows[2]["problem"]["code"] == "worker_lost", (collecting.returncode, rows[2])
    assert all("answer" in rows[row] for row in (0, 1, 3)), rows
    letters = nats.ask("$JS.API.STREAM.MSG.GET.slipdrive-dead-letters", {"last_by_subj": "slipdrive.dead.row.>"})
    assert letters["message"]["subject"].endswith(".2"), letters
    nats.close()
    runs.end_workers()
    print(f"poison: row 2 is named and kept after {killed}, the others are answered", flush=True)


def cancel(runs, server):
    url = f"nats://127.0.0.1:{server.port}"
    file, out = runs.file("cancel", solves(100)), f"{runs.folder}/cancel"
    nats = Nats(server.port)
    time.sleep(0.3)
    runs.worker(0, url)
    runs.sweep(file, "--nats", url)
    time.sleep(1)
    taken = runs.sweep(file, "--nats", url, "--cancel").stdout.split()[0]
    time.sleep(2)
    assert count_in_stream(nats, "slipdrive-chunks") == 0
    stood = count_in_stream(nats, "slipdrive-results")
    ended = runs.sweep(file, "--nats", url, "--collect", "--out", out, check=False)
    assert ended.returncode == 75 and "cancelled" in ended.stderr, ended.stderr
    runs.sweep(file, "--nats", url, "--out", out)
    assert len(rows_of(out)) == 400
    nats.close()
    runs.end_workers()
    print(f"cancel: {taken} chunks taken back at {stood} of 400 rows, complete after publishing again", flush=True)


def cluster(runs, program, folder, port):
    ports = [port, port + 1, port + 2]
    routes = ",".join(f"nats://127.0.0.1:{port + 100}" for port in ports)

    def more(port):
        return ["--name", f"n{port}", "--cluster_name", "slipdrive", "--cluster", f"nats://127.0.0.1:{port + 100}", "--routes", routes]

    servers = [Server(program, folder, port, more(port)) for port in ports]
    try:
        time.sleep(8)
        url, sweep = ",".join(f"nats://127.0.0.1:{port}" for port in ports), solves(100)
        file, out, local = runs.file("cluster", sweep), f"{folder}/cluster", f"{folder}/cluster-local"
        runs.sweep(file, "--out", local)
        for index in range(2):
            runs.worker(index, url, "--nats-replicas", 3)
        time.sleep(2)
        collecting = runs.started("sweep", file, "--nats", url, "--nats-replicas", 3, "--out", out)
        time.sleep(2)
        servers[0].kill()
        assert collecting.wait(timeout=240) == 0, f"it ended with {collecting.returncode}"
        assert rows_of(out) == rows_of(local)
        runs.end_workers()
        print("cluster: one of three servers was killed, 400 rows, each once and as without a broker", flush=True)
    finally:
        for server in servers:
            server.kill()


def cpu_of_children(run):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.monotonic()
    run()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, time.monotonic() - begun


def cost(runs, server):
    """Chunks of some seconds; CPU time of all processes of the program, and of the server."""
    url, chunks, chunk_rows = f"nats://127.0.0.1:{server.port}", runs.arguments.cost_chunks, runs.arguments.cost_rows
    request = json.loads(runs.arguments.cost_request)
    rates = {"broker": [], "none": []}
    for turn in range(runs.arguments.turns):
        sweep = {**solves(chunks, chunk_rows), "request": request}
        # Another sweep each time: results of the one before would be found.
        sweep["axes"][0]["to"] += 0.001 * turn
        file = runs.file(f"cost-{turn}", sweep)
        cpu, wall = cpu_of_children(lambda: runs.sweep(file, "--threads", 2, "--out", f"{runs.folder}/cost-none-{turn}"))
        rates["none"].append(chunks * chunk_rows / cpu)
        print(f"cost: without a broker {chunks * chunk_rows / cpu:.1f} rows per CPU second, {wall:.1f} s", flush=True)
        of_server = server.cpu_s()

        def over_nats():
            for index in range(2):
                runs.worker(index, url)
            runs.sweep(file, "--nats", url, "--out", f"{runs.folder}/cost-broker-{turn}")
            runs.end_workers()

        cpu, wall = cpu_of_children(over_nats)
        of_server = server.cpu_s() - of_server
        rates["broker"].append(chunks * chunk_rows / (cpu + of_server))
        print(f"cost: two workers {chunks * chunk_rows / (cpu + of_server):.1f} rows per CPU second, {wall:.1f} s; "
              f"the server {of_server:.2f} of {cpu + of_server:.1f} CPU s ({100 * of_server / (cpu + of_server):.2f} %)", flush=True)
    mean = {name: sum(values) / len(values) for name, values in rates.items()}
    print(f"cost: {mean['broker'] / mean['none']:.3f} of the rate without a broker", flush=True)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--program", default="target/release/slipdrive")
    parser.add_argument("--server", default="nats-server")
    parser.add_argument("--noops", type=int, default=10_000)
    parser.add_argument("--solves", type=int, default=500)
    parser.add_argument("--chaos-s", type=float, default=60)
    parser.add_argument("--cost-chunks", type=int, default=8)
    parser.add_argument("--cost-rows", type=int, default=75)
    parser.add_argument("--cost-request", default='{"view": "plan", "solver": {"starts": 1}}')
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--port", type=int, default=42_800)
    parser.add_argument("--seed", type=int, default=random.randrange(1 << 30))
    parser.add_argument("--only", default="noops,solves,full,poison,cancel,cluster,cost")
    arguments = parser.parse_args()
    version = subprocess.run([arguments.server, "--version"], capture_output=True, text=True).stdout.strip()
    print(f"{version}, seed {arguments.seed}", flush=True)
    scenarios = {
        "noops": lambda runs, server: chaos(runs, server, "noops", noops(arguments.noops)),
        "solves": lambda runs, server: chaos(runs, server, "solves", solves(arguments.solves)),
        "full": full, "poison": poison, "cancel": cancel, "cost": cost,
    }
    for index, name in enumerate(arguments.only.split(",")):
        with tempfile.TemporaryDirectory(prefix="slipdrive-nats-") as folder:
            runs, port = Runs(arguments, folder), arguments.port + 10 * index
            try:
                if name == "cluster":
                    cluster(runs, arguments.server, folder, port)
                    continue
                server = Server(arguments.server, folder, port)
                try:
                    scenarios[name](runs, server)
                finally:
                    server.kill()
            except BaseException:
                for log in sorted(glob.glob(f"{folder}/log-*"))[-6:]:
                    print(log, open(log, errors="replace").read()[-1500:], file=sys.stderr)
                raise
            finally:
                for worker in runs.workers.values():
                    worker.kill()


if __name__ == "__main__":
    main()
