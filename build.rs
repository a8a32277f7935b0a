//! Generates the messages of the contract from `proto/`. The numerics alone need nothing of it.

#[cfg(feature = "server")]
#[path = "build/contract.rs"]
mod contract;

#[cfg(feature = "server")]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    contract::generate()
}

#[cfg(not(feature = "server"))]
fn main() {}
