#!/usr/bin/env bash
# Draws the figures of docs again by the command line: the forward drive, and the path of the worked example of limits.
# docs/draw.sh [FLAG of cargo]...
set -euo pipefail
cd "$(dirname "$0")/.."
cargo run --locked "$@" -- solve forward-drive --svg docs/figures
folder=$(mktemp -d)
cargo run --locked "$@" -- solve warehouse-aisle --svg "$folder"
cp "$folder/path.svg" docs/aisle.svg
rm -r "$folder"
