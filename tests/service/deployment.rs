//! What schemas do not know of the manifests: rules across fields, files and the program.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use slipdrive::api::server::ServerSettings;
use slipdrive::jobs::Limits;
use slipdrive::service::DEFAULT_QUEUE_WORK;
use yaml_rust2::Yaml;

use crate::support::manifests::{Rendering, deploy, renderings};
use crate::support::process::slipdrive;

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

/// What a mounted file holds, as far as the program reads it at its start.
fn mounted_files() -> [(&'static str, String); 3] {
    let certified = rcgen::generate_simple_self_signed(["robots.test".to_owned()]).unwrap();
    [
        ("SLIPDRIVE_API_KEYS_FILE", "key\n".to_owned()),
        ("SLIPDRIVE_TLS_CERTIFICATE", certified.cert.pem()),
        ("SLIPDRIVE_TLS_KEY", certified.signing_key.serialize_pem()),
    ]
}

/// The value that the container's variable has on this machine; `None` where this build has no use for it.
fn value_here(rendering: &Rendering, variable: &Yaml, folder: &Path) -> Option<String> {
    let name = variable["name"].as_str().unwrap();
    let container = rendering.container();
    let Some(value) = variable["value"].as_str() else {
        assert_eq!(variable["valueFrom"]["resourceFieldRef"]["resource"].as_str(), Some("requests.cpu"));
        return Some(container["resources"]["requests"]["cpu"].as_str().unwrap().to_owned());
    };
    if !value.starts_with('/') {
        return Some(value.to_owned());
    }
    let mut mounts = container["volumeMounts"].as_vec().unwrap().iter();
    assert!(
        mounts.any(|mount| Path::new(value).starts_with(mount["mountPath"].as_str().unwrap())),
        "{}: {value} is not mounted",
        rendering.name
    );
    let is_built = cfg!(feature = "tls") || !name.starts_with("SLIPDRIVE_TLS_");
    is_built.then(|| folder.join(name).to_str().unwrap().to_owned())
}

#[test]
fn variables_are_settings_and_values_can_be_read() {
    let folder = std::env::temp_dir().join(format!("slipdrive-deployment-{}", std::process::id()));
    fs::create_dir_all(&folder).unwrap();
    for (name, text) in mounted_files() {
        fs::write(folder.join(name), text).unwrap();
    }
    for rendering in renderings() {
        let mut command = slipdrive();
        command.args(["serve", "--print-config", "--http", "0.0.0.0:8080", "--grpc", "0.0.0.0:50051"]);
        let variables = rendering.container()["env"].as_vec().unwrap().iter();
        let values = variables.filter_map(|variable| {
            Some((variable["name"].as_str().unwrap(), value_here(&rendering, variable, &folder)?))
        });
        let values: Vec<_> = values.collect();
        command.envs(values.iter().map(|(name, value)| (name, value)));
        let output = command.output().unwrap();
        let printed = String::from_utf8(output.stdout).unwrap();
        assert!(output.status.success(), "{}: {}", rendering.name, String::from_utf8_lossy(&output.stderr));
        for (name, _) in values {
            assert!(printed.contains(&format!("# from {name}\n")), "{}: {name} in {printed}", rendering.name);
        }
    }
    fs::remove_dir_all(folder).unwrap();
}

#[test]
fn tls_is_mounted_as_a_folder_and_leaves_the_probes_their_port() {
    for rendering in renderings().iter().filter(|rendering| rendering.name == "tls") {
        let (certificate, key) =
            (rendering.variable("SLIPDRIVE_TLS_CERTIFICATE"), rendering.variable("SLIPDRIVE_TLS_KEY"));
        assert!(certificate.unwrap().ends_with("/tls.crt") && key.unwrap().ends_with("/tls.key"));
        for mount in rendering.container()["volumeMounts"].as_vec().unwrap() {
            assert!(mount["subPath"].is_badvalue(), "a file by subPath never sees a rotation: {mount:?}");
        }
        assert!(rendering.variable("SLIPDRIVE_ADMIN").is_some(), "health and probes speak plain text");
        for service in rendering.of_kind("Service") {
            assert_eq!(service["spec"]["ports"][0]["appProtocol"].as_str(), Some("https"));
        }
    }
}

#[test]
fn routes_lead_to_ports_of_services_by_a_name_of_their_own() {
    for rendering in renderings() {
        let has_port = |name: &Yaml, port: &Yaml| {
            let mut services =
                rendering.of_kind("Service").into_iter().filter(|service| &service["metadata"]["name"] == name);
            services
                .any(|service| service["spec"]["ports"].as_vec().unwrap().iter().any(|served| &served["port"] == port))
        };
        let mut hosts = BTreeSet::new();
        for route in [rendering.of_kind("HTTPRoute"), rendering.of_kind("GRPCRoute")].concat() {
            let backend = &route["spec"]["rules"][0]["backendRefs"][0];
            assert!(has_port(&backend["name"], &backend["port"]), "{}: {backend:?}", rendering.name);
            let (host, listener) = (&route["spec"]["hostnames"][0], &route["spec"]["parentRefs"][0]["sectionName"]);
            assert!(hosts.insert(host.as_str().unwrap()), "{}: two kinds of routes share {host:?}", rendering.name);
            let listeners = rendering.only("Gateway")["spec"]["listeners"].as_vec().unwrap();
            let own = listeners.iter().find(|candidate| &candidate["name"] == listener).unwrap();
            assert_eq!(&own["hostname"], host, "{}", rendering.name);
            assert_eq!(own["tls"]["mode"].as_str(), Some("Terminate"), "{}", rendering.name);
        }
    }
}
