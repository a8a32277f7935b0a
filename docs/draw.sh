#!/usr/bin/env bash
# Draws docs/figures again: the forward drive, by the command line. docs/draw.sh [FLAG of cargo]...
set -euo pipefail
cd "$(dirname "$0")/.."
cargo run --locked "$@" -- solve forward-drive --svg docs/figures
