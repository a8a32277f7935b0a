#!/usr/bin/env python3
"""Runs a server under mixed load with a real Prometheus beside it and asks every query of the dashboard and of the rules.

check-dashboard.py [--binary target/release/slipdrive] [--load target/release/examples/mixed_load]
                   [--seconds 120] [--callers 6] [--picture docs/dashboard.png]

Fails when a query of the dashboard has no data, when `promtool check metrics` has a word to say, or when the load met an
unexpected answer. With --picture it draws the panels from Prometheus' own data (needs matplotlib). Needs `prometheus` and
`promtool` (Debian package prometheus) and python3.
"""
import argparse, json, math, os, pathlib, shutil, subprocess, sys, tempfile, time, urllib.parse, urllib.request

HERE = pathlib.Path(__file__).resolve().parent
ap = argparse.ArgumentParser()
ap.add_argument("--binary", default="target/release/slipdrive")
ap.add_argument("--load", default="target/release/examples/mixed_load")
ap.add_argument("--seconds", type=float, default=120)
ap.add_argument("--callers", type=int, default=6)
ap.add_argument("--picture")
args = ap.parse_args()

for tool in ("prometheus", "promtool"):
    if not shutil.which(tool):
        sys.exit(f"{tool} is not installed (Debian package prometheus)")

HTTP, GRPC, ADMIN, PROMETHEUS = "127.0.0.1:28080", "127.0.0.1:28051", "127.0.0.1:28090", "127.0.0.1:28091"
work = pathlib.Path(tempfile.mkdtemp(prefix="slipdrive-dashboard-"))
children = []


def start(command, name, **options):
    log = open(work / f"{name}.log", "w")
    child = subprocess.Popen(command, stdout=log, stderr=log, **options)
    children.append(child)
    return child


def get(url):
    with urllib.request.urlopen(url, timeout=10) as answer:
        return answer.read()


def until_ready(url):
    for _ in range(300):
        try:
            return get(url)
        except OSError:
            time.sleep(0.1)
    sys.exit(f"{url} does not answer; see {work}")


def ask(kind, **parameters):
    query = urllib.parse.urlencode(parameters)
    return json.loads(get(f"http://{PROMETHEUS}/api/v1/{kind}?{query}"))["data"]["result"]


def filled(expression):
    for name, value in (("$__rate_interval", "12s"), ("$job", "slipdrive"), ("$instance", ".*")):
        expression = expression.replace(name, value)
    return expression


def samples_with_numbers(result):
    return [series for series in result if not math.isnan(float(series["value"][1]))]


def draw(panels, begin, end, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    graphs = [panel for panel in panels if panel["type"] == "timeseries"]
    columns = 3
    rows = -(-len(graphs) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(columns * 5, rows * 2.6), squeeze=False)
    for axis in axes.flat[len(graphs):]:
        axis.axis("off")
    for axis, panel in zip(axes.flat, graphs):
        for target in panel["targets"]:
            for series in ask("query_range", query=filled(target["expr"]), start=begin, end=end, step=2):
                legend = target["legendFormat"]
                for label, value in series["metric"].items():
                    legend = legend.replace("{{" + label + "}}", value)
                times = [float(moment) - begin for moment, _ in series["values"]]
                axis.plot(times, [float(value) for _, value in series["values"]], label=legend, linewidth=1.2)
        axis.set_title(f"{panel['title']} ({panel['fieldConfig']['defaults']['unit']})", fontsize=9)
        _, highest = axis.get_ylim()
        # Room for the legend.
        axis.set_ylim(0, max(highest, 1e-9) * 1.35)
        axis.set_xlim(0, end - begin)
        axis.tick_params(labelsize=7)
        axis.grid(alpha=0.3)
        handles, labels = axis.get_legend_handles_labels()
        axis.legend(handles[:8], labels[:8], fontsize=5.5, loc="upper right", ncols=2 if len(labels) > 4 else 1)
    for axis in axes[-1]:
        axis.set_xlabel("time, s", fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    print(f"drew {len(graphs)} panels into {path}")


def main():
    flags = ["--http", HTTP, "--grpc", GRPC, "--admin", ADMIN, "--workers", "1", "--queue-length", "3"]
    server = start([args.binary, "serve", *flags, "--log", "warn"], "server")
    until_ready(f"http://{ADMIN}/readyz")
    shutil.copy(HERE / "prometheus/slipdrive.rules.yml", work)
    (work / "prometheus.yml").write_text(
        "global: {scrape_interval: 2s, evaluation_interval: 5s}\n"
        "rule_files: [slipdrive.rules.yml]\n"
        f"scrape_configs: [{{job_name: slipdrive, static_configs: [{{targets: ['{ADMIN}']}}]}}]\n"
    )
    start(
        ["prometheus", f"--config.file={work}/prometheus.yml", f"--storage.tsdb.path={work}/data",
         f"--web.listen-address={PROMETHEUS}"],
        "prometheus",
    )
    until_ready(f"http://{PROMETHEUS}/-/ready")
    begin = time.time()
    load = [args.load, "--http", HTTP, "--grpc", GRPC, "--seconds", str(args.seconds), "--callers", str(args.callers)]
    loaded = subprocess.run(load, stdout=subprocess.PIPE, text=True)
    end = time.time()
    print(loaded.stdout.strip())
    faults = [] if loaded.returncode == 0 else ["the load met unexpected answers"]

    checked = subprocess.run(["promtool", "check", "metrics"], input=get(f"http://{ADMIN}/metrics"), capture_output=True)
    words = (checked.stdout + checked.stderr).decode().strip()
    print(f"promtool check metrics: {words or 'clean'}")
    faults += [f"promtool: {words}"] if words or checked.returncode else []

    dashboard = json.loads((HERE / "grafana/dashboards/slipdrive.json").read_text())
    asked = 0
    for panel in dashboard["panels"]:
        for target in panel["targets"]:
            asked += 1
            if not samples_with_numbers(ask("query", query=filled(target["expr"]), time=end - 2)):
                faults.append(f"no data: {panel['title']}: {target['expr']}")
    print(f"{asked} queries of {len(dashboard['panels'])} panels asked")

    for group in json.loads(get(f"http://{PROMETHEUS}/api/v1/rules"))["data"]["groups"]:
        for rule in group["rules"]:
            if rule["health"] != "ok":
                faults.append(f"rule {rule['name']}: {rule.get('lastError') or rule['health']}")
            if rule["type"] == "recording" and not samples_with_numbers(ask("query", query=rule["name"], time=end - 2)):
                faults.append(f"no data: record {rule['name']}")
    if args.picture:
        draw(dashboard["panels"], begin, end, args.picture)
    server.terminate()
    if server.wait(60) != 0:
        faults.append(f"the server ended with {server.returncode}")
    return faults


try:
    found = main()
finally:
    for child in children:
        if child.poll() is None:
            child.terminate()
    for child in children:
        child.wait(30)
for fault in found:
    print(f"FAIL  {fault}")
if not found:
    shutil.rmtree(work)
    print("ok")
sys.exit(1 if found else 0)
