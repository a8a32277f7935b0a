#!/usr/bin/env python3
"""Checks that what the manifests scrape bears the labels that the alerts ask for.

check-monitoring.py [--binary target/release/slipdrive]

Renders the overlay `site`, tries the rules of its PrometheusRule with `promtool test rules`, and fails when an alert has
no test in which it fires. With --binary it also runs the server under a real Prometheus, whose scrape is what the operator
makes of the PodMonitor, and once more with deploy/prometheus/kubernetes.yml: there is no cluster, so the pod is found in a
file that gives the labels that discovery would give. Needs kubectl, PyYAML, promtool and prometheus (Debian package
prometheus).
"""
import argparse, json, pathlib, shutil, subprocess, sys, tempfile, time, urllib.parse, urllib.request

import yaml

HERE = pathlib.Path(__file__).resolve().parent
HTTP, GRPC, ADMIN, PROMETHEUS = "127.0.0.1:28480", "127.0.0.1:28451", "127.0.0.1:28490", "127.0.0.1:28491"
work = pathlib.Path(tempfile.mkdtemp(prefix="slipdrive-monitoring-"))
faults = []


def rendered():
    command = ["kubectl", "kustomize", HERE / "kubernetes/overlays/site"]
    printed = subprocess.run(command, check=True, capture_output=True)
    return {document["kind"]: document for document in yaml.safe_load_all(printed.stdout)}


def try_rules(rules):
    (work / "slipdrive.rules.yml").write_text(yaml.safe_dump(rules["spec"]))
    tests = shutil.copy(HERE / "prometheus/slipdrive.rules.test.yml", work)
    tried = subprocess.run(["promtool", "test", "rules", tests], capture_output=True, text=True)
    if tried.returncode:
        faults.append(f"promtool: {tried.stdout}{tried.stderr}")
    tests = yaml.safe_load(pathlib.Path(tests).read_text())["tests"]
    fired = {case["alertname"] for test in tests for case in test["alert_rule_test"] if case["exp_alerts"]}
    alerts = {rule["alert"] for group in rules["spec"]["groups"] for rule in group["rules"] if "alert" in rule}
    faults.extend(f"no test in which {alert} fires" for alert in sorted(alerts - fired))
    print(f"{len(alerts & fired)} of {len(alerts)} alerts fire with the labels of the manifests")


def meta(label):
    return "__meta_kubernetes_pod_label_" + "".join(c if c.isalnum() else "_" for c in label)


def pod_as_discovered(manifests):
    """The pod's first container port of each name, with the labels that discovery of pods gives."""
    deployment = manifests["Deployment"]
    pod = deployment["spec"]["template"]
    container = pod["spec"]["containers"][0]
    for port in container["ports"]:
        labels = {
            "__meta_kubernetes_namespace": deployment["metadata"]["namespace"],
            "__meta_kubernetes_pod_name": "slipdrive-0",
            "__meta_kubernetes_pod_phase": "Running",
            "__meta_kubernetes_pod_container_name": container["name"],
            "__meta_kubernetes_pod_container_port_name": port["name"],
        }
        labels |= {meta(name): value for name, value in pod["metadata"]["labels"].items()}
        # Only the admin port is served here; another one that is scraped shows as a replica that is down.
        address = ADMIN if port["name"] == "admin" else f"127.0.0.1:{port['containerPort']}"
        yield {"targets": [address], "labels": labels}


def scrape_of_operator(monitor):
    """The scrape job that the operator makes of a PodMonitor with one endpoint."""
    spec, name = monitor["spec"], f"{monitor['metadata']['namespace']}/{monitor['metadata']['name']}"
    (endpoint,) = spec["podMetricsEndpoints"]
    rules = [{"source_labels": ["__meta_kubernetes_pod_phase"], "regex": "(Failed|Succeeded)", "action": "drop"}]
    for label, value in spec["selector"]["matchLabels"].items():
        rules.append({"source_labels": [meta(label)], "regex": value, "action": "keep"})
    port = "__meta_kubernetes_pod_container_port_name"
    rules.append({"source_labels": [port], "regex": endpoint["port"], "action": "keep"})
    for label, source in (("namespace", "namespace"), ("container", "pod_container_name"), ("pod", "pod_name")):
        rules.append({"source_labels": [f"__meta_kubernetes_{source}"], "target_label": label})
    rules.append({"target_label": "job", "replacement": name})
    if "jobLabel" in spec:
        rules.append({"source_labels": [meta(spec["jobLabel"])], "target_label": "job", "regex": "(.+)"})
    rules.append({"target_label": "endpoint", "replacement": endpoint["port"]})
    return {"job_name": f"podMonitor/{name}/0", "metrics_path": endpoint["path"], "relabel_configs": rules}


def get(url):
    with urllib.request.urlopen(url, timeout=10) as answer:
        return answer.read()


def until(condition, what):
    for _ in range(300):
        try:
            found = condition()
        except OSError:
            found = None
        if found:
            return found
        time.sleep(0.1)
    sys.exit(f"{what}; see {work}")


def ask(query):
    url = f"http://{PROMETHEUS}/api/v1/query?{urllib.parse.urlencode({'query': query})}"
    return json.loads(get(url))["data"]["result"]


def run(command, name):
    log = open(work / f"{name}.log", "w")
    return subprocess.Popen(command, stdout=log, stderr=log)


def try_scrape(name, job, pod, wanted):
    """One run of Prometheus: the scrape works under the wanted job, and `SlipdriveAbsent` is silent."""
    folder = work / name
    folder.mkdir()
    (folder / "pods.json").write_text(json.dumps(pod))
    job = {key: value for key, value in job.items() if key != "kubernetes_sd_configs"} | {"scrape_interval": "1s"}
    configuration = {
        "global": {"evaluation_interval": "1s"},
        "rule_files": [str(work / "slipdrive.rules.yml")],
        "scrape_configs": [job | {"file_sd_configs": [{"files": [str(folder / "pods.json")]}]}],
    }
    (folder / "prometheus.yml").write_text(yaml.safe_dump(configuration))
    flags = [f"--config.file={folder}/prometheus.yml", f"--storage.tsdb.path={folder}/data"]
    prometheus = run(["prometheus", *flags, f"--web.listen-address={PROMETHEUS}"], name)
    try:
        until(lambda: ask("up == 1"), f"{name}: nothing is scraped")
        up = ask("up")
        labels = [{key: value for key, value in series["metric"].items() if key != "__name__"} for series in up]
        if labels != [wanted | {"instance": ADMIN}]:
            faults.append(f"{name}: the scrapes bear {labels}, want {wanted}")
        workers = until(lambda: ask('sum(slipdrive_workers{job="slipdrive"})'), f"{name}: no metrics under the job")
        time.sleep(3)
        pending = ask('ALERTS{alertname=~"SlipdriveAbsent|SlipdriveDown"}')
        if pending:
            faults.append(f"{name}: {pending}")
        print(f"{name}: scraped as {labels}, {workers[0]['value'][1]} workers, no alert of absence")
    finally:
        prometheus.terminate()
        prometheus.wait(30)


def main():
    ap = argparse.ArgumentParser()
    ap.add_argument("--binary")
    args = ap.parse_args()
    manifests = rendered()
    try_rules(manifests["PrometheusRule"])
    if not args.binary:
        return
    pod = list(pod_as_discovered(manifests))
    server = run([args.binary, "serve", "--http", HTTP, "--grpc", GRPC, "--admin", ADMIN, "--workers", "1"], "server")
    try:
        until(lambda: get(f"http://{ADMIN}/readyz"), "the server does not answer")
        wanted = {"job": "slipdrive", "namespace": "slipdrive", "pod": "slipdrive-0"}
        of_operator = wanted | {"container": "slipdrive", "endpoint": "admin"}
        try_scrape("podmonitor", scrape_of_operator(manifests["PodMonitor"]), pod, of_operator)
        plain = yaml.safe_load((HERE / "prometheus/kubernetes.yml").read_text())["scrape_configs"]
        try_scrape("kubernetes.yml", plain[0], pod, wanted)
    finally:
        server.terminate()
        server.wait(60)


main()
print("\n".join(f"FAIL  {fault}" for fault in faults) or "ok")
if not faults:
    shutil.rmtree(work)
sys.exit(1 if faults else 0)
