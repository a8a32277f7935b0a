//! What a release has to agree on: versions, the changelog, and where the base of the image comes from.

use std::fs;
use std::path::Path;

fn text_of(path: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(path)).unwrap()
}

#[test]
fn every_file_names_the_version_of_the_crate() {
    let version = env!("CARGO_PKG_VERSION");
    let image = format!("image: slipdrive:{version}");
    for (path, line, places) in [
        ("clients/python/pyproject.toml", &format!("version = \"{version}\""), 1),
        ("Dockerfile", &format!("ARG VERSION={version}"), 1),
        ("deploy/compose.yaml", &image, 2),
        ("deploy/kubernetes/base/deployment.yaml", &image, 1),
        ("deploy/kubernetes/sweeps/indexed-job/job.yaml", &image, 1),
        ("deploy/kubernetes/sweeps/workers/deployment.yaml", &image, 1),
        ("deploy/kubernetes/overlays/site/kustomization.yaml", &format!("newTag: {version}"), 1),
    ] {
        assert_eq!(text_of(path).lines().filter(|found| found.trim() == line).count(), places, "{path}: {line}");
    }
}

#[test]
fn changelog_begins_with_what_is_unreleased_or_with_this_version() {
    let changelog = text_of("CHANGELOG.md");
    let first = changelog.lines().find(|line| line.starts_with("## ")).unwrap();
    let this = format!("## {} - ", env!("CARGO_PKG_VERSION"));
    assert!(first == "## Unreleased" || first.starts_with(&this), "{first}");
}

#[test]
fn image_is_built_by_the_toolchain_that_it_names() {
    let dockerfile = text_of("Dockerfile");
    let toolchain = dockerfile.lines().find_map(|line| line.strip_prefix("FROM docker.io/library/rust:")).unwrap();
    let tag = toolchain.split_once(' ').unwrap().0;
    let version: Vec<u32> = tag.split_once('-').unwrap().0.split('.').map(|part| part.parse().unwrap()).collect();
    assert_eq!(version.len(), 3, "{tag}: major, minor and patch");
    let least: Vec<u32> = env!("CARGO_PKG_RUST_VERSION").split('.').map(|part| part.parse().unwrap()).collect();
    assert!(version >= least, "{tag} is older than the crate allows");
}
