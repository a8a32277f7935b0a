//! What schemas do not know of the files under `deploy`: rules across fields, files and the program.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;
use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::{Jobs, Limits};
use slipdrive::metrics::catalogue::{self, Family, sweep_workers};
use slipdrive::service::DEFAULT_QUEUE_WORK;
use yaml_rust2::{Yaml, YamlLoader};

use crate::support::process::slipdrive;

fn deploy(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(path)
}

/// One rendering of the manifests.
struct Rendering {
    name: String,
    documents: Vec<Yaml>,
}

impl Rendering {
    fn of_kind(&self, kind: &str) -> Vec<&Yaml> {
        self.documents.iter().filter(|document| document["kind"].as_str() == Some(kind)).collect()
    }

    fn only(&self, kind: &str) -> &Yaml {
        let found = self.of_kind(kind);
        assert_eq!(found.len(), 1, "{}: {kind}", self.name);
        found[0]
    }

    fn pod(&self) -> &Yaml {
        &self.only("Deployment")["spec"]["template"]
    }

    fn container(&self) -> &Yaml {
        let containers = self.pod()["spec"]["containers"].as_vec().unwrap();
        assert_eq!(containers.len(), 1, "{}", self.name);
        &containers[0]
    }

    /// A variable of the container, where it is a plain value.
    fn variable(&self, name: &str) -> Option<&str> {
        let variables = self.container()["env"].as_vec().unwrap();
        variables.iter().find(|variable| variable["name"].as_str() == Some(name))?["value"].as_str()
    }

    fn port_names(&self) -> BTreeSet<&str> {
        self.container()["ports"].as_vec().unwrap().iter().map(|port| port["name"].as_str().unwrap()).collect()
    }
}

fn documents(text: &str) -> Vec<Yaml> {
    YamlLoader::load_from_str(text).unwrap().into_iter().filter(|document| !document.is_null()).collect()
}

/// The base as it is written, and every overlay as kubectl renders it.
fn renderings() -> Vec<Rendering> {
    let files = fs::read_dir(deploy("kubernetes/base")).unwrap().map(|file| file.unwrap().path());
    let files = files.filter(|file| file.file_stem().unwrap() != "kustomization");
    let base = files.flat_map(|file| documents(&fs::read_to_string(file).unwrap())).collect();
    let mut renderings = vec![Rendering { name: "base".to_owned(), documents: base }];
    for overlay in fs::read_dir(deploy("kubernetes/overlays")).unwrap() {
        let path = overlay.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        match Command::new("kubectl").arg("kustomize").arg(&path).output() {
            Ok(output) => {
                assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
                let documents = documents(&String::from_utf8(output.stdout).unwrap());
                renderings.push(Rendering { name, documents });
            }
            Err(error) => println!("SKIPPED: the overlay {name}, since kubectl does not run: {error}"),
        }
    }
    renderings
}

#[test]
fn grace_period_is_delay_and_timeout_and_five_seconds() {
    for rendering in renderings() {
        let seconds = |name: &str| rendering.variable(name).unwrap().parse::<i64>().unwrap();
        let (delay, timeout) = (seconds("SLIPDRIVE_DRAIN_DELAY_S"), seconds("SLIPDRIVE_DRAIN_TIMEOUT_S"));
        let grace = rendering.pod()["spec"]["terminationGracePeriodSeconds"].as_i64().unwrap();
        assert_eq!(grace, delay + timeout + 5, "{}", rendering.name);
        let is_complete = timeout as f64 >= DEFAULT_QUEUE_WORK.as_secs_f64() + Limits::default().max_time_limit_s;
        assert!(is_complete || rendering.name == "development", "{}: accepted work is cut off", rendering.name);
        let has_hook = !rendering.container()["lifecycle"]["preStop"].is_badvalue();
        assert!(!(has_hook && delay > 0), "{}: a drain delay and a preStop hook", rendering.name);
        let readiness = &rendering.container()["readinessProbe"];
        let told = readiness["periodSeconds"].as_i64().unwrap() * readiness["failureThreshold"].as_i64().unwrap();
        let replicas = rendering.only("HorizontalPodAutoscaler")["spec"]["maxReplicas"].as_i64().unwrap();
        assert!(delay > told || replicas == 1, "{}: the delay ends before anyone is told", rendering.name);
    }
}

#[test]
fn ports_that_are_named_are_ports_of_the_container() {
    for rendering in renderings() {
        let ports = rendering.port_names();
        let container = rendering.container();
        for port in container["ports"].as_vec().unwrap() {
            let (name, number) = (port["name"].as_str().unwrap(), port["containerPort"].as_i64().unwrap());
            assert!(name.len() <= 15 && (1024..=65535).contains(&number), "{}: {name} {number}", rendering.name);
        }
        assert_eq!(ports.len(), container["ports"].as_vec().unwrap().len(), "{}: names are unique", rendering.name);
        for probe in ["startupProbe", "livenessProbe", "readinessProbe"] {
            assert_eq!(container[probe]["httpGet"]["port"].as_str(), Some("admin"), "{}: {probe}", rendering.name);
        }
        let services = rendering.of_kind("Service");
        let served = services.iter().flat_map(|service| service["spec"]["ports"].as_vec().unwrap());
        let targets: BTreeSet<_> = served.map(|port| port["targetPort"].as_str().unwrap()).collect();
        assert_eq!(targets, BTreeSet::from(["grpc", "http"]), "{}: the admin port is for nobody else", rendering.name);
        let rules = rendering.only("NetworkPolicy")["spec"]["ingress"].as_vec().unwrap();
        let admitted = rules.iter().flat_map(|rule| rule["ports"].as_vec().unwrap());
        let admitted: BTreeSet<_> = admitted.map(|port| port["port"].as_str().unwrap()).collect();
        assert_eq!(admitted, ports, "{}", rendering.name);
        let admin = rendering.variable("SLIPDRIVE_ADMIN").unwrap().rsplit(':').next().unwrap().parse().ok();
        let bound = |name: &str| {
            let ports = container["ports"].as_vec().unwrap();
            ports.iter().find(|port| port["name"].as_str() == Some(name)).unwrap()["containerPort"].as_i64()
        };
        assert_eq!((bound("admin"), bound("http"), bound("grpc")), (admin, Some(8080), Some(50051)));
        let annotations = &rendering.pod()["metadata"]["annotations"];
        let scraped = annotations["prometheus.io/port"].as_str().and_then(|port| port.parse().ok());
        assert_eq!(scraped, admin, "{}", rendering.name);
    }
    let dockerfile = fs::read_to_string(deploy("../Dockerfile")).unwrap();
    assert!(dockerfile.contains("SLIPDRIVE_HTTP=0.0.0.0:8080") && dockerfile.contains("SLIPDRIVE_GRPC=0.0.0.0:50051"));
}

#[test]
fn selectors_select_the_pods() {
    for rendering in renderings() {
        let labels = &rendering.pod()["metadata"]["labels"];
        let is_selected = |selector: &Yaml| {
            let wanted = selector.as_hash().unwrap();
            !wanted.is_empty() && wanted.iter().all(|(key, value)| &labels[key.as_str().unwrap()] == value)
        };
        let deployment = rendering.only("Deployment");
        let mut selectors = vec![&deployment["spec"]["selector"]["matchLabels"]];
        selectors.extend(rendering.of_kind("Service").iter().map(|service| &service["spec"]["selector"]));
        selectors.push(&rendering.only("PodDisruptionBudget")["spec"]["selector"]["matchLabels"]);
        selectors.push(&rendering.only("NetworkPolicy")["spec"]["podSelector"]["matchLabels"]);
        let spread = rendering.pod()["spec"]["topologySpreadConstraints"].as_vec().unwrap();
        selectors.extend(spread.iter().map(|constraint| &constraint["labelSelector"]["matchLabels"]));
        for selector in selectors {
            assert!(is_selected(selector), "{}: {selector:?}", rendering.name);
        }
        let namespaces: BTreeSet<_> = rendering
            .documents
            .iter()
            .filter(|document| document["kind"].as_str() != Some("Namespace"))
            .map(|document| document["metadata"]["namespace"].as_str())
            .collect();
        assert_eq!(namespaces.len(), 1, "{}: {namespaces:?}", rendering.name);
    }
}

#[test]
fn replicas_scale_and_may_be_evicted_one_by_one() {
    for rendering in renderings() {
        let deployment = rendering.only("Deployment");
        assert!(deployment["spec"]["replicas"].is_badvalue(), "{}: the autoscaler's number is fixed", rendering.name);
        let scaler = &rendering.only("HorizontalPodAutoscaler")["spec"];
        assert_eq!(scaler["scaleTargetRef"]["name"], deployment["metadata"]["name"], "{}", rendering.name);
        let (least, most) = (scaler["minReplicas"].as_i64().unwrap(), scaler["maxReplicas"].as_i64().unwrap());
        assert!(1 <= least && least <= most, "{}: {least} to {most}", rendering.name);
        let budget = &rendering.only("PodDisruptionBudget")["spec"];
        assert_eq!(budget["maxUnavailable"].as_i64(), Some(1), "{}: nodes can be drained", rendering.name);
    }
}

#[test]
fn containers_have_no_more_rights_and_room_than_they_need() {
    for rendering in renderings() {
        let (pod, container) = (&rendering.pod()["spec"], rendering.container());
        assert_eq!(pod["automountServiceAccountToken"].as_bool(), Some(false), "{}", rendering.name);
        assert_eq!(pod["enableServiceLinks"].as_bool(), Some(false), "{}: they set SLIPDRIVE_...", rendering.name);
        let security = &pod["securityContext"];
        assert!(security["runAsUser"].as_i64().unwrap() > 0 && security["runAsNonRoot"].as_bool() == Some(true));
        assert_eq!(security["seccompProfile"]["type"].as_str(), Some("RuntimeDefault"));
        let security = &container["securityContext"];
        assert_eq!(security["readOnlyRootFilesystem"].as_bool(), Some(true));
        assert_eq!(security["allowPrivilegeEscalation"].as_bool(), Some(false));
        assert_eq!(security["capabilities"]["drop"][0].as_str(), Some("ALL"));
        let resources = &container["resources"];
        let memory = |of: &str| mebibytes(resources[of]["memory"].as_str().unwrap());
        assert!(memory("requests") <= memory("limits"), "{}", rendering.name);
        let workers = resources["requests"]["cpu"].as_str().unwrap().parse().unwrap();
        let bound = ServerSettings::default().memory_bound_bytes(workers) >> 20;
        assert!(bound <= memory("limits") as usize, "{}: {bound} MiB may be in use", rendering.name);
        let cores = resources["requests"]["cpu"].as_str().unwrap();
        assert!(cores.parse::<u32>().is_ok(), "{}: workers are whole cores, not {cores}", rendering.name);
        assert!(resources["limits"]["cpu"].is_badvalue(), "{}: a CPU limit below the workers", rendering.name);
    }
}

fn mebibytes(text: &str) -> u32 {
    text.strip_suffix("Mi").unwrap().parse().unwrap()
}

#[test]
fn variables_are_settings_and_values_can_be_read() {
    let keys = std::env::temp_dir().join(format!("slipdrive-deployment-keys-{}", std::process::id()));
    fs::write(&keys, "key\n").unwrap();
    for rendering in renderings() {
        let mut command = slipdrive();
        command.args(["serve", "--print-config", "--http", "0.0.0.0:8080", "--grpc", "0.0.0.0:50051"]);
        for variable in rendering.container()["env"].as_vec().unwrap() {
            let name = variable["name"].as_str().unwrap();
            match (name, variable["value"].as_str()) {
                ("SLIPDRIVE_API_KEYS_FILE", Some(path)) => {
                    let mount = rendering.container()["volumeMounts"][0]["mountPath"].as_str().unwrap();
                    assert!(path.starts_with(mount), "{}: {path} is not mounted", rendering.name);
                    command.env(name, &keys);
                }
                (_, Some(value)) => {
                    command.env(name, value);
                }
                (_, None) => {
                    let cores = rendering.container()["resources"]["requests"]["cpu"].as_str().unwrap();
                    assert_eq!(variable["valueFrom"]["resourceFieldRef"]["resource"].as_str(), Some("requests.cpu"));
                    command.env(name, cores);
                }
            }
        }
        let output = command.output().unwrap();
        let printed = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{}: {}", rendering.name, String::from_utf8_lossy(&output.stderr));
        for variable in rendering.container()["env"].as_vec().unwrap() {
            let name = variable["name"].as_str().unwrap();
            assert!(printed.contains(&format!("# from {name}\n")), "{}: {name} in {printed}", rendering.name);
        }
    }
    fs::remove_file(keys).unwrap();
}

/// Every name of a metric in these words, without the endings of histograms.
fn metrics_in(text: &str) -> BTreeSet<String> {
    let words = text.split(|character: char| !(character.is_ascii_alphanumeric() || "_:".contains(character)));
    let own = words.filter(|word| word.starts_with("slipdrive_"));
    own.map(|word| {
        let ends = ["_bucket", "_count", "_sum"];
        let is_histogram = |name: &str| {
            Jobs::families().iter().any(|family| family.name == name && family.kind == catalogue::Kind::Histogram)
        };
        let stem = ends.iter().find_map(|end| word.strip_suffix(end).filter(|stem| is_histogram(stem)));
        stem.unwrap_or(word).to_owned()
    })
    .collect()
}

/// Those of the service and those of the workers of sweeps.
fn all_families() -> Vec<Family> {
    [&Jobs::families(), sweep_workers::ALL].concat()
}

#[test]
fn dashboard_rules_and_adapter_ask_for_metrics_that_exist() {
    let known: BTreeSet<_> = all_families().iter().map(|family| family.name.to_owned()).collect();
    let dashboard: Value =
        serde_json::from_str(&fs::read_to_string(deploy("grafana/dashboards/slipdrive.json")).unwrap()).unwrap();
    let panels = dashboard["panels"].as_array().unwrap();
    let queries: Vec<_> = panels
        .iter()
        .flat_map(|panel| panel["targets"].as_array().unwrap())
        .map(|target| target["expr"].as_str().unwrap().to_owned())
        .collect();
    let rules = fs::read_to_string(deploy("prometheus/slipdrive.rules.yml")).unwrap();
    let adapter = fs::read_to_string(deploy("kubernetes/overlays/queue-wait/adapter-values.yaml")).unwrap();
    let made_by_adapter = "slipdrive_queue_wait_seconds_p90".to_owned();
    assert!(
        fs::read_to_string(deploy("kubernetes/overlays/queue-wait/autoscaler.yaml"))
            .unwrap()
            .contains(&made_by_adapter)
    );
    let asked: BTreeSet<_> = metrics_in(&queries.join("\n")).union(&metrics_in(&rules)).cloned().collect();
    let unknown: Vec<_> = asked.union(&metrics_in(&adapter)).filter(|&name| !known.contains(name)).cloned().collect();
    assert_eq!(unknown, [made_by_adapter]);
    let shown = metrics_in(&queries.join("\n"));
    let forgotten: Vec<_> = known.difference(&shown).collect();
    assert!(forgotten.is_empty(), "the dashboard shows all: {forgotten:?}");
}

#[test]
fn documented_metrics_and_alerts_are_those_that_exist() {
    let document = fs::read_to_string(deploy("../docs/operations.md")).unwrap();
    let rows: Vec<_> = all_families()
        .iter()
        .map(|family| {
            let labels: Vec<_> = family.labels.iter().map(|label| format!("`{label}`")).collect();
            format!("| `{}` | {} | {} | {} |", family.name, family.kind.as_str(), labels.join(", "), family.help)
        })
        .collect();
    let documented: Vec<_> = document.lines().filter(|line| line.starts_with("| `slipdrive_")).collect();
    assert_eq!(documented, rows);
    let rules = documents(&fs::read_to_string(deploy("prometheus/slipdrive.rules.yml")).unwrap());
    let groups = rules[0]["groups"].as_vec().unwrap();
    let alerts =
        groups.iter().flat_map(|group| group["rules"].as_vec().unwrap()).filter_map(|rule| rule["alert"].as_str());
    for alert in alerts {
        assert!(document.contains(&format!("`{alert}`")), "{alert}");
    }
}

#[test]
fn composed_service_listens_to_this_machine_and_is_scraped() {
    let compose = &documents(&fs::read_to_string(deploy("compose.yaml")).unwrap())[0];
    for (name, service) in compose["services"].as_hash().unwrap() {
        for port in service["ports"].as_vec().unwrap() {
            assert!(port.as_str().unwrap().starts_with("127.0.0.1:"), "{name:?}: {port:?}");
        }
    }
    let service = &compose["services"]["slipdrive"];
    let admin = service["environment"]["SLIPDRIVE_ADMIN"].as_str().unwrap().rsplit(':').next().unwrap();
    let prometheus = fs::read_to_string(deploy("prometheus/prometheus.yml")).unwrap();
    assert!(prometheus.contains(&format!("slipdrive:{admin}")));
    let timeout: u64 = service["environment"]["SLIPDRIVE_DRAIN_TIMEOUT_S"].as_str().unwrap().parse().unwrap();
    let grace: u64 = service["stop_grace_period"].as_str().unwrap().strip_suffix('s').unwrap().parse().unwrap();
    assert_eq!(timeout + 5, grace);
}
