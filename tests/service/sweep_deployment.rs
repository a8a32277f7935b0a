//! What no schema here knows of `deploy/kubernetes/sweeps`: the fields of KEDA, and rules across files and the program.

use std::fs;
use std::path::{Path, PathBuf};

use slipdrive::jobs::{Jobs, Limits};
use slipdrive::metrics::Metrics;
use slipdrive::sweep::Sweep;
use yaml_rust2::{Yaml, YamlLoader};

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy/kubernetes/sweeps").join(name)
}

fn documents(name: &str) -> Vec<Yaml> {
    YamlLoader::load_from_str(&fs::read_to_string(path(name)).unwrap()).unwrap()
}

fn keys(object: &Yaml) -> Vec<&str> {
    object.as_hash().unwrap().keys().map(|key| key.as_str().unwrap()).collect()
}

#[test]
fn scaler_has_the_fields_of_keda_and_the_names_of_the_program() {
    let scaler = &documents("workers/scaler.yaml")[0];
    assert_eq!(
        (scaler["apiVersion"].as_str(), scaler["kind"].as_str()),
        (Some("keda.sh/v1alpha1"), Some("ScaledObject"))
    );
    let spec = &scaler["spec"];
    let of_spec = [
        "scaleTargetRef",
        "pollingInterval",
        "cooldownPeriod",
        "minReplicaCount",
        "maxReplicaCount",
        "fallback",
        "triggers",
    ];
    assert_eq!(keys(spec), of_spec);
    assert_eq!(keys(&spec["fallback"]), ["failureThreshold", "replicas"]);
    let (least, most) = (spec["minReplicaCount"].as_i64().unwrap(), spec["maxReplicaCount"].as_i64().unwrap());
    let fallback = spec["fallback"]["replicas"].as_i64().unwrap();
    assert!(least <= fallback && fallback <= most && most > 0);
    let worker = &documents("workers/deployment.yaml")[0];
    assert_eq!(spec["scaleTargetRef"]["name"], worker["metadata"]["name"]);
    assert!(worker["spec"]["replicas"].is_badvalue(), "the number of workers is the scaler's");
    let trigger = &spec["triggers"][0];
    assert_eq!(trigger["type"].as_str(), Some("nats-jetstream"));
    let metadata = &trigger["metadata"];
    let of_trigger =
        ["natsServerMonitoringEndpoint", "account", "stream", "consumer", "lagThreshold", "activationLagThreshold"];
    assert_eq!(keys(metadata), of_trigger);
    assert!(metadata.as_hash().unwrap().values().all(|value| value.as_str().is_some()), "KEDA takes texts alone");
    assert!(metadata["lagThreshold"].as_str().unwrap().parse::<u32>().unwrap() > 0);
    let consumer = format!("workers-{}", env!("CARGO_PKG_VERSION").replace('.', "_"));
    assert_eq!(
        (metadata["stream"].as_str(), metadata["consumer"].as_str()),
        (Some("slipdrive-chunks"), Some(&*consumer))
    );
    let nats = documents("nats/nats.yaml");
    let service = &nats[0];
    let port = service["spec"]["ports"].as_vec().unwrap().iter().find(|port| port["name"].as_str() == Some("monitor"));
    let endpoint = format!("nats.slipdrive-sweeps.svc.cluster.local:{}", port.unwrap()["port"].as_i64().unwrap());
    assert_eq!(metadata["natsServerMonitoringEndpoint"].as_str(), Some(&*endpoint));
}

#[test]
fn workers_are_scraped_once() {
    let monitor = &documents("monitoring/podmonitor.yaml")[0]["spec"];
    let pod = &documents("workers/deployment.yaml")[0]["spec"]["template"];
    assert_eq!(monitor["selector"]["matchLabels"], pod["metadata"]["labels"]);
    let endpoint = &monitor["podMetricsEndpoints"][0];
    assert_eq!(endpoint["port"], pod["spec"]["containers"][0]["ports"][0]["name"]);
    assert!(pod["metadata"]["annotations"].is_badvalue(), "a scrape over annotations would come beside this one");
}

#[test]
fn leases_and_grace_fit_each_other() {
    let worker = &documents("workers/deployment.yaml")[0]["spec"]["template"]["spec"];
    let variables = worker["containers"][0]["env"].as_vec().unwrap();
    let variable = |name: &str| variables.iter().find(|variable| variable["name"].as_str() == Some(name)).unwrap();
    let lease: i64 = variable("SLIPDRIVE_LEASE_S")["value"].as_str().unwrap().parse().unwrap();
    // Ten seconds for the last results, and as much again for the words to the server.
    assert!(worker["terminationGracePeriodSeconds"].as_i64().unwrap() >= 20);
    let cooldown = documents("workers/scaler.yaml")[0]["spec"]["cooldownPeriod"].as_i64().unwrap();
    assert!(cooldown > 2 * lease, "what a killed worker had comes back before the last worker goes");
    let is_secret = |name: &str| !variable(name)["valueFrom"]["secretKeyRef"].is_badvalue();
    assert!(is_secret("SLIPDRIVE_NATS_URL"));
}

#[test]
fn job_takes_all_shards_of_a_sweep_that_can_be_read() {
    let job = &documents("indexed-job/job.yaml")[0]["spec"];
    let completions = job["completions"].as_i64().unwrap();
    let arguments = job["template"]["spec"]["containers"][0]["args"].as_vec().unwrap();
    let arguments: Vec<_> = arguments.iter().map(|argument| argument.as_str().unwrap()).collect();
    assert!(arguments.contains(&format!("--shard=$(JOB_COMPLETION_INDEX)/{completions}").as_str()), "{arguments:?}");
    let jobs = Jobs::new(Limits::default(), std::sync::Arc::new(slipdrive::jobs::InProcessSolver), &Metrics::new());
    let sweep = Sweep::read(fs::File::open(path("indexed-job/sweep.json")).unwrap(), &jobs).unwrap();
    assert!(sweep.chunk_count() >= u64::try_from(completions).unwrap());
}
