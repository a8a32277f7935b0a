#!/usr/bin/env bash
# Draws the figures of docs again by the command line: the forward drive, the path of the worked example of limits, a drifting plan
# on two floors, and the map of sweeps.
# docs/draw.sh [FLAG of cargo]...
set -euo pipefail
cd "$(dirname "$0")/.."
cargo run --locked "$@" -- solve forward-drive --svg docs/figures
folder=$(mktemp -d)
cargo run --locked "$@" -- solve warehouse-aisle --svg "$folder"
cp "$folder/path.svg" docs/aisle.svg
for friction in 0.45 0.40; do
    schedule=$(cat tests/data/schedules/drifting.json)
    echo "{\"robot\": {\"wheel_friction_coefficient\": $friction}, \"torque_schedule\": $schedule}" > "$folder/$friction.json"
    cargo run --locked "$@" -- simulate "$folder/$friction.json" --save "$folder/$friction.saved"
done
cargo run --locked "$@" -- present "$folder/0.45.saved" "$folder/0.40.saved" --svg "$folder"
cp "$folder/path.svg" docs/floor.svg
cargo run --locked "$@" -- sweep final-time-map --out "$folder/map" --figure y_m,wheel_friction_coefficient,final_time_s
cp "$folder/map/map.svg" docs/final_time_map.svg
rm -r "$folder"
