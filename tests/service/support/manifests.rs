//! The files under `deploy`, as they are written and as `kubectl kustomize` renders them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use yaml_rust2::{Yaml, YamlLoader};

/// A path under `deploy`.
pub(crate) fn deploy(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("deploy").join(path)
}

/// One rendering of the manifests.
pub(crate) struct Rendering {
    /// The overlay, or `base`.
    pub(crate) name: String,
    pub(crate) documents: Vec<Yaml>,
}

impl Rendering {
    pub(crate) fn of_kind(&self, kind: &str) -> Vec<&Yaml> {
        self.documents.iter().filter(|document| document["kind"].as_str() == Some(kind)).collect()
    }

    pub(crate) fn only(&self, kind: &str) -> &Yaml {
        let found = self.of_kind(kind);
        assert_eq!(found.len(), 1, "{}: {kind}", self.name);
        found[0]
    }

    pub(crate) fn pod(&self) -> &Yaml {
        &self.only("Deployment")["spec"]["template"]
    }

    pub(crate) fn container(&self) -> &Yaml {
        let containers = self.pod()["spec"]["containers"].as_vec().unwrap();
        assert_eq!(containers.len(), 1, "{}", self.name);
        &containers[0]
    }

    /// A variable of the container, where it is a plain value.
    pub(crate) fn variable(&self, name: &str) -> Option<&str> {
        let variables = self.container()["env"].as_vec().unwrap();
        variables.iter().find(|variable| variable["name"].as_str() == Some(name))?["value"].as_str()
    }

    pub(crate) fn port_names(&self) -> BTreeSet<&str> {
        self.container()["ports"].as_vec().unwrap().iter().map(|port| port["name"].as_str().unwrap()).collect()
    }
}

/// The documents of a YAML text.
pub(crate) fn documents(text: &str) -> Vec<Yaml> {
    YamlLoader::load_from_str(text).unwrap().into_iter().filter(|document| !document.is_null()).collect()
}

/// The base as it is written, and every overlay as kubectl renders it.
pub(crate) fn renderings() -> Vec<Rendering> {
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
