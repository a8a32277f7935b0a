//! The image, built and run as a hardened pod would run it.

use std::process::Command;

/// What the script ends with when a tool is missing.
const SKIPPED: i32 = 77;

#[test]
#[ignore = "slow: builds an image with buildah and runs it with podman, as root"]
fn container_passes_its_checks() {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/deploy/check-container.sh");
    let output = Command::new(script).output().unwrap();
    let lines = String::from_utf8_lossy(&output.stdout);
    println!("{lines}{}", String::from_utf8_lossy(&output.stderr));
    match output.status.code() {
        Some(0) => {}
        Some(SKIPPED) => println!("SKIPPED: the container was not checked, see above"),
        code => panic!("a check failed ({code:?}):\n{lines}"),
    }
}
