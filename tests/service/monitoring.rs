//! Dashboard, rules and scrapes ask for metrics and labels that exist.

use std::collections::BTreeSet;
use std::fs;

use serde_json::Value;
use slipdrive::jobs::Jobs;
use slipdrive::metrics::catalogue::{self, Family, sweep_workers};
use yaml_rust2::Yaml;

use crate::support::manifests::{deploy, documents, renderings};

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

#[test]
fn unit_of_systemd_gives_the_drain_its_time() {
    let unit = fs::read_to_string(deploy("slipdrive.service")).unwrap();
    let seconds = |key: &str| -> u64 {
        let value = unit.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_else(|| panic!("{key}"));
        value.parse().unwrap()
    };
    let drain = seconds("Environment=SLIPDRIVE_DRAIN_DELAY_S=") + seconds("Environment=SLIPDRIVE_DRAIN_TIMEOUT_S=");
    assert_eq!(seconds("TimeoutStopSec="), drain + 5);
}

/// The labels that the scrapes of one replica bear, as the operator makes them of a `PodMonitor`.
fn labels_of_scrape(monitor: &Yaml, pod: &Yaml) -> Vec<(&'static str, String)> {
    let endpoint = &monitor["spec"]["podMetricsEndpoints"][0]["port"];
    let container = &pod["spec"]["containers"][0];
    let mut ports = container["ports"].as_vec().unwrap().iter();
    let port = ports.find(|port| &port["name"] == endpoint).expect("the PodMonitor names a port of the container");
    let job = monitor["spec"]["jobLabel"].as_str().unwrap();
    vec![
        ("job", pod["metadata"]["labels"][job].as_str().unwrap().to_owned()),
        ("namespace", monitor["metadata"]["namespace"].as_str().unwrap().to_owned()),
        ("pod", "slipdrive-0".to_owned()),
        ("container", container["name"].as_str().unwrap().to_owned()),
        ("endpoint", endpoint.as_str().unwrap().to_owned()),
        ("instance", format!("10.0.0.7:{}", port["containerPort"].as_i64().unwrap())),
    ]
}

#[test]
fn alerts_are_tried_with_the_labels_of_the_scrapes() {
    for rendering in renderings() {
        for monitor in rendering.of_kind("PodMonitor") {
            let wanted = &monitor["spec"]["selector"]["matchLabels"]["app.kubernetes.io/name"];
            assert_eq!(&rendering.pod()["metadata"]["labels"]["app.kubernetes.io/name"], wanted, "{}", rendering.name);
            let labels = labels_of_scrape(monitor, rendering.pod());
            assert_eq!(labels[0].1, "slipdrive", "{}: what the alerts ask for", rendering.name);
            let text: Vec<_> = labels.iter().map(|(name, value)| format!("{name}=\"{value}\"")).collect();
            let (replica, scrape) = (text[..3].join(", "), text[3..].join(", "));
            let tests = fs::read_to_string(deploy("prometheus/slipdrive.rules.test.yml")).unwrap();
            let (with_replica, with_all) =
                (tests.matches(&replica).count(), tests.matches(&format!("{replica},\n          {scrape}")).count());
            assert!(with_all > 20, "{}: {with_all} series bear {text:?}", rendering.name);
            assert_eq!(with_replica, with_all, "{}: {text:?}", rendering.name);
        }
    }
}

#[test]
fn rules_of_the_operator_are_the_rules() {
    let rules = &documents(&fs::read_to_string(deploy("prometheus/slipdrive.rules.yml")).unwrap())[0];
    let path = deploy("kubernetes/components/monitoring/prometheusrule.yaml");
    let of_operator = &documents(&fs::read_to_string(path).unwrap())[0];
    assert_eq!(of_operator["spec"], *rules, "run deploy/kubernetes/components/monitoring/render-rules.sh");
}

#[test]
fn scrape_without_the_operator_has_the_job_of_the_alerts() {
    let configuration = &documents(&fs::read_to_string(deploy("prometheus/kubernetes.yml")).unwrap())[0];
    let job = &configuration["scrape_configs"][0];
    assert_eq!(job["job_name"].as_str(), Some("slipdrive"));
    let targets = job["relabel_configs"].as_vec().unwrap().iter().filter_map(|rule| rule["target_label"].as_str());
    assert_eq!(targets.collect::<BTreeSet<_>>(), BTreeSet::from(["namespace", "pod"]), "the rules keep both apart");
    let of_workers = &configuration["scrape_configs"][1];
    assert_eq!(of_workers["job_name"].as_str(), Some("slipdrive-worker"));
    assert_eq!(of_workers["relabel_configs"][0]["regex"].as_str(), Some("slipdrive-worker"));
    assert_eq!(
        of_workers["relabel_configs"].as_vec().unwrap()[1..],
        job["relabel_configs"].as_vec().unwrap()[1..],
        "in the same way"
    );
}
