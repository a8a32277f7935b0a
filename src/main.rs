//! The slipdrive binary.
fn main() {}
