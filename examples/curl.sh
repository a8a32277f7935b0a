#!/usr/bin/env bash
# The REST API with curl: ./examples/curl.sh [http://127.0.0.1:8080]
set -euo pipefail
base=${1:-http://127.0.0.1:8080}
# With API keys: CURL_KEY=... sends one.
auth=()
if [ -n "${CURL_KEY:-}" ]; then auth=(-H "Authorization: Bearer $CURL_KEY"); fi

echo "what the server takes:"
curl -fsS "$base/limits" | cut -c 1-300

echo "the fastest way 5 m ahead, torques only:"
curl -fsS "${auth[@]}" "$base/solve" -H 'content-type: application/json' \
  -d '{"maneuver": {"goal": {"y_m": 5}}, "view": "plan"}'; echo

echo "the same with progress:"
curl -fsSN "${auth[@]}" "$base/solve" -H 'content-type: application/json' -H 'accept: text/event-stream' \
  -H 'request-timeout-ms: 5000' -d '{"maneuver": {"goal": {"y_m": 5}}, "view": "plan"}'

echo "many at once, each answered as it ends:"
for y_m in 1 2 3; do
  echo "{\"request_id\": \"$y_m m\", \"solve\": {\"maneuver\": {\"goal\": {\"y_m\": $y_m}}, \"solver\": {\"starts\": 1}, \"view\": \"plan\"}}"
done | curl -fsSN "${auth[@]}" "$base/batch" -H 'content-type: application/x-ndjson' --data-binary @-

echo "what a refusal says:"
curl -sS "${auth[@]}" "$base/validate" -H 'content-type: application/json' -d '{"robot": {"wheel_radius_m": 0}}'; echo
